// The cameras, viewpoint by viewpoint: health, frames per second, whom each serves, and what it sees as lines.

import type { ChartColours } from "../charts/pen.ts";
import { button, element, setClass, setHidden, setText } from "../dom.ts";
import { LEVEL_SIGNS, type Level } from "../palette.ts";
import type { CameraState, Status } from "../protocol/status.ts";
import type { CameraView } from "../protocol/ticks.ts";
import type { Camera, Venue } from "../protocol/venue.ts";
import { REPLAY_TELLS } from "../source_words.ts";
import { nameOf, type Actions, type PageState } from "../state.ts";
import type { Thumbnails } from "../thumbnails.ts";
import { count, fixed } from "../units.ts";
import { agreementInWords } from "./agreement.ts";
import { CalibrationPanel } from "./calibration.ts";
import { CameraDrawing } from "./camera_tile.ts";

const WORDS: Readonly<Record<CameraState, readonly [Level, string]>> = {
  works: ["good", "works"],
  frozen: ["failed", "frozen: the same picture again and again"],
  black: ["failed", "black pictures"],
  silent: ["failed", "no pictures"],
  failed: ["failed", "failed, is being opened again"],
  unknown: ["unknown", "nothing heard of it yet"],
};

/** How a camera is, with words. What an edge said last is worth nothing while nothing comes from it. */
export function healthOfCamera(status: Status | null, camera: number, viewpoint: number): readonly [Level, string] {
  const said = status?.cameras.find((other) => other.camera === camera);
  const [level, words] = WORDS[said?.state ?? "unknown"];
  if (level !== "good") return [level, words];
  const link = status?.links.find((other) => other.viewpoint === viewpoint);
  if (link?.state === "failed") {
    return ["failed", link.refused === null ? "nothing comes from its edge" : "its edge is refused"];
  }
  if (said?.agreement?.verdict === "disagrees") return ["warning", foundOf(status, said.name) ?? "does not show what the others show"];
  return [level, words];
}

/** What fusion found of a camera, in its own words: it knows causes that this page need not know. */
function foundOf(status: Status | null, camera: string): string | null {
  const isOf = (text: string): boolean => text.split(/[^\p{L}\p{N}_.-]+/u).some((word) => word.replace(/\.$/, "") === camera);
  return status?.alarms.find((alarm) => alarm.key.startsWith("node/fusion/notice/") && isOf(alarm.text))?.text ?? null;
}

class Tile {
  readonly root = element("article", { class: "tile" });
  readonly drawing: CameraDrawing;
  private readonly lamp = element("span", { class: "lamp" });
  private readonly state = element("p", { class: "tile-state" });
  private readonly persons = element("p");
  private readonly rate = element("p");

  constructor(
    private readonly page: PageState,
    private readonly index: number,
    private readonly camera: Camera,
    private readonly thumbnails: Thumbnails,
    actions: Actions,
  ) {
    this.drawing = new CameraDrawing(page.venue, camera, "tile-picture");
    const open = element("button", { class: "tile-open", label: `Open ${camera.name}`, attributes: { type: "button" } });
    open.append(this.drawing.chart.canvas);
    open.addEventListener("click", () => actions.openCamera(page.openCamera === index ? null : index));
    const look = button("View", `See the field in 3D from ${camera.name}`, () => actions.lookThrough(index));
    const head = element("div", { class: "tile-head" }, this.lamp, element("b", { text: camera.name }));
    // Of a replay nobody says how its cameras were.
    setHidden(this.lamp, page.venue.mode === "replay");
    const said = element("div", {}, this.state, this.persons, this.rate);
    this.root.append(head, open, element("div", { class: "tile-foot" }, said, look));
  }

