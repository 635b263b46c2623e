// Text messages: what is wrong is said by path, and strangers' texts do no harm.

import assert from "node:assert/strict";
import { test } from "node:test";
import { ProtocolError } from "../src/protocol/checked.ts";
import { readSeries, readText } from "../src/protocol/text.ts";
import { readVenue } from "../src/protocol/venue.ts";

const VENUE = {
  protocol: 1,
  release: "0.1.0",
  venue: "hall",
  mode: "live",
  rate_hz: 60,
  field: { min_m: [-10, -5, 0], max_m: [10, 5, 3], floor_m: 0 },
  viewpoints: [{ name: "ne", cameras: [0] }],
  cameras: [
    {
      name: "ne_a",
      viewpoint: 0,
      size_px: [1920, 1080],
      fx_px: 1500,
      fy_px: 1500,
      cx_px: 959.5,
      cy_px: 539.5,
      rotation: [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
      ],
      translation_m: [0, 0, 0],
      position_m: [0, 0, 0],
    },
  ],
  joints: [
    { name: "pelvis", parent: null },
    { name: "spine", parent: 0 },
  ],
  bones: [{ from: 0, to: 1, radius_m: 0.1 }],
  keypoints: ["nose"],
  angles: [
    { name: "pelvis_tilt", unit: "rad", range: null },
    { name: "elbow_flex_r", unit: "rad", range: [-0.0873, 2.5307] },
  ],
  actions: [],
  pictures: false,
};

const STATUS = {
  type: "status",
  tick: 1000,
  alarms: [{ severity: "failed", key: "node/ne", subject: "edge ne", text: "silent", remedy: "look", since_us: null }],
  nodes: [],
  links: [],
  cameras: [{ camera: 0, name: "a", state: "works", frames_per_s: 60, capture_offset_us: null, reason: null, persons: [3] }],
  latency: { window_s: 10, stages: [{ stage: "link", samples: 3, p50_us: 100, p99_us: 200 }] },
  poses_per_s: 60,
  recording: null,
};

test("a venue is read", () => {
  const venue = readVenue(VENUE);
  assert.equal(venue.name, "hall");
  assert.equal(venue.court, null);
  assert.deepEqual(venue.cameras[0]?.rotation, [1, 0, 0, 0, 1, 0, 0, 0, 1]);
  assert.deepEqual(venue.angles[1]?.range, [-0.0873, 2.5307]);
});

test("a venue of another protocol is refused with what to do", () => {
  assert.throws(() => readVenue({ ...VENUE, protocol: 2 }), /protocol 2.*load the page again/);
});

test("a bone to a joint that is not there is refused by its path", () => {
  assert.throws(() => readVenue({ ...VENUE, bones: [{ from: 0, to: 2, radius_m: 0.1 }] }), /venue\.bones\[0\]\.to is 2/);
});

test("a status is read, and what is not known is null", () => {
  const message = readText(JSON.stringify(STATUS));
  assert.ok(message?.type === "status");
  assert.equal(message.status.alarms[0]?.severity, "failed");
  assert.equal(message.status.cameras[0]?.captureOffset_us, null);
  assert.equal(message.status.recording, null);
});

test("a number that is none is refused by its path", () => {
  const wrong = { ...STATUS, poses_per_s: "60" };
  assert.throws(() => readText(JSON.stringify(wrong)), /message\.poses_per_s is "60", expected a number/);
});

test("a state that this page does not know is unknown, not works", () => {
  const message = readText(JSON.stringify({ ...STATUS, cameras: [{ ...STATUS.cameras[0], state: "molten" }] }));
  assert.ok(message?.type === "status");
  assert.equal(message.status.cameras[0]?.state, "unknown");
});

test("a message of a kind that this page does not know is left", () => {
  assert.equal(readText('{"type": "weather", "rain": true}'), null);
});

test("what is no JSON or no object is refused", () => {
  for (const text of ["", "{", "[]", "null", "7", '{"type": 7}']) assert.throws(() => readText(text), ProtocolError);
});

test("a text as long as a page is cut, and a name that is code stays text", () => {
  const name = "<img src=x onerror=alert(1)>".padEnd(5000, "x");
  const message = readText(`{"type": "names", "names": {"3": "${name}", "__proto__": "no", "-1": "nobody"}}`);
  assert.ok(message?.type === "names");
  assert.deepEqual([...message.names.keys()], [3]);
  assert.equal(message.names.get(3)?.length, 64);
});

test("a series whose rows do not fit its ticks is refused", () => {
  const series = { session: 1, person: 3, angles: [0], ticks: [1, 2], values: [[0.1]], unobserved: [[], []] };
  assert.throws(() => readSeries(series), /series\.values/);
});
