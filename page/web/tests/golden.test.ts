// The bytes that both sides' tests read; what they hold is in page/golden/README.md.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { readVenue } from "../src/protocol/venue.ts";
import { COASTING, People, TRACKED, bitOf, readCameraView, readChosenAngles, unobservedOf } from "../src/protocol/ticks.ts";

const folder = process.env["FARFIELD_GOLDEN"];

function golden(name: string): DataView {
  assert.ok(folder !== undefined, "FARFIELD_GOLDEN names the folder of the golden bytes");
  const bytes = readFileSync(join(folder, name));
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

const SESSION = 0x01020304;
const TICK = 1_000_000_007;
/** Coordinates are kept as 32-bit floats. */
const EXACT_M = 1e-5;

function assertNear(found: number | undefined, expected: number): void {
  assert.ok(found !== undefined && Math.abs(found - expected) < EXACT_M, `${found}, expected ${expected}`);
}

test("the people of a tick are read", () => {
  const people = new People(3);
  people.read(golden("tick.bin"));
  assert.equal(people.session, SESSION);
  assert.equal(people.tick, TICK);
  assert.equal(people.at_us, 1_767_225_600_123_456);
  assert.equal(people.isLive, true);
  assert.equal(people.ids[0], 7);
  assert.equal(people.states[0], TRACKED);
  assert.equal(people.views[0], 4);
  assert.deepEqual([0, 1, 2, 3, 4].filter((v) => bitOf(people.viewpoints, 0, v)), [0, 2, 3]);
  const angles = Array.from({ length: 64 }, (_, a) => a);
  assert.deepEqual(angles.filter((a) => bitOf(people.unobserved, 0, a)), [0, 39]);
  assert.deepEqual(angles.filter((a) => bitOf(people.clamped, 0, a)), [18]);
  const steps = [0, 1, -1, 1000, -2000, 700, 32767, -32768, 5];
  steps.forEach((step, k) => assertNear(people.joints_m[k], ([1.5, -2.5, 0.25][k % 3] ?? 0) + 0.001 * step));
  assertNear(people.sigma_m[0], 0.012);
  assertNear(people.sigma_m[1], 0.508);
  assert.ok(Number.isNaN(people.sigma_m[2]));
});

test("a person of whom nothing is known is not drawn", () => {
  const people = new People(3);
  people.read(golden("tick.bin"));
  assert.equal(people.count, 1);
  assert.equal(people.indexOf(70_000), -1);
  assert.notEqual(people.states[0], COASTING);
});

test("what a prior carries is found without reading the whole tick", () => {
  const view = golden("tick.bin");
  assert.equal(unobservedOf(view, 7, 39), true);
  assert.equal(unobservedOf(view, 7, 38), false);
  assert.equal(unobservedOf(view, 8, 39), false);
});

test("what a camera sees is read", () => {
  const view = readCameraView(golden("camera_view.bin"));
  assert.equal(view.camera, 5);
  assert.equal(view.tick, TICK);
  const [seven, eight, sighting] = view.entries;
  assert.ok(seven !== undefined && eight !== undefined && sighting !== undefined);
  assert.deepEqual([seven.id, seven.hasBox, seven.isChosen, seven.isSighting], [7, true, true, false]);
  assert.deepEqual([...seven.centre_px, ...seven.size_px, seven.rotation_rad], [960.25, 540.5, 80, 200, -0.125]);
  assert.deepEqual([...seven.keypoints_px], [950.25, 470, NaN, NaN]);
  assert.deepEqual([eight.id, eight.hasBox, eight.isChosen, eight.keypoints_px.length], [8, false, false, 0]);
  assert.equal(sighting.isSighting, true);
  assert.deepEqual([...sighting.keypoints_px], [NaN, NaN, -3.5, 12.75]);
});

test("chosen angles are read", () => {
  const message = readChosenAngles(golden("chosen_angles.bin"));
  assert.deepEqual([message.session, message.tick], [SESSION, TICK]);
  assert.deepEqual(
    message.persons.map(({ id, values }) => [id, ...values]),
    [
      [7, 0.5, -1.25],
      [8, 2, 0],
    ],
  );
});

test("a message that is cut anywhere is refused, and nothing else happens", () => {
  const readers: [string, (view: DataView) => unknown][] = [
    ["tick.bin", (view) => new People(3).read(view)],
    ["camera_view.bin", readCameraView],
    ["chosen_angles.bin", readChosenAngles],
  ];
  for (const [name, read] of readers) {
    const whole = golden(name);
    for (let length = 0; length < whole.byteLength; length++) {
      const cut = new DataView(whole.buffer, whole.byteOffset, length);
      assert.throws(() => read(cut), { name: "Error" }, `${name} cut to ${length} bytes`);
    }
  }
});

test("a venue is read, with the lines of its court", () => {
  const bytes = golden("venue.json");
  const venue = readVenue(JSON.parse(new TextDecoder().decode(bytes)));
  assert.equal(venue.cameras.length, 8);
  assert.equal(venue.court?.name, "volleyball");
  assert.equal(venue.pictures, false);
  const lines = new Map(venue.court?.lines.map(({ name, points_m }) => [name, points_m]));
  assert.deepEqual(lines.get("side_line_north"), [[-9, 4.5], [9, 4.5]]);
  assert.deepEqual(lines.get("attack_line_west"), [[-3, -4.5], [-3, 4.5]]);
});
