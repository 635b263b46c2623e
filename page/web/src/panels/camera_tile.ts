// What a camera sees, drawn as lines, over a thumbnail where there is one. People are reprojected; of the open camera also
// the boxes, keypoints and sightings that fusion and its edge work with.

import { Determined } from "../determined.ts";
import { GUESS_COLOUR, css, personColour } from "../palette.ts";
import { Chart, type ChartColours } from "../charts/pen.ts";
import type { CameraView, InCamera, People } from "../protocol/ticks.ts";
import type { Camera, Venue } from "../protocol/venue.ts";

/** Nearer to the plane of the camera than this, metres, nothing is projected. */
const NEAREST_M = 0.1;

/** Dashes of bones that nothing determines. */
const GUESS_DASHES_PX = [3, 3];

/** How much of a thumbnail is seen: lines must stand out. */
const PICTURE_ALPHA = 0.6;

/** Projects a point; writes x, y in pixels of the camera, and tells whether it is before the camera. */
function project(camera: Camera, x: number, y: number, z: number, into: Float64Array): boolean {
  const r = camera.rotation;
  const t = camera.translation_m;
  const depth = (r[6] ?? 0) * x + (r[7] ?? 0) * y + (r[8] ?? 0) * z + t[2];
  if (!(depth > NEAREST_M)) return false;
  into[0] = (camera.fx_px * ((r[0] ?? 0) * x + (r[1] ?? 0) * y + (r[2] ?? 0) * z + t[0])) / depth + camera.cx_px;
  into[1] = (camera.fy_px * ((r[3] ?? 0) * x + (r[4] ?? 0) * y + (r[5] ?? 0) * z + t[1])) / depth + camera.cy_px;
  return true;
}

export class CameraDrawing {
  readonly chart: Chart;
  private readonly a = new Float64Array(2);
  private readonly b = new Float64Array(2);
  private readonly outline: readonly (readonly [number, number])[];
  private readonly determined: Determined;
  private scale = 1;

  constructor(
    private readonly venue: Venue,
    private readonly camera: Camera,
    className: string,
  ) {
    this.determined = new Determined(venue);
    this.chart = new Chart(className, `What ${camera.name} sees, as lines`);
    this.chart.canvas.style.aspectRatio = `${camera.width_px} / ${camera.height_px}`;
    const [x1, y1] = venue.fieldMin_m;
    const [x2, y2] = venue.fieldMax_m;
    // In pieces: an edge of the field that passes behind the camera is drawn as far as it is before it.
    const corners = [[x1, y1], [x2, y1], [x2, y2], [x1, y2], [x1, y1]] as const;
    const points: [number, number][] = [];
    for (let i = 0; i < 4; i++) {
      const [from, to] = [corners[i] ?? [0, 0], corners[i + 1] ?? [0, 0]];
      for (let k = 0; k < 12; k++) {
        points.push([from[0] + ((to[0] - from[0]) * k) / 12, from[1] + ((to[1] - from[1]) * k) / 12]);
      }
    }
    this.outline = [...points, [x1, y1]];
  }

  /** Draws people, those that the camera serves in colour (`null`: everybody), over the `picture` if there is one; `view` is of the open camera. */
  draw(
    picture: ImageBitmap | null,
    people: People,
    served: readonly number[] | null,
    view: CameraView | null,
    followed: number | null,
    colours: ChartColours,
  ): void {
    const pen = this.chart.begin();
    if (pen === null) return;
    this.scale = this.chart.width / this.camera.width_px;
    if (picture !== null) {
      // It shows the whole undistorted image: what is drawn over it is in the same pixels.
      pen.globalAlpha = PICTURE_ALPHA;
      pen.drawImage(picture, 0, 0, this.scale * this.camera.width_px, this.scale * this.camera.height_px);
      pen.globalAlpha = 1;
    }
    this.drawOutline(pen, colours);
    pen.lineCap = "round";
    for (let i = 0; i < people.count; i++) {
      const id = people.ids[i] ?? 0;
      const isServed = served === null || served.includes(id);
      pen.strokeStyle = isServed ? css(personColour(id)) : colours.faint;
      pen.globalAlpha = isServed ? 1 : 0.45;
      pen.lineWidth = id === followed ? 2.6 : isServed ? 1.6 : 1;
      this.drawPerson(pen, people, i, false);
      pen.strokeStyle = css(GUESS_COLOUR);
      pen.setLineDash(GUESS_DASHES_PX);
      this.drawPerson(pen, people, i, true);
      pen.setLineDash([]);
    }
    pen.globalAlpha = 1;
    for (const entry of view?.entries ?? []) this.drawEntry(pen, entry, colours);
  }

