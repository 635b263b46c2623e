// A page that is hidden and shown again has one connection, however slow the network is.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Connection, type ConnectionState } from "../src/connection.ts";

class FakeSocket {
  static readonly OPEN = 1;
  static readonly made: FakeSocket[] = [];
  readyState = 0;

  constructor() {
    FakeSocket.made.push(this);
  }

  close(): void {
    this.readyState = 3;
  }
}

const VENUE = {
  protocol: 1,
  release: "0.1.0",
  venue: "hall",
  mode: "live",
  rate_hz: 60,
  field: { min_m: [-10, -5, 0], max_m: [10, 5, 3], floor_m: 0 },
  court: null,
  viewpoints: [],
  cameras: [],
  joints: [],
  bones: [],
  keypoints: [],
  angles: [],
  actions: [],
  pictures: false,
};

test("who sleeps and wakes while the venue is asked for gets one socket", async () => {
  const answers: ((response: Response) => void)[] = [];
  const fakes = {
    location: { hash: "", protocol: "http:", host: "localhost" },
    WebSocket: FakeSocket,
    fetch: () => new Promise<Response>((resolve) => answers.push(resolve)),
    setInterval: () => 0,
  };
  for (const [name, value] of Object.entries(fakes)) Object.defineProperty(globalThis, name, { value, configurable: true });
  const states: ConnectionState["kind"][] = [];
  const ignore = (): void => {};
  const connection = new Connection({
    venue: ignore,
    state: (state) => states.push(state.kind),
    text: ignore,
    binary: ignore,
    notice: ignore,
    unreadable: ignore,
  });
  void connection.open();
  connection.sleep();
  connection.wake();
  assert.equal(answers.length, 2);
  for (const answer of answers) answer(new Response(JSON.stringify(VENUE)));
  await new Promise((resolve) => setTimeout(resolve, 20));
  assert.equal(FakeSocket.made.length, 1);
  assert.deepEqual(states, ["connecting", "asleep", "connecting"]);
});
