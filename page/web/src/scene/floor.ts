// The floor: a grid in metres, the field's outline, and the lines of its court where the venue names one.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
} from "three";
import type { Venue } from "../protocol/venue.ts";
import type { SceneColours } from "../theme.ts";

/** A painted line from one point to another. */
type Line = readonly [x1: number, y1: number, x2: number, y2: number];

/** The grid reaches beyond the field by this share of its larger side, and by at least so much, metres. */
const BEYOND_SHARE = 0.35;
const BEYOND_LEAST_M = 3;
/** Most lines of the fine grid one way; a larger field has a coarser one. */
const MOST_LINES = 160;
const COARSE_EVERY = 5;
const PAINT_M = 0.05;

export class Floor {
  readonly group = new Group();
  /** Spacing of the fine grid, metres. */
  readonly spacing_m: number;
  private readonly inside = new MeshBasicMaterial({ depthWrite: false });
  private readonly fine = new LineBasicMaterial();
  private readonly coarse = new LineBasicMaterial();
  private readonly paint = new MeshBasicMaterial();
  private readonly outline = new MeshBasicMaterial();

  constructor(venue: Venue) {
    const [x1, y1] = venue.fieldMin_m;
    const [x2, y2] = venue.fieldMax_m;
    const z = venue.floor_m;
    const court = (venue.court?.lines ?? []).flatMap((line) => pieces(line.points_m));
    // The court may be larger than what is tracked of it.
    let [left, right, near, far] = [x1, x2, y1, y2];
    for (const [fromX, fromY, toX, toY] of court) {
      [left, right] = [Math.min(left, fromX, toX), Math.max(right, fromX, toX)];
      [near, far] = [Math.min(near, fromY, toY), Math.max(far, fromY, toY)];
    }
    const size_m = Math.max(right - left, far - near, 1);
    this.spacing_m = size_m <= MOST_LINES / 2 ? 1 : Math.ceil((2 * size_m) / MOST_LINES / 5) * 5;
    const beyond_m = Math.max(BEYOND_LEAST_M, BEYOND_SHARE * size_m);
    const step = this.spacing_m * COARSE_EVERY;
    const low = [Math.floor((left - beyond_m) / step) * step, Math.floor((near - beyond_m) / step) * step] as const;
    const high = [Math.ceil((right + beyond_m) / step) * step, Math.ceil((far + beyond_m) / step) * step] as const;
    this.addPlane([x1, y1], [x2, y2], z, this.inside, -4);
    this.addGrid(low, high, z + 0.002);
    this.addPaint(outlineOf(x1, y1, x2, y2), z + 0.008, PAINT_M, this.outline);
    if (court.length > 0) this.addPaint(court, z + 0.006, PAINT_M, this.paint);
  }

  setTheme(colours: SceneColours): void {
    const set = (material: { color: Color }, colour: number): Color => material.color.set(colour);
    set(this.inside, colours.field);
    set(this.fine, colours.fineGrid);
    set(this.coarse, colours.coarseGrid);
    set(this.paint, colours.paint);
    set(this.outline, colours.outline);
  }

  private addPlane(
    low: readonly [number, number],
    high: readonly [number, number],
    z: number,
    material: MeshBasicMaterial,
    order: number,
  ): void {
    const plane = new Mesh(new PlaneGeometry(high[0] - low[0], high[1] - low[1]), material);
    plane.position.set((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, z);
    plane.renderOrder = order;
    this.group.add(plane);
  }

  private addGrid(low: readonly [number, number], high: readonly [number, number], z: number): void {
    const fine: number[] = [];
    const coarse: number[] = [];
    const lines = (axis: 0 | 1): void => {
      const across = axis === 0 ? 1 : 0;
      const count = Math.round((high[axis] - low[axis]) / this.spacing_m);
      for (let i = 0; i <= count; i++) {
        const at = low[axis] + i * this.spacing_m;
        const into = i % COARSE_EVERY === 0 ? coarse : fine;
        if (axis === 0) into.push(at, low[across], z, at, high[across], z);
        else into.push(low[across], at, z, high[across], at, z);
      }
    };
    lines(0);
    lines(1);
    for (const [positions, material] of [[fine, this.fine], [coarse, this.coarse]] as const) {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
      const segments = new LineSegments(geometry, material);
      segments.renderOrder = -3;
      this.group.add(segments);
    }
  }

  /** Lines as wide as paint: lines of a pixel cannot be told from the grid. */
  private addPaint(lines: readonly Line[], z: number, width_m: number, material: MeshBasicMaterial): void {
    const positions: number[] = [];
    const corners: number[] = [];
    for (const [x1, y1, x2, y2] of lines) {
      const length_m = Math.hypot(x2 - x1, y2 - y1) || 1;
      const ux = ((x2 - x1) / length_m) * (width_m / 2);
      const uy = ((y2 - y1) / length_m) * (width_m / 2);
      const first = positions.length / 3;
      // Half a width longer at both ends, so that corners are closed.
      positions.push(x1 - ux + uy, y1 - uy - ux, z, x2 + ux + uy, y2 + uy - ux, z);
      positions.push(x2 + ux - uy, y2 + uy + ux, z, x1 - ux - uy, y1 - uy + ux, z);
      corners.push(first, first + 1, first + 2, first, first + 2, first + 3);
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(positions), 3));
    geometry.setIndex(corners);
    const mesh = new Mesh(geometry, material);
    mesh.renderOrder = -1;
    // Far away paint is narrower than a pixel and would break into dots: a line never is.
    const thin = new BufferGeometry();
    const ends = lines.flatMap(([x1, y1, x2, y2]) => [x1, y1, z, x2, y2, z]);
    thin.setAttribute("position", new BufferAttribute(new Float32Array(ends), 3));
    const segments = new LineSegments(thin, material);
    segments.renderOrder = -1;
    this.group.add(mesh, segments);
  }
}

/** The straight pieces of a line through `points`. */
function pieces(points: readonly (readonly [number, number])[]): Line[] {
  return points.slice(1).map(([x, y], i): Line => {
    const [fromX, fromY] = points[i] ?? [x, y];
    return [fromX, fromY, x, y];
  });
}

function outlineOf(x1: number, y1: number, x2: number, y2: number): Line[] {
  return [
    [x1, y1, x2, y1],
    [x2, y1, x2, y2],
    [x2, y2, x1, y2],
    [x1, y2, x1, y1],
  ];
}
