// Cameras as small frusta, coloured by their health, and lines of sight to the followed person.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
} from "three";
import { LEVEL_COLOURS, type Level } from "../palette.ts";
import type { Camera, Venue } from "../protocol/venue.ts";

/** Depth of a frustum as a share of the field's larger side, and its bounds, metres. */
const DEPTH_SHARE = 0.035;
const DEPTH_LEAST_M = 0.4;
const DEPTH_MOST_M = 4;
/** Edges of a frustum: four from the pinhole, four of the picture, two that show which side is up. */
const EDGES = 10;
const MOST_SIGHT_LINES = 256;

/** A point of a camera's picture at a depth, in the world, metres. */
export function pointAt(camera: Camera, x_px: number, y_px: number, depth_m: number): [number, number, number] {
  const c = [((x_px - camera.cx_px) / camera.fx_px) * depth_m, ((y_px - camera.cy_px) / camera.fy_px) * depth_m, depth_m];
  const r = camera.rotation;
  // camera = R world + t, so world = position + R^T camera.
  const along = (axis: number): number =>
    (camera.position_m[axis] ?? 0) +
    (r[axis] ?? 0) * (c[0] ?? 0) +
    (r[3 + axis] ?? 0) * (c[1] ?? 0) +
    (r[6 + axis] ?? 0) * (c[2] ?? 0);
  return [along(0), along(1), along(2)];
}

export class Frusta {
  readonly group = new Group();
  private readonly edgeColours: BufferAttribute;
  private readonly faceColours: BufferAttribute;
  private readonly sight: LineSegments;
  private readonly sightPositions = new BufferAttribute(new Float32Array(MOST_SIGHT_LINES * 6), 3);
  private readonly colour = new Color();

  constructor(private readonly venue: Venue) {
    const size_m = Math.max(venue.fieldMax_m[0] - venue.fieldMin_m[0], venue.fieldMax_m[1] - venue.fieldMin_m[1]);
    const depth_m = Math.min(DEPTH_MOST_M, Math.max(DEPTH_LEAST_M, DEPTH_SHARE * size_m));
    const edges: number[] = [];
    const faces: number[] = [];
    for (const camera of venue.cameras) addCamera(camera, depth_m, edges, faces);
    this.edgeColours = new BufferAttribute(new Float32Array(edges.length), 3);
    this.faceColours = new BufferAttribute(new Float32Array(faces.length), 3);
    const lines = new LineSegments(geometryOf(edges, this.edgeColours), new LineBasicMaterial({ vertexColors: true }));
    const solid = new Mesh(
      geometryOf(faces, this.faceColours),
      new MeshBasicMaterial({ vertexColors: true, transparent: true, opacity: 0.28, depthWrite: false, side: 2 }),
    );
    this.sightPositions.setUsage(DynamicDrawUsage);
    const sightGeometry = new BufferGeometry();
    sightGeometry.setAttribute("position", this.sightPositions);
    this.sight = new LineSegments(sightGeometry, new LineBasicMaterial({ color: LEVEL_COLOURS.good, transparent: true, opacity: 0.5 }));
    this.sight.frustumCulled = false;
    this.sight.geometry.setDrawRange(0, 0);
    this.group.add(lines, solid, this.sight);
    this.setLevels(venue.cameras.map(() => "unknown"));
  }

  setLevels(levels: readonly Level[]): void {
    this.venue.cameras.forEach((_, i) => {
      this.colour.set(LEVEL_COLOURS[levels[i] ?? "unknown"]);
      paint(this.edgeColours, i, 2 * EDGES, this.colour);
      paint(this.faceColours, i, 3 * 4, this.colour);
    });
  }

  beginSightLines(): void {
    this.sight.geometry.setDrawRange(0, 0);
  }

  /** A line from a camera to a point, world, metres. */
  addSightLine(camera: number, x: number, y: number, z: number): void {
    const from = this.venue.cameras[camera]?.position_m;
    const at = this.sight.geometry.drawRange.count;
    if (from === undefined || at >= 2 * MOST_SIGHT_LINES) return;
    this.sightPositions.setXYZ(at, from[0], from[1], from[2]);
    this.sightPositions.setXYZ(at + 1, x, y, z);
    this.sight.geometry.setDrawRange(0, at + 2);
    this.sightPositions.needsUpdate = true;
  }
}

function addCamera(camera: Camera, depth_m: number, edges: number[], faces: number[]): void {
  const [w, h] = [camera.width_px, camera.height_px];
  const corners = [
    pointAt(camera, 0, 0, depth_m),
    pointAt(camera, w, 0, depth_m),
    pointAt(camera, w, h, depth_m),
    pointAt(camera, 0, h, depth_m),
  ];
  const apex = camera.position_m;
  corners.forEach((corner, i) => {
    const next = corners[(i + 1) % 4] ?? corner;
    edges.push(...apex, ...corner, ...corner, ...next);
    faces.push(...apex, ...corner, ...next);
  });
  const roof = pointAt(camera, w / 2, -0.22 * h, depth_m);
  edges.push(...(corners[0] ?? apex), ...roof, ...roof, ...(corners[1] ?? apex));
}

function geometryOf(positions: readonly number[], colours: BufferAttribute): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
  geometry.setAttribute("color", colours);
  return geometry;
}

function paint(attribute: BufferAttribute, camera: number, vertices: number, colour: Color): void {
  for (let i = camera * vertices; i < (camera + 1) * vertices; i++) attribute.setXYZ(i, colour.r, colour.g, colour.b);
  attribute.needsUpdate = true;
}
