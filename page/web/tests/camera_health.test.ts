// A lamp must not be green for a camera of which nobody knows.

import assert from "node:assert/strict";
import { test } from "node:test";
import { agreementInWords } from "../src/panels/agreement.ts";
import { healthOfCamera } from "../src/panels/cameras.ts";
import { readText } from "../src/protocol/text.ts";
import type { Status } from "../src/protocol/status.ts";

function status(
  camera: string,
  link: string,
  refused: string | null = null,
  verdict: string | null = null,
  notices: readonly string[] = [],
): Status {
  const message = readText(
    JSON.stringify({
      type: "status",
      tick: 1,
      alarms: notices.map((text, i) => ({ severity: "warning", key: `node/fusion/notice/${i}`, subject: "fusion", text, remedy: "", since_us: 1 })),
      nodes: [],
      links: [{ viewpoint: 2, name: "ne", state: link, refused }],
      cameras: [{ camera: 5, name: "a", state: camera, persons: [], agreement: verdict && { verdict } }],
      latency: null,
      recording: null,
    }),
  );
  assert.ok(message?.type === "status");
  return message.status;
}

test("a camera that works behind a link that works is good", () => {
  assert.equal(healthOfCamera(status("works", "works"), 5, 2)[0], "good");
  assert.equal(healthOfCamera(status("works", "warning"), 5, 2)[0], "good");
});

test("a camera whose edge is silent or refused is not good, whatever the edge said last", () => {
  assert.deepEqual(healthOfCamera(status("works", "failed"), 5, 2), ["failed", "nothing comes from its edge"]);
  assert.deepEqual(healthOfCamera(status("works", "failed", "another calibration"), 5, 2), ["failed", "its edge is refused"]);
});

test("a camera that works and shows something else than the others is a warning", () => {
  assert.equal(healthOfCamera(status("works", "works", null, "disagrees"), 5, 2)[0], "warning");
  assert.equal(healthOfCamera(status("works", "works", null, "agrees"), 5, 2)[0], "good");
  assert.equal(healthOfCamera(status("black", "works", null, "disagrees"), 5, 2)[0], "failed");
});

// Causes come new with releases of fusion, and the page has no list of them.
test("why a camera shows something else is told in the words of fusion, whatever the cause", () => {
  const found = "camera a sees people through a new kind of fog since 20:15";
  const told = (notices: readonly string[]) => healthOfCamera(status("works", "works", null, "disagrees", notices), 5, 2);
  assert.deepEqual(told(["the disk is slow", found]), ["warning", found]);
  assert.deepEqual(told(["cameras b and a. seem to be swapped"])[1], "cameras b and a. seem to be swapped");
  assert.deepEqual(told(["camera a_2 has moved", "a-1 has moved"])[1], "does not show what the others show");
});

test("how far a camera is from the others is told in millimetres, and its clock where it is off", () => {
  const agreement = { verdict: "agrees", distance_mm: 14.2, distance_px: 2, late_ticks: -1.26 } as const;
  assert.equal(agreementInWords(agreement), "agrees to 14 mm, 1.3 ticks early");
  assert.equal(agreementInWords({ ...agreement, late_ticks: 0.01 }), "agrees to 14 mm");
  assert.equal(agreementInWords({ ...agreement, distance_mm: null }), "");
  // Symptom: a camera that did not agree "agreed to 310 mm".
  assert.equal(agreementInWords({ ...agreement, verdict: "disagrees", distance_mm: 310 }), "310 mm off the others, 1.3 ticks early");
  assert.equal(agreementInWords({ ...agreement, verdict: "unknown", late_ticks: null }), "14 mm from the others, not yet judged");
  assert.equal(agreementInWords(null), "");
});

test("a camera's own failure is told before its edge's", () => {
  assert.equal(healthOfCamera(status("black", "failed"), 5, 2)[1], "black pictures");
});

test("a camera of which nothing was heard is unknown", () => {
  assert.equal(healthOfCamera(status("works", "works"), 6, 2)[0], "unknown");
  assert.equal(healthOfCamera(null, 5, 2)[0], "unknown");
});
