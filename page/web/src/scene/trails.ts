// Trails: where people's pelvises were in the last seconds, on the floor.

import { BufferAttribute, BufferGeometry, DynamicDrawUsage, LineBasicMaterial, LineSegments } from "three";
import { personColour } from "../palette.ts";
import type { People } from "../protocol/ticks.ts";

/** Points of a trail; at the spacing below about four seconds of running. */
const POINTS = 48;
/** Persons that have a trail at once. */
const SLOTS = 96;
/** A new point is set after so many seconds of ticks. */
const EVERY_S = 0.08;
/** A person who is away for longer than this, seconds of ticks, begins a new trail. */
const GAP_S = 0.5;

interface Slot {
  id: number;
  count: number;
  next: number;
  lastTick: number;
}

export class Trails {
  readonly lines: LineSegments;
  private readonly slots: Slot[] = [];
  private readonly xy = new Float32Array(SLOTS * POINTS * 2);
  private readonly positions = new BufferAttribute(new Float32Array(SLOTS * POINTS * 2 * 3), 3);
  private readonly colours = new BufferAttribute(new Uint8Array(SLOTS * POINTS * 2 * 4), 4, true);
  private lastTick = NaN;
  private session = 0;

  constructor(
    private readonly floor_m: number,
    private readonly rate_hz: number,
    private readonly pelvis: number,
  ) {
    for (let i = 0; i < SLOTS; i++) this.slots.push({ id: -1, count: 0, next: 0, lastTick: 0 });
    this.positions.setUsage(DynamicDrawUsage);
    this.colours.setUsage(DynamicDrawUsage);
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", this.positions);
    geometry.setAttribute("color", this.colours);
    const material = new LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false });
    this.lines = new LineSegments(geometry, material);
    this.lines.frustumCulled = false;
  }

  /** Takes the people of the drawn moment; cheap unless a point is due. */
  update(people: People, tick: number, followed: number | null): void {
    const elapsed = tick - this.lastTick;
    if (people.session !== this.session || Math.abs(elapsed) > GAP_S * this.rate_hz || Number.isNaN(elapsed)) {
      for (const slot of this.slots) slot.id = -1;
      this.session = people.session;
    } else if (Math.abs(elapsed) < EVERY_S * this.rate_hz) return;
    this.lastTick = tick;
    for (const slot of this.slots) {
      if (slot.id >= 0 && Math.abs(tick - slot.lastTick) > GAP_S * this.rate_hz) slot.id = -1;
    }
    for (let i = 0; i < people.count; i++) this.addPoint(people, i, tick);
    this.draw(followed);
  }

  private addPoint(people: People, person: number, tick: number): void {
    const id = people.ids[person] ?? 0;
    let at = -1;
    let free = -1;
    for (let s = 0; s < SLOTS && at < 0; s++) {
      const other = this.slots[s]?.id;
      if (other === id) at = s;
      else if (other === -1 && free < 0) free = s;
    }
    const index = at < 0 ? free : at;
    const slot = this.slots[index];
    if (slot === undefined) return;
    if (at < 0) {
      slot.id = id;
      slot.count = 0;
      slot.next = 0;
    }
    const joint = 3 * (person * people.jointCount + this.pelvis);
    const point = 2 * (index * POINTS + slot.next);
    this.xy[point] = people.joints_m[joint] ?? 0;
    this.xy[point + 1] = people.joints_m[joint + 1] ?? 0;
    slot.next = (slot.next + 1) % POINTS;
    slot.count = Math.min(POINTS, slot.count + 1);
    slot.lastTick = tick;
  }

  private draw(followed: number | null): void {
    let vertex = 0;
    for (let s = 0; s < SLOTS; s++) {
      const slot = this.slots[s];
      if (slot === undefined || slot.id < 0 || (followed !== null && slot.id !== followed)) continue;
      const colour = personColour(slot.id);
      for (let k = 1; k < slot.count; k++) {
        this.setVertex(vertex++, s, slot, k, colour);
        this.setVertex(vertex++, s, slot, k - 1, colour);
      }
    }
    this.lines.geometry.setDrawRange(0, vertex);
    for (const attribute of [this.positions, this.colours]) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, vertex * attribute.itemSize);
      attribute.needsUpdate = true;
    }
  }

  private setVertex(vertex: number, s: number, slot: Slot, back: number, colour: number): void {
    const point = 2 * (s * POINTS + ((slot.next - 1 - back + 2 * POINTS) % POINTS));
    const positions = this.positions.array;
    positions[3 * vertex] = this.xy[point] ?? 0;
    positions[3 * vertex + 1] = this.xy[point + 1] ?? 0;
    positions[3 * vertex + 2] = this.floor_m + 0.012;
    const colours = this.colours.array;
    colours[4 * vertex] = (colour >> 16) & 255;
    colours[4 * vertex + 1] = (colour >> 8) & 255;
    colours[4 * vertex + 2] = colour & 255;
    colours[4 * vertex + 3] = Math.round(255 * (1 - back / POINTS));
  }
}
