// Drawn evenly, whatever the network does.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Player } from "../src/player.ts";

const RATE_HZ = 60;

function message(tick: number): DataView {
  const view = new DataView(new ArrayBuffer(48));
  view.setBigInt64(8, BigInt(tick), true);
  return view;
}

/** A repeatable number from 0 to 1. */
function jitter(n: number): number {
  const x = Math.sin(n * 12.9898) * 43758.5453;
  return x - Math.floor(x);
}

/** Ticks as they are drawn at 60 frames a second, of ticks that arrive `late_ms(tick)` after their time. */
function drawn(frames: number, speed: number, late_ms: (tick: number) => number): number[] {
  const player = new Player(RATE_HZ);
  const arrivals = Array.from({ length: frames * Math.abs(speed) + 1 }, (_, i) => {
    const tick = 1000 + Math.sign(speed) * i;
    return { tick, at_ms: (i * 1000) / (RATE_HZ * Math.abs(speed)) + late_ms(tick) };
  });
  const ticks: number[] = [];
  for (let frame = 0; frame < frames; frame++) {
    const now_ms = (frame * 1000) / 60;
    while (arrivals[0] !== undefined && arrivals[0].at_ms <= now_ms) {
      player.push(message(arrivals[0].tick), arrivals[0].at_ms);
      arrivals.shift();
    }
    const moment = player.at(now_ms);
    if (moment !== null) ticks.push(moment.tick);
  }
  return ticks;
}

/** Steps from frame to frame once it has settled. */
function steps(ticks: readonly number[]): number[] {
  return ticks.slice(121).map((tick, i) => tick - (ticks[120 + i] ?? tick));
}

test("ticks that arrive with jitter are drawn in even steps", () => {
  for (const step of steps(drawn(600, 1, (tick) => 20 * jitter(tick)))) {
    assert.ok(step > 0.6 && step < 1.4, `a step of ${step} ticks`);
  }
});

test("the drawing is late by the jitter and a tick or two, not more", () => {
  const ticks = drawn(600, 1, (tick) => 20 * jitter(tick));
  const behind = 1000 + 599 - (ticks[ticks.length - 1] ?? 0);
  assert.ok(behind > 0 && behind < 5, `${behind} ticks behind`);
});

test("time runs backwards and slowly as evenly", () => {
  for (const step of steps(drawn(600, -1, (tick) => 10 * jitter(tick)))) {
    assert.ok(step < -0.6 && step > -1.4, `a step of ${step} ticks`);
  }
});

test("a pause of the network is drawn as a stop, and never ahead of what has come", () => {
  const ticks = drawn(600, 1, (tick) => (tick > 1300 && tick < 1330 ? ((1330 - tick) * 1000) / RATE_HZ : 0));
  ticks.forEach((tick, i) => assert.ok(tick <= 1000 + i + 1, `tick ${tick} at frame ${i}`));
  assert.ok(steps(ticks).every((step) => step >= -1e-9), "time does not jump back");
});

test("another moment is gone to at once", () => {
  const player = new Player(RATE_HZ);
  for (let i = 0; i < 60; i++) {
    player.push(message(1000 + i), (i * 1000) / 60);
    player.at((i * 1000) / 60);
  }
  player.push(message(400), 1000);
  assert.equal(player.at(1000)?.tick, 400);
});

test("while it is paused the tick that came is drawn as it is", () => {
  const player = new Player(RATE_HZ);
  for (let i = 0; i < 10; i++) player.push(message(i), i * 16);
  player.setStill(true);
  player.push(message(7), 500);
  assert.equal(player.at(520)?.tick, 7);
  assert.equal(player.at(540)?.share, 1);
});

test("nothing is drawn before anything came", () => {
  assert.equal(new Player(RATE_HZ).at(0), null);
});
