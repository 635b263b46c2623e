// The field in 3D: what is drawn, and when.

import { Scene, Vector3, WebGLRenderer } from "three";
import { Determined } from "../determined.ts";
import { css, personColour, type Level } from "../palette.ts";
import { bitOf, type People } from "../protocol/ticks.ts";
import type { Venue } from "../protocol/venue.ts";
import type { SceneColours } from "../theme.ts";
import { Bodies, type Colouring } from "./bodies.ts";
import { figureOf } from "./figure.ts";
import { Floor } from "./floor.ts";
import { Frusta } from "./frusta.ts";
import { Labels } from "./labels.ts";
import { Trails } from "./trails.ts";
import { View } from "./view.ts";

/** Above the head, metres. */
const LABEL_ABOVE_M = 0.15;
/** Longer names are cut above heads, where they would cover others. */
const LABEL_LETTERS = 16;
/** How near to somebody a click must be, CSS pixels. */
const CLICK_PX = 28;

export interface Shown {
  labels: boolean;
  trails: boolean;
  cameras: boolean;
  bones: boolean;
}

export class FieldScene {
  readonly view: View;
  readonly shown: Shown = { labels: true, trails: true, cameras: true, bones: false };
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly bodies: Bodies;
  private readonly floor: Floor;
  private readonly frusta: Frusta;
  private readonly labels = new Labels();
  private readonly trails: Trails;
  private readonly head: number;
  private readonly neck: number;
  private readonly pelvis: number;
  private readonly target = new Vector3();
  private readonly projected = new Vector3();
  private readonly labelTexts = new Map<number, string>();
  private readonly labelColours = new Map<number, string>();
  private people: People | null = null;
  private names: ReadonlyMap<number, string> = new Map();
  private pixelRatio = 1;
  private isFirstFrame = true;

  constructor(
    private readonly venue: Venue,
    private readonly canvas: HTMLCanvasElement,
  ) {
    const isSoftware = isSoftwareDrawn();
    this.renderer = new WebGLRenderer({ canvas, antialias: !isSoftware, powerPreference: "high-performance" });
    // Without a graphics processor every pixel costs; with one, more than two device pixels to a pixel are not seen.
    this.pixelRatio = isSoftware ? 1 : Math.min(2, devicePixelRatio);
    this.renderer.setPixelRatio(this.pixelRatio);
    const joint = (name: string): number => Math.max(0, venue.joints.findIndex((j) => j.name === name));
    [this.head, this.neck, this.pelvis] = [joint("head"), joint("neck"), joint("pelvis")];
    this.view = new View(venue, canvas);
    this.bodies = new Bodies(figureOf(venue), new Determined(venue), venue.floor_m, isSoftware);
    this.floor = new Floor(venue);
    this.frusta = new Frusta(venue);
    this.trails = new Trails(venue.floor_m, venue.rate_hz, this.pelvis);
    this.scene.add(this.floor.group, this.frusta.group, this.trails.lines);
    this.scene.add(this.bodies.shadow, this.bodies.mesh, this.labels.mesh);
  }

  setTheme(colours: SceneColours): void {
    this.renderer.setClearColor(colours.background);
    this.floor.setTheme(colours);
    this.bodies.setTheme(colours.shadow, colours.rim);
    this.labels.setTheme(css(colours.text), css(colours.background));
  }

  /** Buttons cover so much of the top, CSS pixels: no label is put below them. */
  setTop(top_px: number): void {
    this.labels.setTop(top_px * this.pixelRatio);
  }

  setNames(names: ReadonlyMap<number, string>): void {
    this.names = names;
    this.labelTexts.clear();
  }

  setCameraLevels(levels: readonly Level[]): void {
    this.frusta.setLevels(levels);
  }

  set colouring(colouring: Colouring) {
    this.bodies.colouring = colouring;
  }

  get colouring(): Colouring {
    return this.bodies.colouring;
  }

  /** Whether limbs are drawn that nothing determines. */
  get areGuessesDrawn(): boolean {
    return this.bodies.areGuessesDrawn;
  }

  get personsDrawn(): number {
    return this.people?.count ?? 0;
  }

  /** Draws one frame. `chosen` are the cameras that serve the followed person. */
  draw(people: People, tick: number, now_ms: number, chosen: readonly number[]): void {
    this.people = people;
    this.resize();
    const followed = this.view.followed;
    const at = followed === null ? -1 : people.indexOf(followed);
    this.bodies.showBones(this.shown.bones);
    this.bodies.update(people, at < 0 ? null : followed);
    this.trails.lines.visible = this.shown.trails;
    if (this.shown.trails) this.trails.update(people, tick, at < 0 ? null : followed);
    this.frusta.group.visible = this.shown.cameras && this.view.through === null;
    this.frusta.beginSightLines();
    if (at >= 0) this.drawFollowed(people, at, chosen);
    this.view.update(now_ms, at < 0 ? null : this.target);
    this.drawLabels(people, at);
    this.renderer.render(this.scene, this.view.camera);
  }

