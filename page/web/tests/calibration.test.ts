// What the page makes of what the server says of the calibration.

import assert from "node:assert/strict";
import { test } from "node:test";
import { readCalibration } from "../src/protocol/calibration.ts";

const KEY = "0123456789abcdef0123456789abcdef";

test("a sheet of this calibration, of another, and one that does not say are told apart", () => {
  for (const isOfThis of [true, false, null]) {
    const sheet = { file: "calibration.html", fingerprint: null, is_of_this: isOfThis, path: `/calibration/${KEY}` };
    const read = readCalibration({ file: "calibration.toml", fingerprint: "", text: "", sheet });
    assert.equal(read.sheet?.isOfThis, isOfThis);
  }
  assert.equal(readCalibration({ file: "", text: "There is none.", sheet: null }).sheet, null);
});

test("only a path of this server becomes a link", () => {
  for (const path of ["javascript:alert(1)", "//stranger.example/calibration/", `https://x/calibration/${KEY}`, `/calibration/${KEY}/x`]) {
    const sheet = { file: "", is_of_this: true, path };
    assert.equal(readCalibration({ file: "", text: "", sheet }).sheet, null, path);
  }
});