  update(): void {
    const status = this.page.status?.cameras.find((camera) => camera.camera === this.index);
    setClass(this.root, "open", this.page.openCamera === this.index);
    if (this.page.venue.mode === "replay") return;
    const [level, words] = healthOfCamera(this.page.status, this.index, this.camera.viewpoint);
    setText(this.lamp, LEVEL_SIGNS[level]);
    for (const name of ["good", "warning", "failed", "unknown"]) {
      setClass(this.lamp, name, name === level);
      setClass(this.state, name, name === level);
    }
    const isHeard = level !== "failed" && level !== "unknown";
    const rate_hz = fixed(status?.framesPerSecond ?? null, 0);
    const apart = agreementInWords(status?.agreement ?? null);
    setText(this.rate, !isHeard ? "" : `${rate_hz} frames/s${apart && ` · ${apart}`}`);
    setText(this.state, level === "good" ? "" : words);
    this.state.title = status?.reason ?? words;
    setText(this.persons, this.personsText(status?.persons ?? [], level, status?.reason ?? null));
    setClass(this.root, "red", level === "failed");
  }

  draw(view: CameraView | null, colours: ChartColours): void {
    const status = this.page.status?.cameras.find((camera) => camera.camera === this.index);
    const served = this.page.venue.mode === "replay" ? null : (status?.persons ?? []);
    const own = view !== null && view.camera === this.index && this.page.openCamera === this.index ? view : null;
    const picture = this.thumbnails.of(this.index);
    this.drawing.draw(picture, this.page.people, served, own, this.page.followed, colours);
  }

  private personsText(persons: readonly number[], level: Level, reason: string | null): string {
    // Nothing that gives no pictures stands by, and of what is not heard of nobody knows.
    if (level === "failed" || level === "unknown") return reason ?? "";
    if (persons.length === 0) return "Stands by";
    if (persons.length > 6) return `Serves ${count(persons.length, "person", "people")}`;
    return `Serves ${persons.map((id) => nameOf(this.page, id).replace("Person ", "")).join(", ")}`;
  }
}

function legendOf(venue: Venue): string {
  const GUESSED = "Dashed grey lines: nothing determines where these limbs are.";
  if (venue.mode === "replay") return `Lines, not pictures: a recording holds none. ${GUESSED} ${REPLAY_TELLS}`;
  const pictures = venue.pictures
    ? "Lines are of now, the small picture below them is a second old or more, and is not there where the link is full."
    : venue.mode === "recording"
      ? "Lines, not pictures: a recording holds none."
      : "Lines, not pictures: no picture leaves an edge.";
  return (
    `${pictures} In colour: who is served by the camera; one that stands by sees people whom another of its viewpoint serves. ${GUESSED} Open a camera (click) for the ` +
    "boxes that fusion predicts (solid: chosen; dashed: another camera was), keypoints (dots) and sightings (squares)."
  );
}

export class CamerasPanel {
  readonly root = element("div", { class: "cameras" });
  readonly calibration: CalibrationPanel;
  private readonly tiles: Tile[] = [];
  private readonly legend = element("p", { class: "hint" });
  private next = 0;

  constructor(
    state: PageState,
    private readonly thumbnails: Thumbnails,
    actions: Actions,
  ) {
    this.calibration = new CalibrationPanel(state);
    setText(this.legend, legendOf(state.venue));
    for (const viewpoint of state.venue.viewpoints) {
      const row = element("div", { class: "tiles" });
      for (const index of viewpoint.cameras) {
        const camera = state.venue.cameras[index];
        if (camera === undefined) continue;
        const tile = new Tile(state, index, camera, thumbnails, actions);
        this.tiles.push(tile);
        row.append(tile.root);
      }
      this.root.append(element("h3", { text: `Viewpoint ${viewpoint.name}` }), row);
    }
    if (this.tiles.length === 0) this.root.append(element("p", { class: "hint", text: "The venue has no cameras." }));
    this.root.append(this.legend, this.calibration.root);
    setHidden(this.legend, this.tiles.length === 0);
  }

  update(): void {
    for (const tile of this.tiles) tile.update();
    this.calibration.update();
  }

  /** Draws the open tile, and one of the others in turn: their cost per frame is the same for 4 and 40 cameras. */
  draw(openIndex: number | null, view: CameraView | null, colours: ChartColours): void {
    if (this.tiles.length === 0) return;
    this.thumbnails.look(performance.now());
    this.next = (this.next + 1) % this.tiles.length;
    this.tiles[this.next]?.draw(view, colours);
    if (openIndex !== null) this.tiles.find((tile) => tile.root.classList.contains("open"))?.draw(view, colours);
  }
}
