// Numbers as people read them.

import assert from "node:assert/strict";
import { test } from "node:test";
import { readings } from "../src/angle_names.ts";
import { AngleSeries } from "../src/charts/series.ts";
import { delayText, labelPlaces } from "../src/charts/latency_chart.ts";
import { roundStep } from "../src/charts/pen.ts";
import { sigmaShare, viridis } from "../src/palette.ts";
import { byteCount, clockTime, milliseconds, wholeSeconds } from "../src/units.ts";

const angle = (name: string, unit: "rad" | "m" = "rad") => ({ name, unit, range: null });

test("flexion is positive, also where fusion reports extension", () => {
  const [trunk, knee] = readings([angle("lumbar_extension"), angle("knee_angle_r")]);
  assert.equal(trunk?.name, "Trunk flexion");
  assert.ok((trunk?.degreesPerRadian ?? 0) < 0);
  assert.equal(knee?.name, "Right knee flexion");
  assert.ok((knee?.degreesPerRadian ?? 0) > 57.29 && (knee?.degreesPerRadian ?? 0) < 57.3);
});

test("lengths are not charted as angles, and an angle that this page does not know keeps its name", () => {
  const found = readings([angle("pelvis_tx", "m"), angle("wrist_flex_l")]);
  assert.deepEqual(found.map(({ name, index }) => [name, index]), [["Left wrist flex", 1]]);
});

test("a series keeps its newest values, in order, in memory that does not grow", () => {
  const series = new AngleSeries(2);
  for (let tick = 0; tick < 5000; tick++) series.push(tick, (a) => tick + a / 2);
  assert.equal(series.length, 2048);
  assert.equal(series.tickAt(0), 5000 - 2048);
  assert.equal(series.lastTick, 4999);
  assert.equal(series.valueAt(2047, 1), 4999.5);
  series.push(100, () => 0);
  assert.equal(series.length, 1);
});

test("the key of certainty is logarithmic and bounded", () => {
  assert.equal(sigmaShare(0.001), 0);
  assert.equal(sigmaShare(1), 1);
  assert.ok(Math.abs(sigmaShare(Math.sqrt(0.005 * 0.1)) - 0.5) < 1e-12);
  assert.equal(viridis(0), 0x414487);
  assert.equal(viridis(1), 0xfde725);
});

test("labels of two lines never lie on each other, however close the lines are", () => {
  assert.deepEqual(labelPlaces(20, 60, 100), [18, 58]);
  for (const [p99, p50] of [[50, 50], [50, 52], [50, 60], [3, 5], [97, 99], [0, 0]] as const) {
    const [upper, lower] = labelPlaces(p99, p50, 100);
    assert.ok(lower - upper >= 13 && upper >= 13 && lower <= 100, `${p99} ${p50}: ${upper} ${lower}`);
  }
  // One of them alone, where the other is not known.
  assert.equal(labelPlaces(NaN, 60, 100)[1], 58);
});

test("times and sizes are short", () => {
  assert.equal(clockTime(-61.04), "−1:01.0");
  assert.equal(clockTime(59.96), "1:00.0");
  assert.equal(wholeSeconds(59.9), "0:59");
  assert.equal(wholeSeconds(3725), "1:02:05");
  assert.equal(milliseconds(null), "–");
  assert.equal(milliseconds(41_000), "41 ms");
  assert.equal(byteCount(125_000), "125 kB");
  assert.equal(roundStep(90, 5), 20);
});

test("delays at an axis have room for their unit", () => {
  assert.equal(delayText(50_000, 200_000), "50 ms");
  assert.equal(delayText(1_500_000, 2_000_000), "1.5 s");
});
