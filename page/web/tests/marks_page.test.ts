// The page of marks: what it is told, how it saves, where a pixel is on the screen.

import assert from "node:assert/strict";
import { test } from "node:test";
import { readDocument, type Clicked, type State } from "../src/marks/document.ts";
import { LastPictures } from "../src/marks/pictures.ts";
import { Saver, type Saved, type Whose } from "../src/marks/saver.ts";
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

interface Tried {
  saver: Saver;
  sent: string[];
  said: Saved[];
  states: [State, Whose][];
  refused: [Clicked, string][];
  retries: (() => void)[];
  answer: (status: number, text: string) => Promise<void>;
}

/** A saver whose server answers what the test says. */
function saver(): Tried {
  const waiting: ((answer: { status: number; text: string }) => void)[] = [];
  const [sent, said, states, retries]: [string[], Saved[], [State, Whose][], (() => void)[]] = [[], [], [], []];
  const refused: [Clicked, string][] = [];
  const made = new Saver(
    0,
    clicked("first"),
    (body) => {
      sent.push(body);
      return new Promise((resolve, reject) => waiting.push((it) => (it.status === 0 ? reject(new Error("away")) : resolve(it))));
    },
    { saved: (saved) => said.push(saved), state: (one, whose) => states.push([one, whose]), refused: (...it) => refused.push(it) },
    (act) => retries.push(act),
  );
  const answer = async (status: number, text: string): Promise<void> => {
    waiting.shift()?.({ status, text });
    for (let i = 0; i < 10; i++) await Promise.resolve();
  };
  return { saver: made, sent, said, states, refused, retries, answer };
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
  assert.deepEqual([it.states[0]?.[0].revision, it.states[0]?.[1]], [9, "foreign"]);
});

/** As the server says what is in the file: in its own order, without what has no click. */
const stateOf = (revision: number, name: string): string => {
  const { camera, ...others } = clicked(name);
  return JSON.stringify({ ...state(revision), clicked: { camera, ...others } });
};

test("what the server has put beside our change is shown, unless it was changed since", async () => {
  const it = saver();
  it.saver.save(clicked("a"));
  it.saver.save(clicked("b"));
  const merged = (revision: number): string => {
    const of = JSON.parse(stateOf(revision, "b")) as { clicked: { camera: Record<string, unknown> } };
    of.clicked.camera["south"] = { centre: [[3, 4]] };
    return JSON.stringify(of);
  };
  await it.answer(200, merged(1));
  assert.equal(it.states.at(-1)?.[1], "ours");
  await it.answer(200, merged(2));
  assert.equal(it.states.at(-1)?.[1], "merged");
  assert.deepEqual(it.states.at(-1)?.[0].clicked.camera["south"], { centre: [[3, 4]] });
  assert.equal(it.saver.isDone, true);
  it.saver.save(clicked("bad"));
  await it.answer(400, "no");
  assert.equal(it.refused[0]?.[0], it.states.at(-1)?.[0].clicked);
});

test("a server that is away or cannot write is asked again with the newest, and until then nothing is saved", async () => {
  const it = saver();
  it.saver.save(clicked("a"));
  await it.answer(0, "");
  assert.equal(it.said.at(-1)?.kind, "failed");
  assert.equal(it.saver.isDone, false);
  it.saver.save(clicked("b"));
  await it.answer(500, "the disk is full");
  assert.deepEqual(it.said.at(-1), { kind: "failed", reason: "the disk is full" });
  assert.equal(it.saver.isDone, false);
  assert.equal(it.retries.length, 1, "one is enough");
  it.retries[0]?.();
  assert.match(it.sent.at(-1) ?? "", /"floor":\["b"\]/);
  await it.answer(200, stateOf(1, "b"));
  assert.equal(it.saver.isDone, true);
  assert.deepEqual(it.said.at(-1), { kind: "saved" });
});

test("who is not let in has not saved, and is not asked for ever", async () => {
  const it = saver();
  it.saver.save(clicked("a"));
  await it.answer(401, "");
  assert.deepEqual(it.said.at(-1), { kind: "failed", reason: "the server answers 401" });
  assert.deepEqual([it.saver.isDone, it.retries.length], [false, 0]);
});

test("a change that is refused is taken back to what is in the file, and what is clicked next is written", async () => {
  const it = saver();
  const good = clicked("good");
  it.saver.save(good);
  await it.answer(200, stateOf(1, "good"));
  it.saver.save(clicked("bad"));
  await it.answer(400, "found (1, 2), expected a place in the picture\n");
  assert.equal(it.refused.length, 1);
  assert.equal(it.refused[0]?.[0], good);
  assert.equal(it.refused[0]?.[1], "found (1, 2), expected a place in the picture");
  assert.deepEqual([it.saver.isDone, it.retries.length], [true, 0]);
  it.saver.save(clicked("better"));
  await it.answer(200, stateOf(2, "better"));
  assert.equal(it.saver.isDone, true);
});

test("a change that puts right what is being refused is sent", async () => {
  const it = saver();
  it.saver.save(clicked("bad"));
  it.saver.save(clicked("right"));
  await it.answer(400, "no");
  assert.match(it.sent.at(-1) ?? "", /"floor":\["right"\]/);
  await it.answer(200, stateOf(1, "right"));
  assert.deepEqual([it.refused.length, it.saver.isDone], [0, true]);
});

test("own clicks whose answer was lost are not taken for somebody else's", async () => {
  const it = saver();
  it.saver.save({ ...clicked("a"), camera: { ...CLICKED.camera, south: {} } } as unknown as Clicked);
  await it.answer(0, "");
  it.saver.save(clicked("b"));
  await it.answer(409, stateOf(1, "a"));
  assert.equal(it.states.at(-1)?.[1], "ours");
  assert.match(it.sent.at(-1) ?? "", /"revision":1.*"floor":\["b"\]/);
  await it.answer(0, "");
  it.retries[0]?.();
  await it.answer(409, stateOf(2, "b"));
  assert.equal(it.states.at(-1)?.[1], "ours");
  assert.equal(it.saver.isDone, true, "it is in the file already");
  assert.equal(it.sent.length, 4);
});

test("the last pictures are kept, others are given back, and one that did not come is asked for again", async () => {
  const [asked, closed]: [number[], number[]] = [[], []];
  let isAway = true;
  const pictures = new LastPictures(async (number) => {
    asked.push(number);
    if (number === 9 && isAway) throw new Error("away");
    return { close: () => void closed.push(number) };
  }, 2);
  for (const number of [0, 1, 0, 2, 0]) await pictures.get(number);
  assert.deepEqual([asked, closed], [[0, 1, 2], [1]]);
  await assert.rejects(pictures.get(9));
  isAway = false;
  await pictures.get(9);
  assert.deepEqual(asked, [0, 1, 2, 9, 9]);
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
