// Runs tests/*.test.ts: bundled first, because Node of long-term releases reads no TypeScript.
import { build } from "esbuild";
import { spawnSync } from "node:child_process";
import { mkdtemp, readdir, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const folder = await mkdtemp(join(tmpdir(), "farfield-page-"));
try {
  const names = (await readdir(join(here, "tests"))).filter((name) => name.endsWith(".test.ts"));
  await build({
    entryPoints: names.map((name) => join(here, "tests", name)),
    bundle: true,
    platform: "node",
    format: "esm",
    outdir: folder,
    outExtension: { ".js": ".mjs" },
    logLevel: "warning",
  });
  const files = names.map((name) => join(folder, name.replace(/\.ts$/, ".mjs")));
  const environment = { ...process.env, FARFIELD_GOLDEN: join(here, "..", "golden") };
  process.exitCode = spawnSync(process.execPath, ["--test", ...files], { stdio: "inherit", env: environment }).status ?? 1;
} finally {
  await rm(folder, { recursive: true });
}
