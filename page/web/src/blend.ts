// The people of the drawn moment: blended between two ticks.

import { People } from "./protocol/ticks.ts";
import type { Moment } from "./player.ts";

/** A joint that moves by more than this between two ticks was moved, not seen moving: it is not blended. */
const MOST_STEP_M = 1;

export class Blender {
  private readonly before: People;
  private readonly after: People;
  private beforeView: DataView | null = null;
  private afterView: DataView | null = null;
  /** What is drawn. */
  readonly people: People;

  constructor(jointCount: number) {
    this.before = new People(jointCount);
    this.after = new People(jointCount);
    this.people = new People(jointCount);
  }

  /** Brings `people` to a moment. All but the joints is that of the later tick. */
  update(moment: Moment): void {
    if (moment.after !== this.afterView) {
      this.after.read(moment.after);
      this.afterView = moment.after;
    }
    if (moment.before !== this.beforeView) {
      this.before.read(moment.before);
      this.beforeView = moment.before;
    }
    this.copyHead();
    this.blendJoints(moment.share);
  }

  private copyHead(): void {
    const { people, after } = this;
    people.session = after.session;
    people.tick = after.tick;
    people.isLive = after.isLive;
    people.at_us = after.at_us;
    people.count = after.count;
    for (let i = 0; i < after.count; i++) {
      people.ids[i] = after.ids[i] ?? 0;
      people.states[i] = after.states[i] ?? 0;
      people.views[i] = after.views[i] ?? 0;
    }
    for (let i = 0; i < 2 * after.count; i++) {
      people.viewpoints[i] = after.viewpoints[i] ?? 0;
      people.unobserved[i] = after.unobserved[i] ?? 0;
      people.clamped[i] = after.clamped[i] ?? 0;
    }
  }

  private blendJoints(share: number): void {
    const { people, before, after } = this;
    const floats = 3 * people.jointCount;
    for (let i = 0; i < after.count; i++) {
      const to = i * floats;
      // The lists are in the same order in almost every tick: look there first.
      const id = after.ids[i] ?? 0;
      const other = before.ids[i] === id && i < before.count ? i : before.indexOf(id);
      const from = other < 0 || this.hasJumped(other * floats, to) ? -1 : other * floats;
      for (let k = 0; k < floats; k++) {
        const b = after.joints_m[to + k] ?? 0;
        const a = from < 0 ? b : (before.joints_m[from + k] ?? b);
        people.joints_m[to + k] = a + (b - a) * share;
      }
      for (let k = 0; k < people.jointCount; k++) {
        people.sigma_m[i * people.jointCount + k] = after.sigma_m[i * people.jointCount + k] ?? NaN;
      }
    }
  }

  private hasJumped(from: number, to: number): boolean {
    for (let axis = 0; axis < 3; axis++) {
      const step_m = (this.after.joints_m[to + axis] ?? 0) - (this.before.joints_m[from + axis] ?? 0);
      if (Math.abs(step_m) > MOST_STEP_M) return true;
    }
    return false;
  }
}
