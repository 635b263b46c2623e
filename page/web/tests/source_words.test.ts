// What is said must be true of what is shown: a run, one that is over, a replay, a recording.

import assert from "node:assert/strict";
import { test } from "node:test";
import type { ConnectionState } from "../src/connection.ts";
import { alarmsOf } from "../src/panels/alarms.ts";
import { stateOf } from "../src/panels/header.ts";
import { viewCount } from "../src/panels/people.ts";
import { momentText } from "../src/panels/timeline.ts";
import { isPast, type PageState } from "../src/state.ts";

const ENDED = { key: "run/ended", severity: "warning", text: "the run has ended", remedy: "nothing is wrong", since_us: 5 };
const SILENT = { key: "node/ne", severity: "failed", text: "edge ne has not been heard for 4 s", remedy: "look", since_us: 5 };

function page(mode: string, connection: ConnectionState, alarms: readonly object[] = [], playback = "live"): PageState {
  return {
    venue: { mode, rate_hz: 50, viewpoints: [{}, {}, {}, {}] },
    connection,
    status: { alarms },
    hasRunEnded: alarms.includes(ENDED),
    playback: { state: playback },
    people: { views: [3, 0] },
    unreadable: 0,
  } as unknown as PageState;
}

const OPEN: ConnectionState = { kind: "open" };
const lost: ConnectionState = { kind: "away", since_ms: 7, reason: "it is silent", isEnded: false };
const stopped: ConnectionState = { ...lost, isEnded: true };

// Symptom: a run of recordings that had ended as it should was a red "Nothing comes from fusion".
test("after a run has said that it is over nothing is wrong, whether or not the server said goodbye", () => {
  for (const connection of [lost, stopped]) {
    const state = page("live", connection, [ENDED]);
    assert.deepEqual(stateOf(state), ["The run has ended", "past"]);
    const [alarm, ...rest] = alarmsOf(state);
    assert.deepEqual([alarm?.isFailed, alarm?.text, rest], [false, "The run has ended", []]);
  }
});

test("who looks back while the run ends is told so all the same", () => {
  const state = page("live", lost, [], "paused");
  state.hasRunEnded = true;
  assert.equal(stateOf(state)[0], "The run has ended");
});

test("a fusion from which nothing comes, and nobody knows why, is a failure", () => {
  const state = page("live", lost, []);
  assert.deepEqual(stateOf(state), ["Fusion is away", "failed"]);
  assert.match(alarmsOf(state)[0]?.text ?? "", /^Nothing comes from fusion: it is silent/);
  assert.equal(alarmsOf(state)[0]?.isFailed, true);
});

test("a fusion that was told to stop is none", () => {
  assert.deepEqual(stateOf(page("live", stopped, [])), ["The run has ended", "past"]);
});

test("what failed before a run was over is told beside its end", () => {
  const state = page("live", lost, [SILENT, ENDED]);
  assert.deepEqual(alarmsOf(state).map((alarm) => alarm.key), ["here/away", "node/ne"]);
});

// Symptom: a recording that was solved again was "All is well", and was said to happen now.
test("a replay says of itself what it is, and nothing of what it is not told", () => {
  const state = page("replay", OPEN);
  assert.deepEqual(stateOf(state), ["Replay", "past"]);
  assert.equal(momentText(state, true, 250, 0, 250), "0:05.0");
  assert.equal(momentText(state, false, 100, 50, 250), "0:02.0");
  assert.deepEqual(stateOf(page("replay", stopped)), ["The replay was ended", "past"]);
  assert.deepEqual(stateOf(page("replay", lost)), ["The replay is away", "failed"]);
  assert.equal(isPast(page("replay", OPEN, [], "paused")), true);
});

test("of a replay it is told how many viewpoints saw somebody, since nobody says which", () => {
  const state = page("replay", OPEN);
  assert.equal(viewCount(state, 0), "seen by 3 of 4 viewpoints");
  assert.equal(viewCount(state, 1), "seen by no viewpoint");
});

test("what was wrong in a recording was wrong then", () => {
  assert.deepEqual(stateOf(page("recording", OPEN)), ["Then: ✓ all was well", "past"]);
  assert.equal(stateOf(page("recording", OPEN, [SILENT], "playing"))[0], "Then: ✕ 1 failure");
  assert.equal(momentText(page("recording", OPEN), false, 150, 50, 250), "0:02.0");
});

test("live, a moment is now, the end, or so long ago", () => {
  assert.equal(momentText(page("live", OPEN), true, 250, 0, 250), "now");
  assert.equal(momentText(page("live", OPEN), false, 200, 0, 250), "−0:01.0");
  assert.equal(momentText(page("live", lost), true, 250, 0, 250), "the last that came");
  assert.equal(momentText(page("live", lost, [ENDED]), true, 250, 0, 250), "the end");
});
