// The page of marks: what it is told, how it saves, where a pixel is on the screen.

import assert from "node:assert/strict";
import { test } from "node:test";
import { readDocument, type Clicked, type State } from "../src/marks/document.ts";
import { Saver, type Saved } from "../src/marks/saver.ts";
import { Zoom } from "../src/marks/zoom.ts";

const CLICKED = {
  court: "futsal",
  size_m: null,
  click_sigma_px: null,
  place_sigma_m: null,
  floor: [],
  places: { __proto__x: [1, 2, 3] },
  lengths: [{ between: ["red", "blue"], length_m: 1 }],
  camera: { north: { centre: [[1, 2]] } },
};

const state = (revision: number): Record<string, unknown> => ({
  revision,
  clicked: CLICKED,
  problem: null,
  fits: [
    {
      camera: "north",
      state: "fits",
      text: "4 clicks fit",
      warnings: [],
      center_m: [1, 2, 3],
      residuals: [{ name: "centre", index: 0, px: 0.4, m: 0.01, is_outlier: false }],
      lines: [{ name: "halfway_line", pieces: [[[1, 2], [3, 4]]] }],
      marks: [{ name: "centre", px: [1, 2] }],
    },
  ],
});

test("a document is read, and what is wrong in it is named", () => {
  const document = {
    file: "clicked.toml",
    court: { name: "futsal", rules: "FIFA", size_m: [40, 20], marks: [{ name: "centre", position_m: [0, 0, 0] }], lines: [] },
    cameras: [{ name: "north", picture: "north.png", size_px: [1920, 1080], has_lens: true }],
    state: state(3),
  };
  const read = readDocument(document);
  assert.equal(read.state.revision, 3);
  assert.deepEqual(read.state.clicked.camera["north"]?.["centre"], [[1, 2]]);
  assert.deepEqual(read.state.fits[0]?.marks.get("centre"), [1, 2]);
  assert.throws(() => readDocument({ ...document, cameras: [{ name: 3 }] }), /marks\.cameras\[0\]\.name is 3, expected a text/);
});

/** A saver whose server answers what the test says. */
function saver(): { saver: Saver; sent: string[]; said: Saved[]; states: [State, boolean][]; retries: (() => void)[]; answer: (status: number, text: string) => Promise<void> } {
  const waiting: ((answer: { status: number; text: string }) => void)[] = [];
  const [sent, said, states, retries]: [string[], Saved[], [State, boolean][], (() => void)[]] = [[], [], [], []];
  const made = new Saver(
    0,
    (body) => {
      sent.push(body);
      return new Promise((resolve, reject) => waiting.push((it) => (it.status === 0 ? reject(new Error("away")) : resolve(it))));
    },
    { saved: (saved) => said.push(saved), state: (one, isForeign) => states.push([one, isForeign]) },
    (act) => retries.push(act),
  );
  const answer = async (status: number, text: string): Promise<void> => {
    waiting.shift()?.({ status, text });
    for (let i = 0; i < 10; i++) await Promise.resolve();
  };
  return { saver: made, sent, said, states, retries, answer };
}

const clicked = (name: string): Clicked => ({ ...CLICKED, floor: [name] }) as unknown as Clicked;

test("of many changes the first and the newest are sent, one after the other", async () => {
  const it = saver();
  for (const name of ["a", "b", "c"]) it.saver.save(clicked(name));
  assert.equal(it.sent.length, 1);
  await it.answer(200, JSON.stringify(state(1)));
  assert.equal(it.sent.length, 2);
  assert.match(it.sent[1] ?? "", /"revision":1.*"floor":\["c"\]/);
  await it.answer(200, JSON.stringify(state(2)));
  assert.deepEqual(it.said.at(-1), { kind: "saved" });
  assert.equal(it.saver.isDone, true);
});

test("what somebody else has changed is taken, and ours is not forced on it", async () => {
  const it = saver();
  it.saver.save(clicked("a"));
  it.saver.save(clicked("b"));
  await it.answer(409, JSON.stringify(state(9)));
  assert.equal(it.sent.length, 1);
  assert.deepEqual([it.states[0]?.[0].revision, it.states[0]?.[1]], [9, true]);
});

test("a server that is away is asked again with the newest, one that refuses is not", async () => {
  const it = saver();
  it.saver.save(clicked("a"));
  await it.answer(0, "");
  assert.equal(it.said.at(-1)?.kind, "failed");
  assert.equal(it.saver.isDone, false);
  it.retries[0]?.();
  await it.answer(400, "found (1, 2), expected a place in the picture\n");
  assert.deepEqual(it.said.at(-1), { kind: "failed", reason: "found (1, 2), expected a place in the picture" });
  assert.equal(it.retries.length, 1);
});

test("a pixel comes back from the screen, and stays under the pointer while one comes nearer", () => {
  const zoom = new Zoom(1920, 1080);
  zoom.fit(960, 600);
  assert.deepEqual(zoom.toScreen([-0.5, -0.5]), [0, 30]);
  const under = zoom.toPixel(300, 200);
  zoom.by(7.3, 300, 200);
  const [x, y] = zoom.toPixel(300, 200);
  assert.ok(Math.abs(x - under[0]) < 1e-9 && Math.abs(y - under[1]) < 1e-9);
  const [a, b] = zoom.toPixel(...zoom.toScreen([12.25, 7.5]));
  assert.ok(Math.abs(a - 12.25) < 1e-9 && Math.abs(b - 7.5) < 1e-9);
  assert.ok(zoom.contains([-0.5, 1079.5]) && !zoom.contains([1920, 5]));
});
