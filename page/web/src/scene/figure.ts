// The figure of a person: which rounded limbs are drawn between which joints, how thick they are and how flat.
//
// Thicknesses are for looks, those of an average adult; lengths are the person's own, since both ends are joints.

import type { Venue } from "../protocol/venue.ts";

/** A limb: a capsule with a radius at each end, flattened from front to back. */
export interface Limb {
  /** Positions of the joints at its ends. Where `extend` is not 0, the second end lies that far beyond `to`, as a share. */
  readonly from: number;
  readonly to: number;
  readonly fromRadius_m: number;
  readonly toRadius_m: number;
  /** Depth from front to back as a share of the width. */
  readonly depth: number;
  /** Joints whose line is the limb's width; -1 where it is round. */
  readonly sideFrom: number;
  readonly sideTo: number;
  readonly extend: number;
  /** Whether it is left out where many people are drawn. */
  readonly isDetail: boolean;
}

/** Limbs that nobody misses in a crowd, by their ends. */
const DETAILS = new Set(["head nose 0.03", "left_ankle left_heel 0.04", "right_ankle right_heel 0.04", "spine neck 0.13"]);

type Row = readonly [from: string, to: string, fromRadius_m: number, toRadius_m: number, depth?: number, extend?: number];

const ROWS: readonly Row[] = [
  ["left_hip", "right_hip", 0.088, 0.088, 1],
  ["pelvis", "spine", 0.145, 0.13, 0.72],
  ["spine", "neck", 0.13, 0.1, 0.74, -0.22],
  ["left_shoulder", "right_shoulder", 0.064, 0.064, 1],
  ["spine", "neck", 0.115, 0.155, 0.66, -0.38],
  ["neck", "head", 0.056, 0.054],
  ["head", "nose", 0.1, 0.08, 1, -0.72],
  ["head", "nose", 0.03, 0.02, 1, 0.08],
];

/** The same on both sides, without `left_` or `right_`. */
const SIDE_ROWS: readonly Row[] = [
  ["shoulder", "elbow", 0.056, 0.042],
  ["elbow", "wrist", 0.043, 0.03],
  ["wrist", "hand", 0.034, 0.036, 1, 0.35],
  ["hip", "knee", 0.092, 0.058],
  ["knee", "ankle", 0.058, 0.038],
  ["ankle", "heel", 0.04, 0.034],
  ["heel", "toe", 0.036, 0.028],
];

/** Limbs for the joints of a venue; where it has other joints than the model, the server's bones. */
export function figureOf(venue: Venue): Limb[] {
  const index = new Map(venue.joints.map((joint, i) => [joint.name, i]));
  const rows = [...ROWS, ...SIDE_ROWS.flatMap((row) => [onSide("left_", row), onSide("right_", row)])];
  const limbs: Limb[] = [];
  for (const [from, to, fromRadius_m, toRadius_m, depth = 1, extend = 0] of rows) {
    const a = index.get(from);
    const b = index.get(to);
    if (a === undefined || b === undefined) return bonesOf(venue);
    const [sideFrom, sideTo] = sides(index, from, depth);
    const isDetail = DETAILS.has(`${from} ${to} ${fromRadius_m}`);
    limbs.push({ from: a, to: b, fromRadius_m, toRadius_m, depth, extend, sideFrom, sideTo, isDetail });
  }
  return limbs;
}

function onSide(side: string, [from, to, ...rest]: Row): Row {
  return [side + from, side + to, ...rest] as unknown as Row;
}

/** A flat limb is as wide as the hips or the shoulders lie. */
function sides(index: ReadonlyMap<string, number>, from: string, depth: number): [number, number] {
  if (depth === 1) return [-1, -1];
  const part = from === "pelvis" ? "hip" : "shoulder";
  return [index.get(`right_${part}`) ?? -1, index.get(`left_${part}`) ?? -1];
}

function bonesOf(venue: Venue): Limb[] {
  return venue.bones.map(({ from, to, radius_m }) => ({
    from,
    to,
    fromRadius_m: radius_m,
    toRadius_m: radius_m,
    depth: 1,
    sideFrom: -1,
    sideTo: -1,
    extend: 0,
    isDetail: false,
  }));
}
