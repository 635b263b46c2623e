// Makes ../bundle: what fusion carries and serves. The same sources give the same bytes, so that CI can tell a bundle
// that is not of these sources: `node build.mjs --check` compares and writes nothing.
import { build } from "esbuild";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";

// All files together, compressed: the page is opened over thin links, and every fusion carries it.
const MOST_GZIP_BYTES = 250_000;

const here = dirname(fileURLToPath(import.meta.url));
const bundleFolder = join(here, "..", "bundle");

async function script(name) {
  const result = await build({
    entryPoints: [join(here, "src", name)],
    absWorkingDir: here,
    bundle: true,
    minify: true,
    format: "esm",
    target: ["es2022"],
    // Licences of what is bundled must travel with it.
    legalComments: "inline",
    charset: "utf8",
    write: false,
  });
  return Buffer.from(result.outputFiles[0].contents);
}

async function style(name) {
  const result = await build({
    entryPoints: [join(here, "src", name)],
    absWorkingDir: here,
    bundle: true,
    minify: true,
    write: false,
  });
  return Buffer.from(result.outputFiles[0].contents);
}

/** gzip's header holds a time and an operating system; without them the bytes depend on the content alone. */
function compressed(bytes) {
  const packed = gzipSync(bytes, { level: 9 });
  packed.fill(0, 4, 8);
  packed[9] = 255;
  return packed;
}

const plain = new Map([
  ["index.html", await readFile(join(here, "src", "index.html"))],
  ["page.css", await style("page.css")],
  ["page.js", await script("main.ts")],
  ["marks.html", await readFile(join(here, "src", "marks.html"))],
  ["marks.css", await style("marks.css")],
  ["marks.js", await script("marks.ts")],
]);

let gzipBytes = 0;
const stale = [];
await mkdir(bundleFolder, { recursive: true });
for (const [name, bytes] of plain) {
  const packed = compressed(bytes);
  gzipBytes += packed.length;
  console.log(`${name}: ${bytes.length} bytes, ${packed.length} gzip`);
  const path = join(bundleFolder, name);
  if (process.argv.includes("--check")) {
    const there = await readFile(path).catch(() => Buffer.alloc(0));
    if (!there.equals(bytes)) stale.push(name);
  } else {
    await writeFile(path, bytes);
  }
}
console.log(`all: ${gzipBytes} bytes gzip, at most ${MOST_GZIP_BYTES}`);
if (gzipBytes > MOST_GZIP_BYTES) {
  console.error("the bundle is too large");
  process.exitCode = 1;
}
if (stale.length > 0) {
  console.error(`not of these sources: ${stale.join(", ")}; run \`npm ci && npm run build\` in page/web and commit page/bundle`);
  process.exitCode = 1;
}
