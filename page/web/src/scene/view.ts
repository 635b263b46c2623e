// Where the scene is looked at from: orbit, from above, behind somebody who is followed, from a camera of the venue.

import { Matrix4, PerspectiveCamera, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Camera, Venue } from "../protocol/venue.ts";

const FIELD_OF_VIEW_DEG = 42;
/** Time in which a new view is reached, seconds. */
const MOVE_S = 0.45;
/** Share of the canvas that the field fills. */
const FILLED = 0.86;
/** Cameras may stand so far outside the first view, as a share of their distance: people are what is looked at. */
const CAMERAS_CUT = 0.1;
/** Distance from which somebody is followed, metres, unless it was nearer already. */
const FOLLOW_DISTANCE_M = 6.5;
/** Steps of the keyboard: radians of a turn, factor of a distance. */
const TURN_RAD = Math.PI / 24;
const ZOOM = 1.15;

export class View {
  readonly camera: PerspectiveCamera;
  /** The camera of the venue that is looked through, or `null`. */
  through: number | null = null;
  followed: number | null = null;
  private readonly controls: OrbitControls;
  private readonly centre = new Vector3();
  private readonly size_m: number;
  private readonly isLongAlongX: boolean;
  /** What is in view when the whole field is: its corners, and cameras that are not far away. */
  private readonly toSee: Vector3[] = [];
  private readonly toPosition = new Vector3();
  private readonly toTarget = new Vector3();
  private readonly scratch = new Vector3();
  private readonly world = new Matrix4();
  /** The view of the whole field that nobody has turned since: it is made anew for another shape of the canvas. */
  private fitted: "orbit" | "top" | null = null;
  private left_s = 0;
  private lastFrame_ms = 0;

