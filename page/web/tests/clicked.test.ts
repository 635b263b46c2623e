// What was clicked, changed and taken back.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Past, countOf, forgotten, givenNames, isSame, kindOf, moved, nextName, pixelsOf, placed, problemOfName, removed, withFloor, withLength, withPlace } from "../src/marks/clicked.ts";
import type { Clicked, Court, PictureOfCamera } from "../src/marks/document.ts";

const NOTHING: Clicked = {
  court: "futsal",
  size_m: null,
  click_sigma_px: null,
  place_sigma_m: null,
  floor: [],
  places: {},
  lengths: [],
  camera: {},
};

const NORTH: PictureOfCamera = { name: "north", picture: "north.png", size_px: [1920, 1080], hasLens: false };

const COURT: Court = {
  name: "futsal",
  rules: "",
  size_m: [40, 20],
  marks: [
    { name: "corner_north_west", position_m: [-20, 10, 0] },
    { name: "corner_north_east", position_m: [20, 10, 0] },
    { name: "centre", position_m: [0, 0, 0] },
  ],
  lines: [{ name: "halfway_line", points_m: [[0, -10], [0, 10]] }],
};

test("a click on a point takes the place of the one before, on a line it comes to it", () => {
  const once = placed(NOTHING, "north", "centre", [1.234, 2], false);
  const twice = placed(once, "north", "centre", [3, 4], false);
  assert.deepEqual(pixelsOf(once, "north", "centre"), [[1.23, 2]]);
  assert.deepEqual(pixelsOf(twice, "north", "centre"), [[3, 4]]);
  const line = placed(placed(twice, "north", "halfway_line", [5, 6], true), "north", "halfway_line", [7, 8], true);
  assert.deepEqual(pixelsOf(line, "north", "halfway_line"), [[5, 6], [7, 8]]);
  assert.equal(countOf(line, "north"), 3);
  assert.equal(countOf(line, "south"), 0);
  assert.deepEqual(pixelsOf(removed(line, "north", "halfway_line", 0), "north", "halfway_line"), [[7, 8]]);
  assert.deepEqual(pixelsOf(moved(line, NORTH, "halfway_line", 1, [7.1, 8]), "north", "halfway_line"), [[5, 6], [7.1, 8]]);
  assert.equal(moved(line, NORTH, "halfway_line", 9, [0, 0]), line, "a click that is not there is not moved");
});

test("names are what the court or the file says they are", () => {
  const given = withLength(withFloor(withPlace(NOTHING, "door", [1, 2, 3]), "scratch"), ["red", "blue"], 1);
  const kinds = ["centre", "halfway_line", "door", "scratch", "blue", "toString", "nobody"].map((name) => kindOf(given, COURT, name));
  assert.deepEqual(kinds, ["mark", "line", "place", "floor", "length", null, null]);
  assert.deepEqual(givenNames(given), ["door", "scratch", "red", "blue"]);
});

test("a name that is forgotten takes its clicks and its lengths along, but not those of others", () => {
  let clicked = withLength(withLength(withFloor(NOTHING, "scratch"), ["red", "blue"], 1), ["blue", "scratch"], 2);
  for (const name of ["red", "blue", "scratch"]) clicked = placed(clicked, "north", name, [1, 1], false);
  const left = forgotten(clicked, COURT, "red");
  assert.deepEqual(left.lengths, [{ between: ["blue", "scratch"], length_m: 2 }]);
  assert.deepEqual(Object.keys(left.camera["north"] ?? {}).sort(), ["blue", "scratch"]);
  const less = forgotten(left, COURT, "blue");
  assert.deepEqual(less.lengths, []);
  assert.deepEqual(Object.keys(less.camera["north"] ?? {}), ["scratch"], "it is a point of the floor without the length");
});

test("a mark of the court at which a forgotten length ended keeps its clicks", () => {
  let clicked = withLength(NOTHING, ["red", "centre"], 3);
  for (const name of ["red", "centre"]) clicked = placed(clicked, "north", name, [1, 1], false);
  for (const name of ["red", "centre"]) {
    const left = forgotten(clicked, COURT, name);
    assert.deepEqual([left.lengths, Object.keys(left.camera["north"] ?? {})], [[], ["centre"]]);
  }
});

