// A key that is held down must not make the server close the connection.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { Request } from "../src/protocol/text.ts";
import { RequestPacer } from "../src/request_pacer.ts";

/** What the server allows: so many at once, and so many a second on average. */
const SERVER_BURST = 40;
const SERVER_PER_SECOND = 20;

test("a key that is held down steps as far as it should, and never asks too often", () => {
  let [allowed, last_ms, stepped] = [SERVER_BURST, 0, 0];
  let now_ms = 0;
  const pacer = new RequestPacer((request) => {
    allowed = Math.min(SERVER_BURST, allowed + ((now_ms - last_ms) / 1000) * SERVER_PER_SECOND) - 1;
    last_ms = now_ms;
    assert.ok(allowed >= 0, `the server closes at ${now_ms} ms`);
    if (request.do === "step") stepped += request.ticks;
  });
  for (let i = 0; i < 300; i++) {
    now_ms = (i * 1000) / 30;
    pacer.send({ do: "step", ticks: 1 }, now_ms);
    if (i % 3 === 0) pacer.flush(now_ms);
  }
  now_ms += 1000;
  pacer.flush(now_ms);
  pacer.clear();
  assert.equal(stepped, 300);
});

test("of what waits, the newest of its kind is wanted", () => {
  const delivered: Request[] = [];
  const pacer = new RequestPacer((request) => delivered.push(request));
  for (let tick = 0; tick < 100; tick++) pacer.send({ do: "seek", tick }, 0);
  pacer.send({ do: "live" }, 0);
  pacer.flush(60_000);
  pacer.clear();
  assert.deepEqual(delivered.slice(-2), [{ do: "seek", tick: 99 }, { do: "live" }]);
  assert.ok(delivered.length < 25, `${delivered.length} requests`);
});