  private drawFollowed(people: People, at: number, chosen: readonly number[]): void {
    const neck = 3 * (at * people.jointCount + this.neck);
    const pelvis = 3 * (at * people.jointCount + this.pelvis);
    const middle = (axis: number): number => ((people.joints_m[neck + axis] ?? 0) + (people.joints_m[pelvis + axis] ?? 0)) / 2;
    this.target.set(middle(0), middle(1), middle(2));
    for (const camera of chosen) {
      const viewpoint = this.venue.cameras[camera]?.viewpoint ?? -1;
      if (viewpoint >= 0 && viewpoint < 64 && bitOf(people.viewpoints, at, viewpoint)) {
        this.frusta.addSightLine(camera, this.target.x, this.target.y, this.target.z);
      }
    }
  }

  private drawLabels(people: People, followedAt: number): void {
    this.labels.begin();
    if (this.shown.cameras && this.view.through === null) {
      for (const viewpoint of this.venue.viewpoints) {
        const position = this.venue.cameras[viewpoint.cameras[0] ?? -1]?.position_m;
        if (position !== undefined) this.labels.add(viewpoint.name, "", position[0], position[1], position[2] + 0.45, 0.75);
      }
    }
    if (this.shown.labels) {
      for (let i = 0; i < people.count; i++) {
        const head = 3 * (i * people.jointCount + this.head);
        const x = people.joints_m[head] ?? 0;
        const y = people.joints_m[head + 1] ?? 0;
        const z = people.joints_m[head + 2] ?? 0;
        const id = people.ids[i] ?? 0;
        const opacity = followedAt >= 0 && followedAt !== i ? 0.45 : 1;
        this.labels.add(this.labelOf(id), this.colourOf(id), x, y, z + LABEL_ABOVE_M, opacity);
      }
    }
    this.labels.end();
  }

  /** Texts and colours are kept: making them anew would leave garbage at every frame. */
  private labelOf(id: number): string {
    let text = this.labelTexts.get(id);
    if (text === undefined) {
      text = shortened(this.names.get(id) ?? `${id}`);
      this.labelTexts.set(id, text);
    }
    return text;
  }

  private colourOf(id: number): string {
    let colour = this.labelColours.get(id);
    if (colour === undefined) {
      colour = css(personColour(id));
      this.labelColours.set(id, colour);
    }
    return colour;
  }

  /** Who is drawn at a place of the canvas, CSS pixels from its top left; `null` for nobody. */
  personAt(x_px: number, y_px: number): number | null {
    const people = this.people;
    if (people === null) return null;
    let best: number | null = null;
    let bestDistance_px = CLICK_PX;
    for (let i = 0; i < people.count; i++) {
      for (const joint of [this.head, this.neck, this.pelvis]) {
        const distance_px = this.distance(people, i, joint, x_px, y_px);
        if (distance_px >= bestDistance_px) continue;
        bestDistance_px = distance_px;
        best = people.ids[i] ?? null;
      }
    }
    return best;
  }

  private distance(people: People, person: number, joint: number, x_px: number, y_px: number): number {
    const at = 3 * (person * people.jointCount + joint);
    this.projected.set(people.joints_m[at] ?? 0, people.joints_m[at + 1] ?? 0, people.joints_m[at + 2] ?? 0);
    this.projected.project(this.view.camera);
    if (this.projected.z > 1) return Infinity;
    const x = ((this.projected.x + 1) / 2) * this.canvas.clientWidth;
    const y = ((1 - this.projected.y) / 2) * this.canvas.clientHeight;
    return Math.hypot(x - x_px, y - y_px);
  }

  private resize(): void {
    const width = this.canvas.clientWidth;
    const height = this.canvas.clientHeight;
    if (width === 0 || height === 0) return;
    const isSame =
      this.canvas.width === Math.floor(width * this.pixelRatio) && this.canvas.height === Math.floor(height * this.pixelRatio);
    if (isSame) return;
    this.renderer.setSize(width, height, false);
    this.labels.resize(this.canvas.width, this.canvas.height, this.pixelRatio);
    this.view.setAspect(width / height);
    if (this.isFirstFrame) this.view.begin();
    this.isFirstFrame = false;
  }
}

function shortened(name: string): string {
  const letters = [...name];
  return letters.length <= LABEL_LETTERS ? name : `${letters.slice(0, LABEL_LETTERS - 1).join("")}…`;
}

/** Whether WebGL is drawn by the processor, as on a machine without a graphics card. */
function isSoftwareDrawn(): boolean {
  const probe = document.createElement("canvas").getContext("webgl2");
  const info = probe?.getExtension("WEBGL_debug_renderer_info");
  const name: unknown = info ? probe?.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return typeof name === "string" && /swiftshader|llvmpipe|software/i.test(name);
}
