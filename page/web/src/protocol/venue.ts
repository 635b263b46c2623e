// `GET /api/venue`: what does not change while the server runs.

import { Fields, ProtocolError, numberOf, textOf } from "./checked.ts";

/** The protocol that this page speaks. */
export const PROTOCOL = 1;
/** Largest extent that is drawn, metres; a wrong unit must not make a grid of a billion lines. */
const MOST_METRES = 10_000;
const MOST_JOINTS = 255;

export type Vector = readonly [number, number, number];

export interface Camera {
  readonly name: string;
  readonly viewpoint: number;
  readonly width_px: number;
  readonly height_px: number;
  readonly fx_px: number;
  readonly fy_px: number;
  readonly cx_px: number;
  readonly cy_px: number;
  /** World to camera (x right, y down, z forward), row by row. */
  readonly rotation: readonly number[];
  readonly translation_m: Vector;
  /** Its place in the world. */
  readonly position_m: Vector;
}

export interface Viewpoint {
  readonly name: string;
  readonly cameras: readonly number[];
}

export interface Bone {
  readonly from: number;
  readonly to: number;
  readonly radius_m: number;
}

export interface Angle {
  readonly name: string;
  readonly unit: "rad" | "m";
  /** Range of motion, radians. */
  readonly range: readonly [number, number] | null;
}

export interface Joint {
  readonly name: string;
  readonly parent: number | null;
}

/** A line of the floor, as straight pieces. */
export interface PaintedLine {
  readonly name: string;
  /** x and y in the world. */
  readonly points_m: readonly (readonly [x: number, y: number])[];
}

export interface Court {
  readonly name: string;
  readonly lines: readonly PaintedLine[];
}

/** What the server shows: a running fusion; a recording that is solved again, of which only people and events are told; a recording. */
export const MODES = ["replay", "recording", "live"] as const;
export type Mode = (typeof MODES)[number];

export interface Venue {
  readonly name: string;
  readonly release: string;
  readonly mode: Mode;
  readonly rate_hz: number;
  readonly fieldMin_m: Vector;
  readonly fieldMax_m: Vector;
  readonly floor_m: number;
  /** The court whose lines are on the floor. */
  readonly court: Court | null;
  readonly viewpoints: readonly Viewpoint[];
  readonly cameras: readonly Camera[];
  readonly joints: readonly Joint[];
  readonly bones: readonly Bone[];
  readonly keypoints: readonly string[];
  readonly angles: readonly Angle[];
  /** What the server can do beside showing, for who has the token. */
  readonly actions: ReadonlySet<string>;
  /** Whether cameras may have thumbnails. */
  readonly pictures: boolean;
}

export function readVenue(json: unknown): Venue {
  const fields = Fields.of(json, "venue");
  const protocol = fields.whole("protocol");
  if (protocol !== PROTOCOL) {
    throw new ProtocolError(`the server speaks protocol ${protocol}, this page ${PROTOCOL}: load the page again`);
  }
  const field = fields.object("field");
  const court = fields.objectOrNull("court");
  const joints = fields.list("joints", (value, path) => readJoint(Fields.of(value, path)));
  const cameras = fields.list("cameras", (value, path) => readCamera(Fields.of(value, path)));
  if (joints.length > MOST_JOINTS) throw new ProtocolError(`${joints.length} joints, expected at most ${MOST_JOINTS}`);
  return {
    name: fields.text("venue"),
    release: fields.text("release"),
    mode: fields.word("mode", MODES),
    rate_hz: fields.number("rate_hz", 0.1, 10_000),
    fieldMin_m: metres(field, "min_m"),
    fieldMax_m: metres(field, "max_m"),
    floor_m: field.number("floor_m", -MOST_METRES, MOST_METRES),
    court: court === null ? null : readCourt(court),
    viewpoints: fields.list("viewpoints", (value, path) => readViewpoint(Fields.of(value, path), cameras.length)),
    cameras,
    joints,
    bones: fields.list("bones", (value, path) => readBone(Fields.of(value, path), joints.length)),
    keypoints: fields.list("keypoints", textOf),
    angles: fields.list("angles", (value, path) => readAngle(Fields.of(value, path))),
    actions: new Set(fields.list("actions", textOf)),
    pictures: fields.flag("pictures"),
  };
}

function metres(fields: Fields, name: string): Vector {
  const [x = 0, y = 0, z = 0] = fields.numbers(name, 3).map(bounded);
  return [x, y, z];
}

function bounded(m: number): number {
  return Math.min(MOST_METRES, Math.max(-MOST_METRES, m));
}

function readCourt(fields: Fields): Court {
  const readLine = (line: Fields): PaintedLine => ({
    name: line.text("name"),
    points_m: line.list("points_m", (value, path) => {
      const [x = 0, y = 0] = Fields.of({ point: value }, path).numbers("point", 2).map(bounded);
      return [x, y] as const;
    }),
  });
  return { name: fields.text("name"), lines: fields.list("lines", (value, path) => readLine(Fields.of(value, path))) };
}

function readJoint(fields: Fields): Joint {
  return { name: fields.text("name"), parent: fields.wholeOrNull("parent", MOST_JOINTS) };
}

function readBone(fields: Fields, joints: number): Bone {
  return {
    from: fields.whole("from", joints - 1),
    to: fields.whole("to", joints - 1),
    radius_m: fields.number("radius_m", 0, 1),
  };
}

function readViewpoint(fields: Fields, cameras: number): Viewpoint {
  const indices = fields.list("cameras", numberOf);
  if (!indices.every((i) => Number.isInteger(i) && i >= 0 && i < cameras)) {
    throw new ProtocolError(`${fields.path}.cameras names a camera that is not there`);
  }
  return { name: fields.text("name"), cameras: indices };
}

function readAngle(fields: Fields): Angle {
  const range = fields.numbersOrNull("range", 2);
  return {
    name: fields.text("name"),
    unit: fields.word("unit", ["m", "rad"]),
    range: range === null ? null : [range[0] ?? 0, range[1] ?? 0],
  };
}

function readCamera(fields: Fields): Camera {
  const [width_px = 1, height_px = 1] = fields.numbers("size_px", 2);
  const rows = fields.list("rotation", (value, path) => Fields.of({ row: value }, path).numbers("row", 3));
  if (rows.length !== 3) throw new ProtocolError(`${fields.path}.rotation has ${rows.length} rows, expected 3`);
  return {
    name: fields.text("name"),
    viewpoint: fields.whole("viewpoint"),
    width_px: Math.max(1, width_px),
    height_px: Math.max(1, height_px),
    fx_px: fields.number("fx_px", 1e-3),
    fy_px: fields.number("fy_px", 1e-3),
    cx_px: fields.number("cx_px"),
    cy_px: fields.number("cy_px"),
    rotation: rows.flat(),
    translation_m: metres(fields, "translation_m"),
    position_m: metres(fields, "position_m"),
  };
}
