// The binary messages: the people of a tick, what a camera sees, chosen angles. Layouts are in docs/page.md.
//
// Everything is read into arrays that are made once, so that 60 people at 60 ticks a second leave no garbage behind.

import { PROTOCOL } from "./venue.ts";
import { ProtocolError } from "./checked.ts";

export const KIND_PEOPLE = 1;
export const KIND_CAMERA = 2;
export const KIND_ANGLES = 3;

/** Most persons of a tick that are drawn; the server tracks no more. */
export const MOST_PERSONS = 256;
const MOST_KEYPOINTS = 255;
const HEAD_BYTES = 48;
const PERSON_HEAD_BYTES = 32;
const SIGMA_STEP_M = 0.002;
const SIGMA_MORE = 254;
const SIGMA_UNKNOWN = 255;
const NOT_IN_PICTURE = -32768;

export const TENTATIVE = 0;
export const TRACKED = 1;
export const COASTING = 2;

/** Kind of a binary message, or 0 of one that this page cannot read. */
export function kindOf(view: DataView): number {
  return view.byteLength >= 2 && view.getUint8(0) === PROTOCOL ? view.getUint8(1) : 0;
}

/** The tick of a message of kind 1, without reading the rest. */
export function tickOf(view: DataView): number {
  return Number(view.getBigInt64(8, true));
}

/** The session of any binary message. */
export function sessionOf(view: DataView): number {
  return view.getUint32(4, true);
}

/** Whether a prior carried an angle of a person, from a message of kind 1 without reading the rest. */
export function unobservedOf(view: DataView, person: number, angle: number): boolean {
  const count = headCount(view);
  const stride = view.getUint8(43) * 4;
  for (let at = HEAD_BYTES; at + stride <= view.byteLength && at < HEAD_BYTES + count * stride; at += stride) {
    if (view.getUint32(at, true) !== person) continue;
    return ((view.getUint32(at + 16 + 4 * (angle >> 5), true) >>> (angle & 31)) & 1) !== 0;
  }
  return false;
}

/** The people of one tick, person by person in parallel arrays; only the first `count` are meant. */
export class People {
  session = 0;
  tick = -1;
  isLive = false;
  at_us = 0;
  count = 0;
  readonly ids = new Uint32Array(MOST_PERSONS);
  readonly states = new Uint8Array(MOST_PERSONS);
  readonly views = new Uint8Array(MOST_PERSONS);
  /** Bits 0 to 31 and 32 to 63 of viewpoints that sent maps; of angles that a prior carried; of angles at a bound. */
  readonly viewpoints = new Uint32Array(2 * MOST_PERSONS);
  readonly unobserved = new Uint32Array(2 * MOST_PERSONS);
  readonly clamped = new Uint32Array(2 * MOST_PERSONS);
  /** x, y, z of each joint, world, metres. */
  readonly joints_m: Float32Array;
  /** One standard deviation per joint, metres; NaN where it is not known. */
  readonly sigma_m: Float32Array;

  constructor(readonly jointCount: number) {
    this.joints_m = new Float32Array(MOST_PERSONS * jointCount * 3);
    this.sigma_m = new Float32Array(MOST_PERSONS * jointCount).fill(NaN);
  }

  /** Position of a person in the arrays, or -1. */
  indexOf(id: number): number {
    for (let i = 0; i < this.count; i++) if (this.ids[i] === id) return i;
    return -1;
  }

  /** Reads a message of kind 1. People whose joints are not known are left out: there is nothing to draw. */
  read(view: DataView): void {
    const count = headCount(view);
    const joints = view.getUint8(42);
    const stride = view.getUint8(43) * 4;
    if (joints !== this.jointCount) throw new ProtocolError(`${joints} joints, expected ${this.jointCount}`);
    if (stride < PERSON_HEAD_BYTES + 7 * joints) throw new ProtocolError(`${stride} bytes a person are too few`);
    if (view.byteLength < HEAD_BYTES + count * stride) throw new ProtocolError("a tick that ends in a person");
    this.isLive = (view.getUint16(2, true) & 1) !== 0;
    this.session = view.getUint32(4, true);
    this.tick = tickOf(view);
    this.at_us = Number(view.getBigInt64(16, true));
    this.count = 0;
    for (let i = 0; i < count; i++) this.readPerson(view, HEAD_BYTES + i * stride);
  }

  private readPerson(view: DataView, at: number): void {
    if ((view.getUint8(at + 5) & 1) === 0 || this.count >= MOST_PERSONS) return;
    const i = this.count++;
    this.ids[i] = view.getUint32(at, true);
    this.states[i] = view.getUint8(at + 4);
    this.views[i] = Math.min(255, view.getUint16(at + 6, true));
    for (let half = 0; half < 2; half++) {
      this.viewpoints[2 * i + half] = view.getUint32(at + 8 + 4 * half, true);
      this.unobserved[2 * i + half] = view.getUint32(at + 16 + 4 * half, true);
      this.clamped[2 * i + half] = view.getUint32(at + 24 + 4 * half, true);
    }
    const step_m = view.getFloat32(36, true);
    const first = i * this.jointCount;
    for (let axis = 0; axis < 3; axis++) {
      const origin_m = view.getFloat32(24 + 4 * axis, true);
      for (let j = 0; j < this.jointCount; j++) {
        const steps = view.getInt16(at + PERSON_HEAD_BYTES + 2 * (3 * j + axis), true);
        this.joints_m[3 * (first + j) + axis] = origin_m + step_m * steps;
      }
    }
    for (let j = 0; j < this.jointCount; j++) {
      const sigma = view.getUint8(at + PERSON_HEAD_BYTES + 6 * this.jointCount + j);
      this.sigma_m[first + j] = sigma === SIGMA_UNKNOWN ? NaN : Math.min(sigma, SIGMA_MORE) * SIGMA_STEP_M;
    }
  }
}

