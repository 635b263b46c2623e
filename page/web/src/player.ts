// Which moment is drawn. Ticks arrive unevenly; they are drawn evenly, a little late, and blended in between.
//
// The drawn tick moves at the measured rate of the ticks that come (of either sign: time can run backwards), and is pulled
// gently to where it should be. So neither jitter of the network nor a slow machine shows as stutter.

import { tickOf } from "./protocol/ticks.ts";

/** Ticks that are kept for blending: two seconds at 60 Hz. */
const KEPT = 128;
/** Arrivals from which rate and jitter are measured. */
const MEASURED = 32;
/** Behind the newest tick beyond the jitter, in ticks: so many must be there to blend between two. */
const BEHIND_TICKS = 1.2;
/** Most that the drawing may be late, seconds. */
const MOST_DELAY_S = 0.3;
/** How quickly an error of the drawn tick is corrected, per second. */
const PULL_PER_S = 4;
/** A jump of so many seconds of ticks is another moment, and not motion. */
const JUMP_S = 0.5;

/** Two messages and how far between them the drawn moment is. */
export interface Moment {
  before: DataView;
  after: DataView;
  share: number;
  /** The drawn tick, with its fraction. */
  tick: number;
}

export class Player {
  private readonly views: (DataView | null)[] = new Array<DataView | null>(KEPT).fill(null);
  private readonly ticks = new Float64Array(KEPT);
  private readonly arrivals_ms = new Float64Array(KEPT);
  private count = 0;
  private newest = -1;
  private shown = NaN;
  private lastFrame_ms = 0;
  private isStill = false;
  private readonly moment: { before: DataView | null; after: DataView | null; share: number; tick: number } = {
    before: null,
    after: null,
    share: 0,
    tick: 0,
  };

  constructor(private readonly rate_hz: number) {}

  /** The tick that is drawn, NaN before the first. */
  get tick(): number {
    return this.shown;
  }

  /** Paused: what arrives is drawn as it is. */
  setStill(isStill: boolean): void {
    if (isStill === this.isStill) return;
    this.isStill = isStill;
    this.forgetAllButNewest();
  }

  /** Forgets everything, as after a change of session. */
  clear(): void {
    this.count = 0;
    this.shown = NaN;
    this.views.fill(null);
  }

  /** Takes a message of kind 1. */
  push(view: DataView, now_ms: number): void {
    const tick = tickOf(view);
    if (this.count > 0) {
      const step = tick - this.tickAt(0);
      const direction = this.count > 1 ? Math.sign(this.tickAt(0) - this.tickAt(1)) : Math.sign(step);
      const isJump = Math.abs(step) > JUMP_S * this.rate_hz || step * direction < 0;
      if (isJump || this.isStill) {
        this.count = 0;
        this.shown = tick;
      } else if (step === 0) return;
    } else this.shown = tick;
    this.newest = (this.newest + 1) % KEPT;
    this.views[this.newest] = view;
    this.ticks[this.newest] = tick;
    this.arrivals_ms[this.newest] = now_ms;
    this.count = Math.min(KEPT, this.count + 1);
  }

  /** The moment to draw now; `null` while nothing has come. */
  at(now_ms: number): Moment | null {
    const elapsed_s = Math.min(0.1, (now_ms - this.lastFrame_ms) / 1000);
    this.lastFrame_ms = now_ms;
    if (this.count === 0) return null;
    if (!this.isStill && this.count > 2) this.advance(now_ms, elapsed_s);
    return this.find();
  }

  private advance(now_ms: number, elapsed_s: number): void {
    const n = Math.min(this.count, MEASURED);
    const span_s = (this.arrivalAt(0) - this.arrivalAt(n - 1)) / 1000;
    if (span_s <= 0) return;
    const perSecond = (this.tickAt(0) - this.tickAt(n - 1)) / span_s;
    const sign = Math.sign(perSecond);
    // How far each arrival is ahead of an even run of ticks: the spread is the jitter.
    let most = -Infinity;
    let least = Infinity;
    for (let i = 0; i < n; i++) {
      const ahead = sign * (this.tickAt(i) - perSecond * ((this.arrivalAt(i) - now_ms) / 1000));
      most = Math.max(most, ahead);
      least = Math.min(least, ahead);
    }
    const behind = Math.min(most - least + BEHIND_TICKS, MOST_DELAY_S * Math.abs(perSecond) + BEHIND_TICKS);
    const target = sign * (most - behind);
    const next = this.shown + perSecond * elapsed_s;
    const error = target - next;
    this.shown = Math.abs(error) > JUMP_S * Math.abs(perSecond) ? target : next + error * Math.min(1, PULL_PER_S * elapsed_s);
    if (sign * (this.shown - this.tickAt(0)) > 0) this.shown = this.tickAt(0);
  }

  /** The two messages around the drawn tick, the newest first: the search ends after a few. */
  private find(): Moment | null {
    let after = 0;
    const sign = this.count > 1 ? Math.sign(this.tickAt(0) - this.tickAt(1)) : 1;
    while (after + 1 < this.count && sign * (this.tickAt(after + 1) - this.shown) > 0) after++;
    const before = Math.min(after + 1, this.count - 1);
    const from = this.tickAt(before);
    const to = this.tickAt(after);
    this.moment.before = this.viewAt(before);
    this.moment.after = this.viewAt(after);
    this.moment.share = from === to ? 1 : Math.min(1, Math.max(0, (this.shown - from) / (to - from)));
    this.moment.tick = this.shown;
    return this.moment.before === null || this.moment.after === null ? null : (this.moment as Moment);
  }

  private forgetAllButNewest(): void {
    if (this.count === 0) return;
    this.count = 1;
    this.shown = this.tickAt(0);
  }

  /** `back` arrivals before the newest. */
  private slot(back: number): number {
    return (this.newest - back + KEPT) % KEPT;
  }

  private tickAt(back: number): number {
    return this.ticks[this.slot(back)] ?? 0;
  }

  private arrivalAt(back: number): number {
    return this.arrivals_ms[this.slot(back)] ?? 0;
  }

  private viewAt(back: number): DataView | null {
    return this.views[this.slot(back)] ?? null;
  }
}
