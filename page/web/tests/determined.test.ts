// What nothing determines must not look as sure as what was seen.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Determined } from "../src/determined.ts";
import { People } from "../src/protocol/ticks.ts";

const JOINTS = ["pelvis", "head", "nose", "left_elbow", "left_wrist", "left_hand", "left_knee", "left_ankle", "left_heel", "left_toe"];
// More than 32 angles, as the model has: those of the left arm are in the upper half of the bits.
const FILLER = Array.from({ length: 30 }, (_, i) => `filler_${i}`);
const ANGLES = [
  "neck_flexion", "neck_bending", "neck_rotation", "ankle_angle_l", "subtalar_angle_l", "knee_angle_l",
  ...FILLER, "arm_flex_l", "arm_add_l", "arm_rot_l", "elbow_flex_l", "hip_flexion_l", "hip_adduction_l",
];

const venue = {
  joints: JOINTS.map((name) => ({ name, parent: null })),
  angles: ANGLES.map((name) => ({ name, unit: "rad" as const, range: null })),
};

/** The joints of the second of two people that are guesses, where a prior carries these angles. */
function guesses(angles: readonly string[], sigma_m: (joint: string) => number = () => 0.02): string[] {
  const people = new People(JOINTS.length);
  people.count = 2;
  for (const angle of angles) {
    const bit = ANGLES.indexOf(angle);
    assert.ok(bit >= 0, angle);
    people.unobserved[2 + (bit >> 5)]! |= 1 << (bit & 31);
  }
  JOINTS.forEach((joint, j) => (people.sigma_m[JOINTS.length + j] = sigma_m(joint)));
  const determined = new Determined(venue);
  assert.ok(JOINTS.every((_, j) => !determined.isGuess(people, 0, j)), "the first person is seen");
  return JOINTS.filter((_, j) => determined.isGuess(people, 1, j));
}

test("a body of which everything is seen has no guesses", () => {
  assert.deepEqual(guesses([]), []);
});

test("heel and toe are guesses where no keypoint is on the foot, and the ankle is not", () => {
  assert.deepEqual(guesses(["ankle_angle_l", "subtalar_angle_l"]), ["left_heel", "left_toe"]);
});

test("a forearm whose bend is not observed is a guess from the elbow on", () => {
  assert.deepEqual(guesses(["elbow_flex_l"]), ["left_wrist", "left_hand"]);
});

test("a link is a guess when none of the angles that turn it is observed; its twist moves nothing", () => {
  assert.deepEqual(guesses(["arm_flex_l", "arm_rot_l"]), []);
  assert.deepEqual(guesses(["arm_flex_l", "arm_add_l"]), ["left_elbow"]);
  assert.deepEqual(guesses(["neck_flexion", "neck_rotation"]), []);
  assert.deepEqual(guesses(["neck_flexion", "neck_bending", "neck_rotation"]), ["head", "nose"]);
});

test("a joint whose deviation is as large as a limb is thick is a guess, and one of which it is not known yet is none", () => {
  assert.deepEqual(guesses([], (joint) => (joint === "pelvis" ? 0.102 : 0.1)), ["pelvis"]);
  assert.deepEqual(guesses([], () => NaN), []);
});

test("a model with other joints and angles has guesses by their deviations alone", () => {
  const people = new People(1);
  people.count = 1;
  people.unobserved[0] = 0xffffffff;
  const determined = new Determined({ joints: [{ name: "hub", parent: null }], angles: [] });
  assert.equal(determined.isGuess(people, 0, 0), false);
  people.sigma_m[0] = 0.3;
  assert.equal(determined.isGuess(people, 0, 0), true);
});