test("what is moved stays in its picture", () => {
  const clicked = placed(NOTHING, "north", "centre", [5, 6], false);
  const at = (to: [number, number]): unknown => pixelsOf(moved(clicked, NORTH, "centre", 0, to), "north", "centre")[0];
  assert.deepEqual(at([-30, 2000]), [-0.5, 1079.5]);
  assert.deepEqual(at([1919.504, 3.004]), [1919.5, 3]);
});

test("a name that no file takes is said before it is one", () => {
  for (const name of ["", " ", "a\u0007b", "x".repeat(65), "ä".repeat(33)]) assert.notEqual(problemOfName(name), null, name);
  for (const name of ["door post", "x".repeat(64), "☃"]) assert.equal(problemOfName(name), null, name);
});

test("what is clicked is the same in any order, and not where a click is another", () => {
  const one = placed(placed(NOTHING, "north", "centre", [1, 2], false), "south", "centre", [3, 4], false);
  const other = placed(placed(removed(one, "north", "centre", 0), "north", "centre", [1, 2], false), "west", "centre", [1, 1], false);
  assert.equal(isSame(one, removed(other, "west", "centre", 0)), true);
  assert.equal(isSame(one, other), false);
  assert.equal(isSame(one, moved(one, NORTH, "centre", 0, [1.01, 2])), false);
});

test("the next name is one without a click, and one that the picture shows", () => {
  const names = COURT.marks.map((mark) => mark.name);
  assert.equal(nextName(NOTHING, "north", names, null, null), "corner_north_west");
  const one = placed(NOTHING, "north", "corner_north_west", [1, 1], false);
  assert.equal(nextName(one, "north", names, "corner_north_west", null), "corner_north_east");
  assert.equal(nextName(one, "north", names, "corner_north_west", new Set(["centre"])), "centre");
  assert.equal(nextName(one, "north", names, "centre", null), "corner_north_east", "it begins again");
  assert.equal(nextName(one, "north", names, "centre", new Set()), null);
});

test("what is undone can be done again, until something else is done", () => {
  const past = new Past(2);
  const states = [0, 1, 2, 3].map((x) => placed(NOTHING, "north", "centre", [x, 0], false));
  const at = (i: number): Clicked => states[i] ?? NOTHING;
  for (const i of [0, 1, 2]) past.note(at(i));
  assert.equal(past.undo(at(3)), at(2));
  assert.equal(past.redo(at(2)), at(3));
  assert.equal(past.undo(at(3)), at(2));
  assert.equal(past.undo(at(2)), at(1));
  assert.equal(past.undo(at(1)), null, "of so many changes no more");
  past.note(at(1));
  assert.equal(past.canRedo, false);
});

test("what is taken back takes back what came after it", () => {
  const past = new Past();
  const states = [0, 1, 2, 3].map((x) => placed(NOTHING, "north", "centre", [x, 0], false));
  const at = (i: number): Clicked => states[i] ?? NOTHING;
  for (const i of [0, 1, 2]) past.note(at(i));
  past.backTo(at(1), at(3));
  assert.equal(past.undo(at(1)), at(0));
  assert.equal(past.canRedo, true);
  past.backTo(at(0), at(0));
  assert.deepEqual([past.canUndo, past.canRedo], [false, false]);
});

test("an undo that was refused can be tried again, and what was before it is not lost", () => {
  const past = new Past();
  const states = [0, 1, 2, 3, 4].map((x) => placed(NOTHING, "north", "centre", [x, 0], false));
  const at = (i: number): Clicked => states[i] ?? NOTHING;
  for (const i of [0, 1, 2, 3]) past.note(at(i));
  assert.equal(past.undo(at(4)), at(3));
  // Two more before the answer: all are back, and the redo of what was undone before stays.
  for (const i of [3, 2]) assert.equal(past.undo(at(i)), at(i - 1));
  past.backTo(at(3), at(1));
  for (const i of [3, 2, 1]) assert.equal(past.undo(at(i)), at(i - 1));
  assert.equal(past.canUndo, false);
  for (const i of [1, 2, 3, 4]) assert.equal(past.redo(at(i - 1)), at(i));
});