  private drawOutline(pen: CanvasRenderingContext2D, colours: ChartColours): void {
    pen.strokeStyle = colours.line;
    pen.lineWidth = 1;
    pen.beginPath();
    let isDown = false;
    for (const [x, y] of this.outline) {
      const isSeen = project(this.camera, x, y, this.venue.floor_m, this.a);
      if (isSeen) this.to(pen, this.a, isDown);
      isDown = isSeen;
    }
    pen.stroke();
  }

  /** The bones of somebody that something determines, or those that nothing does. */
  private drawPerson(pen: CanvasRenderingContext2D, people: People, person: number, isGuess: boolean): void {
    const joints = people.joints_m;
    pen.beginPath();
    for (const bone of this.venue.bones) {
      const isOfGuess = this.determined.isGuess(people, person, bone.from) || this.determined.isGuess(people, person, bone.to);
      if (isOfGuess !== isGuess) continue;
      const from = 3 * (person * people.jointCount + bone.from);
      const to = 3 * (person * people.jointCount + bone.to);
      const isSeen =
        project(this.camera, joints[from] ?? 0, joints[from + 1] ?? 0, joints[from + 2] ?? 0, this.a) &&
        project(this.camera, joints[to] ?? 0, joints[to + 1] ?? 0, joints[to + 2] ?? 0, this.b);
      if (!isSeen) continue;
      this.to(pen, this.a, false);
      this.to(pen, this.b, true);
    }
    pen.stroke();
  }

  private drawEntry(pen: CanvasRenderingContext2D, entry: InCamera, colours: ChartColours): void {
    const colour = entry.isSighting ? colours.text : css(personColour(entry.id));
    pen.strokeStyle = colour;
    pen.fillStyle = colour;
    const s = this.scale;
    if (entry.hasBox) {
      pen.save();
      pen.globalAlpha = entry.isChosen ? 1 : 0.5;
      pen.lineWidth = 1.2;
      pen.setLineDash(entry.isChosen ? [] : [4, 4]);
      pen.translate(entry.centre_px[0] * s, entry.centre_px[1] * s);
      pen.rotate(entry.rotation_rad);
      const [w, h] = [entry.size_px[0] * s, entry.size_px[1] * s];
      pen.strokeRect(-w / 2, -h / 2, w, h);
      pen.restore();
    }
    for (let k = 0; k + 1 < entry.keypoints_px.length; k += 2) {
      const [x, y] = [(entry.keypoints_px[k] ?? NaN) * s, (entry.keypoints_px[k + 1] ?? NaN) * s];
      if (!Number.isFinite(x) || !Number.isFinite(y)) continue;
      if (entry.isSighting) pen.strokeRect(x - 2, y - 2, 4, 4);
      else pen.fillRect(x - 1.5, y - 1.5, 3, 3);
    }
  }

  private to(pen: CanvasRenderingContext2D, point: Float64Array, isDown: boolean): void {
    const x = (point[0] ?? 0) * this.scale;
    const y = (point[1] ?? 0) * this.scale;
    // Far outside, canvases draw wrong lines.
    if (Math.abs(x) > 1e5 || Math.abs(y) > 1e5) return;
    if (isDown) pen.lineTo(x, y);
    else pen.moveTo(x, y);
  }
}