  constructor(
    private readonly venue: Venue,
    canvas: HTMLElement,
  ) {
    const [x1, y1] = venue.fieldMin_m;
    const [x2, y2] = venue.fieldMax_m;
    this.centre.set((x1 + x2) / 2, (y1 + y2) / 2, venue.floor_m + 0.8);
    this.size_m = Math.max(x2 - x1, y2 - y1, 4);
    this.isLongAlongX = x2 - x1 >= y2 - y1;
    for (const x of [x1, x2]) {
      for (const y of [y1, y2]) this.toSee.push(new Vector3(x, y, venue.floor_m), new Vector3(x, y, venue.floor_m + 2));
    }
    for (const { position_m } of venue.cameras) {
      const place = new Vector3(...position_m);
      if (place.distanceTo(this.centre) < this.size_m) this.toSee.push(place.lerp(this.centre, CAMERAS_CUT));
    }
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW_DEG, 1, 0.1, Math.max(500, 20 * this.size_m));
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.maxPolarAngle = 0.495 * Math.PI;
    this.controls.minDistance = 1;
    this.controls.maxDistance = 6 * this.size_m;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("start", () => {
      this.left_s = 0;
      this.fitted = null;
    });
  }

  /** The first view, once the shape of the canvas is known. */
  begin(): void {
    this.setOrbit();
    this.camera.position.copy(this.toPosition);
    this.controls.target.copy(this.toTarget);
    this.left_s = 0;
    this.controls.update();
  }

  setAspect(aspect: number): void {
    this.camera.aspect = aspect;
    this.camera.updateProjectionMatrix();
    if (this.fitted === "orbit") this.setOrbit();
    else if (this.fitted === "top") this.setTop();
  }

  /** The whole field, from a corner; on an upright canvas along its longer side. */
  setOrbit(): void {
    this.leave();
    this.fitted = "orbit";
    if (this.camera.aspect >= 1) this.scratch.set(-0.32, -0.78, 0.58);
    else if (this.isLongAlongX) this.scratch.set(-0.8, -0.22, 0.55);
    else this.scratch.set(-0.22, -0.8, 0.55);
    this.goTo(this.scratch.normalize());
  }

  /** From above, with the longer side of the field along that of the canvas. */
  setTop(): void {
    this.leave();
    this.fitted = "top";
    // Exactly above, the direction that is up would not be defined.
    const isTurned = this.camera.aspect >= 1 !== this.isLongAlongX;
    this.goTo(this.scratch.set(isTurned ? -0.002 : 0, isTurned ? 0 : -0.002, 1).normalize());
  }

  follow(person: number | null): void {
    if (this.through !== null && person !== null) this.leave();
    if (person !== null && this.followed === null) this.left_s = MOVE_S;
    this.followed = person;
    this.fitted = null;
    if (person === null) this.left_s = 0;
  }

  /** Looks through a camera of the venue. */
  setThrough(index: number): void {
    if (this.venue.cameras[index] === undefined) return;
    this.followed = null;
    this.fitted = null;
    this.through = index;
    this.left_s = 0;
    this.controls.enabled = false;
  }

  /** Turns and comes nearer, by keyboard: steps to the left, up and away. */
  nudge(left: number, up: number, away: number): void {
    if (this.through !== null) return;
    const offset = this.scratch.copy(this.camera.position).sub(this.controls.target);
    offset.applyAxisAngle(this.camera.up, left * TURN_RAD);
    const level = new Vector3().crossVectors(this.camera.up, offset).normalize();
    const polar = offset.angleTo(this.camera.up) - up * TURN_RAD;
    if (polar > 0.02 && polar < this.controls.maxPolarAngle) offset.applyAxisAngle(level, -up * TURN_RAD);
    offset.multiplyScalar(ZOOM ** away);
    this.camera.position.copy(this.controls.target).add(offset);
    this.left_s = 0;
    this.fitted = null;
  }

  /** Brings the camera to where it should be now. `target` is the followed person's torso. */
  update(now_ms: number, target: Vector3 | null): void {
    const elapsed_s = Math.min(0.1, (now_ms - this.lastFrame_ms) / 1000);
    this.lastFrame_ms = now_ms;
    const through = this.through === null ? undefined : this.venue.cameras[this.through];
    if (through !== undefined) return this.lookThrough(through);
    if (this.followed !== null && target !== null) this.track(target);
    if (this.left_s > 0) {
      const share = Math.min(1, elapsed_s / this.left_s);
      this.left_s = Math.max(0, this.left_s - elapsed_s);
      const eased = this.left_s === 0 ? 1 : 1 - (1 - share) ** 2;
      this.camera.position.lerp(this.toPosition, eased);
      this.controls.target.lerp(this.toTarget, eased);
    }
    this.controls.update();
  }

  /** Keeps distance and direction to a person who moves. */
  private track(target: Vector3): void {
    const offset = this.scratch.copy(this.camera.position).sub(this.controls.target);
    if (this.left_s > 0) {
      offset.setLength(Math.min(offset.length(), FOLLOW_DISTANCE_M));
      this.toTarget.copy(target);
      this.toPosition.copy(target).add(offset);
      return;
    }
    this.controls.target.copy(target);
    this.camera.position.copy(target).add(offset);
  }

  private leave(): void {
    this.followed = null;
    if (this.through === null) return;
    this.through = null;
    this.controls.enabled = true;
    this.camera.fov = FIELD_OF_VIEW_DEG;
    this.camera.updateProjectionMatrix();
    this.camera.position.copy(this.toPosition);
    this.controls.target.copy(this.toTarget);
  }

  /** Looks at the field from a direction, from so far that all of it and its cameras are in view. */
  private goTo(direction: Vector3): void {
    const right = new Vector3().crossVectors(this.camera.up, direction).normalize();
    const up = new Vector3().crossVectors(direction, right);
    const half = Math.tan((FIELD_OF_VIEW_DEG / 2) * (Math.PI / 180)) * FILLED;
    const from = new Vector3();
    let distance_m = 3;
    // The middle of what is seen depends on the distance and the other way round; a few rounds are enough.
    this.toTarget.copy(this.centre);
    for (let round = 0; round < 6; round++) {
      distance_m = 3;
      let [low, high] = [Infinity, -Infinity];
      for (const point of this.toSee) {
        from.copy(point).sub(this.toTarget);
        const toward_m = from.dot(direction);
        const wide = Math.abs(from.dot(right)) / (half * this.camera.aspect);
        distance_m = Math.max(distance_m, toward_m + wide, toward_m + Math.abs(from.dot(up)) / half);
      }
      for (const point of this.toSee) {
        from.copy(point).sub(this.toTarget);
        const height = from.dot(up) / (distance_m - from.dot(direction));
        low = Math.min(low, height);
        high = Math.max(high, height);
      }
      this.toTarget.addScaledVector(up, ((low + high) / 2) * distance_m);
    }
    this.toPosition.copy(this.toTarget).addScaledVector(direction, distance_m);
    this.left_s = MOVE_S;
  }

  /** The pinhole of a camera, with its picture as large as fits into the canvas. */
  private lookThrough(camera: Camera): void {
    const r = camera.rotation;
    const [x, y, z] = camera.position_m;
    // Columns are the camera's right, up and backward directions in the world: OpenGL looks along -z, with y up.
    this.world.set(
      r[0] ?? 1, -(r[3] ?? 0), -(r[6] ?? 0), x,
      r[1] ?? 0, -(r[4] ?? 0), -(r[7] ?? 0), y,
      r[2] ?? 0, -(r[5] ?? 0), -(r[8] ?? 0), z,
      0, 0, 0, 1,
    );
    this.world.decompose(this.camera.position, this.camera.quaternion, this.scratch);
    const aspect = this.camera.aspect;
    const scale = Math.max(camera.width_px / aspect, camera.height_px);
    const [near, far] = [0.05, this.camera.far];
    const left = ((-camera.cx_px - (scale * aspect - camera.width_px) / 2) / camera.fx_px) * near;
    const top = ((camera.cy_px + (scale - camera.height_px) / 2) / camera.fy_px) * near;
    const width = ((scale * aspect) / camera.fx_px) * near;
    const height = (scale / camera.fy_px) * near;
    this.camera.projectionMatrix.makePerspective(left, left + width, top, top - height, near, far);
    this.camera.projectionMatrixInverse.copy(this.camera.projectionMatrix).invert();
  }
}