/** Count of persons, once the head is whole and its numbers are finite. */
function headCount(view: DataView): number {
  if (kindOf(view) !== KIND_PEOPLE || view.byteLength < HEAD_BYTES) throw new ProtocolError("no message of people");
  for (let at = 24; at < 40; at += 4) {
    if (!Number.isFinite(view.getFloat32(at, true))) throw new ProtocolError("an origin or step that is not finite");
  }
  return view.getUint16(40, true);
}

/** Whether a bit of a pair of 32-bit halves is set. */
export function bitOf(halves: Uint32Array, person: number, bit: number): boolean {
  return (((halves[2 * person + (bit >> 5)] ?? 0) >>> (bit & 31)) & 1) !== 0;
}

/** A person or sighting as one camera sees it. */
export interface InCamera {
  /** 0 of a sighting. */
  id: number;
  isSighting: boolean;
  hasBox: boolean;
  /** Whether the edge chose this camera for the person. */
  isChosen: boolean;
  centre_px: [number, number];
  size_px: [number, number];
  /** From +x to +y. */
  rotation_rad: number;
  /** x, y per keypoint, NaN where it is not in the picture. */
  keypoints_px: Float32Array;
}

export interface CameraView {
  camera: number;
  tick: number;
  entries: InCamera[];
}

/** Reads a message of kind 2. Of one camera at a time, so that it may allocate. */
export function readCameraView(view: DataView): CameraView {
  if (kindOf(view) !== KIND_CAMERA || view.byteLength < 24) throw new ProtocolError("no message of a camera");
  const persons = view.getUint16(16, true);
  const sightings = view.getUint16(18, true);
  const keypoints = Math.min(MOST_KEYPOINTS, view.getUint8(20));
  const personBytes = 28 + 4 * keypoints;
  const sightingBytes = 4 + 4 * keypoints;
  const sightingsAt = 24 + persons * personBytes;
  if (view.byteLength < sightingsAt + sightings * sightingBytes) {
    throw new ProtocolError("a camera's message that ends too early");
  }
  const entries: InCamera[] = [];
  for (let i = 0; i < persons; i++) entries.push(readInCamera(view, 24 + i * personBytes, keypoints));
  for (let i = 0; i < sightings; i++) {
    const keypoints_px = readKeypoints(view, sightingsAt + i * sightingBytes + 4, keypoints);
    entries.push({ ...NOBODY, centre_px: [0, 0], size_px: [0, 0], keypoints_px });
  }
  return { camera: view.getUint16(2, true), tick: tickOf(view), entries };
}

const NOBODY = { id: 0, isSighting: true, hasBox: false, isChosen: false, rotation_rad: 0 };

function readInCamera(view: DataView, at: number, keypoints: number): InCamera {
  const flags = view.getUint8(at + 4);
  const box = [8, 12, 16, 20, 24].map((offset) => view.getFloat32(at + offset, true));
  const [x = 0, y = 0, width = 0, height = 0, rotation_rad = 0] = box;
  return {
    id: view.getUint32(at, true),
    isSighting: false,
    hasBox: (flags & 1) !== 0 && box.every(Number.isFinite),
    isChosen: (flags & 2) !== 0,
    centre_px: [x, y],
    size_px: [width, height],
    rotation_rad,
    keypoints_px: readKeypoints(view, at + 28, (flags & 4) === 0 ? 0 : keypoints),
  };
}

function readKeypoints(view: DataView, at: number, count: number): Float32Array {
  const keypoints_px = new Float32Array(2 * count);
  for (let i = 0; i < 2 * count; i++) {
    const quarter = view.getInt16(at + 2 * i, true);
    keypoints_px[i] = quarter === NOT_IN_PICTURE ? NaN : quarter / 4;
  }
  return keypoints_px;
}

export interface ChosenAngles {
  session: number;
  tick: number;
  persons: { id: number; values: Float32Array }[];
}

/** Reads a message of kind 3. */
export function readChosenAngles(view: DataView): ChosenAngles {
  if (kindOf(view) !== KIND_ANGLES || view.byteLength < 24) throw new ProtocolError("no message of angles");
  const count = view.getUint16(2, true);
  const angles = view.getUint8(16);
  const stride = 4 + 4 * angles;
  if (view.byteLength < 24 + count * stride) throw new ProtocolError("a message of angles that ends too early");
  const persons = [];
  for (let i = 0; i < count; i++) {
    const at = 24 + i * stride;
    const values = new Float32Array(angles);
    for (let a = 0; a < angles; a++) values[a] = view.getFloat32(at + 4 + 4 * a, true);
    persons.push({ id: view.getUint32(at, true), values });
  }
  return { session: view.getUint32(4, true), tick: tickOf(view), persons };
}
