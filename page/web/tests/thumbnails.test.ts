// Pictures are asked for only where the venue has some, and never shown behind people of another time.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { PageState } from "../src/state.ts";
import { Thumbnails } from "../src/thumbnails.ts";

type Answer = Awaited<ReturnType<ConstructorParameters<typeof Thumbnails>[1]["thumbnail"]>>;

let closed = 0;
Object.assign(globalThis, { createImageBitmap: async () => ({ close: () => closed++ }) });

function page(pictures: boolean): PageState {
  const venue = { mode: "live", pictures, cameras: [{}, {}] };
  return { venue, connection: { kind: "open" }, playback: { state: "live" } } as unknown as PageState;
}

/** A server that has these answers, camera by camera, and what was asked of it. */
function server(answers: Answer[]) {
  const asked: string[] = [];
  return {
    asked,
    thumbnail: async (camera: number, tag: string): Promise<Answer> => {
      asked.push(`${camera}${tag}`);
      return answers[camera] ?? null;
    },
  };
}

const settled = (): Promise<void> => new Promise((done) => setTimeout(done, 5));

test("a venue that lets no picture out is not asked for one", async () => {
  const hall = server([{ picture: new Blob(), tag: "a" }]);
  new Thumbnails(page(false), hall).look(0);
  await settled();
  assert.deepEqual(hall.asked, []);
});

test("each camera is asked once a second, by what is known already, and lets go of the picture that is gone", async () => {
  const answers: Answer[] = [{ picture: new Blob(), tag: "a" }, null];
  const hall = server(answers);
  const thumbnails = new Thumbnails(page(true), hall);
  for (const now_ms of [0, 100, 500]) {
    thumbnails.look(now_ms);
    await settled();
  }
  assert.deepEqual(hall.asked, ["0", "1"]);
  const first = thumbnails.of(0);
  assert.ok(first !== null && thumbnails.of(1) === null);
  answers[0] = "same";
  thumbnails.look(1000);
  await settled();
  assert.deepEqual(hall.asked, ["0", "1", "0a", "1"]);
  assert.equal(thumbnails.of(0), first);
  answers[0] = null;
  closed = 0;
  thumbnails.look(2000);
  await settled();
  assert.equal(thumbnails.of(0), null);
  assert.equal(closed, 1);
});

test("in the past, and while fusion is away, there is no picture", async () => {
  for (const change of [{ playback: { state: "paused" } }, { connection: { kind: "away" } }]) {
    const state = page(true);
    const hall = server([{ picture: new Blob(), tag: "a" }]);
    const thumbnails = new Thumbnails(state, hall);
    thumbnails.look(0);
    await settled();
    assert.ok(thumbnails.of(0) !== null);
    Object.assign(state, change);
    thumbnails.look(2000);
    await settled();
    assert.equal(thumbnails.of(0), null);
    assert.deepEqual(hall.asked, ["0", "1"]);
  }
});
