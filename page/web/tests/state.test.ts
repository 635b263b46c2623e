// What the page keeps from one session of fusion to the next.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { IdentityEvent } from "../src/protocol/text.ts";
import { eventsOf } from "../src/state.ts";

test("the first events of a new session stay, and those of the one before go", () => {
  const event = (session: number, tick: number): IdentityEvent => ({
    session,
    tick,
    at_us: tick,
    person: 1,
    other: null,
    change: "initiate",
    text: "person 1 came",
  });
  assert.deepEqual(eventsOf([event(7, 900), event(8, 1), event(8, 2)], 8), [event(8, 1), event(8, 2)]);
});
