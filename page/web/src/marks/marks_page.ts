// The page on which marks are clicked: what is done is put into the state, and all that is on the screen is shown from it.

import { button, element, setClass, setText } from "../dom.ts";
import type { Theme } from "../theme.ts";
import {
  Past,
  countOf,
  forgotten,
  inWords,
  kindOf,
  moved,
  nextName,
  pixelsOf,
  placed,
  removed,
  withFloor,
  withLength,
  withPlace,
} from "./clicked.ts";
import { CourtMap } from "./court_map.ts";
import type { Clicked, Court, Fit, MarksDocument, Pixel, State } from "./document.ts";
import { NamesList, type ListActs } from "./names_list.ts";
import { PictureView, type PictureActs, type Selected } from "./picture.ts";
import { Saver, type Saved, type Send, type Whose } from "./saver.ts";

/** Steps of the arrow keys, pixels; with Shift. */
const NUDGE_PX = 0.1;
const LARGE_NUDGE_PX = 1;

const KEYS: readonly (readonly [string, string])[] = [
  ["click", "place the mark that is lit; on a line, another point of it"],
  ["drag", "on a mark: correct it; beside it: move the picture"],
  ["wheel, + −, pinch", "nearer, farther; 0: all of the picture"],
  ["arrows", "move the chosen mark by 0.1 px, with Shift by 1 px"],
  ["Delete", "take the chosen mark away"],
  ["Ctrl Z, Ctrl Y", "undo, redo"],
  ["N, P", "the next name, the one before"],
  ["[ ]", "the camera before, the next camera"],
  ["L", "the drawn court away, and back"],
  ["D", "dark or light"],
];

/** Lines have a width, and lie where their rules measure them. */
function edgeOf(court: Court | null): string {
  if (court === null) return "";
  return court.name === "basketball"
    ? "Boundary lines count at their inner edge, corners where the inner edges meet."
    : "Boundary lines count at their outer edge, corners where the outer edges meet.";
}

export type LoadPicture = (number: number) => Promise<ImageBitmap>;

export class MarksPage implements PictureActs, ListActs {
  private readonly picture = new PictureView(this);
  private readonly list: NamesList;
  private readonly map: CourtMap | null;
  private readonly saver: Saver;
  private readonly past = new Past();
  private clicked: Clicked;
  private fits: readonly Fit[];
  private problem: string | null;
  private at = 0;
  private next: string | null = null;
  /** The operator has chosen it: no fit takes it away. */
  private isChosen = false;
  private selected: Selected | null = null;
  /** What there was before a drag. */
  private beforeDrag: Clicked | null = null;
  /** The last change was a step of an arrow key, and so is the next: they are undone as one. */
  private isNudging = false;
  private asked: Promise<ImageBitmap> | null = null;
  private verdictShown = "";
  private readonly saved = element("span", { class: "pill good", text: "✓ saved", attributes: { role: "status" } });
  private readonly tabs: HTMLButtonElement[] = [];
  private readonly task = element("p", { class: "task", attributes: { role: "status" } });
  private readonly verdict = element("div", { class: "verdict", attributes: { role: "status" } });
  private readonly file = element("p", { class: "file" });
  private readonly undo = button("↶", "Undo (Ctrl Z)", () => this.goBack(), "icon");
  private readonly redo = button("↷", "Redo (Ctrl Y)", () => this.goForth(), "icon");
  private readonly help = element("dialog", { class: "help", label: "How to click marks" });

  constructor(
    private readonly given: MarksDocument,
    send: Send,
    private readonly load: LoadPicture,
    private readonly theme: Theme,
  ) {
    const { state, court } = this.given;
    [this.clicked, this.fits, this.problem] = [state.clicked, state.fits, state.problem];
    this.saver = new Saver(state.revision, state.clicked, send, {
      saved: (saved) => this.tellSaved(saved),
      state: (next, whose) => this.take(next, whose),
      refused: (accepted, reason) => this.takeBack(accepted, reason),
    });
    this.list = new NamesList(court, this);
    this.map = court === null ? null : new CourtMap(court, (name) => this.choose(name));
    this.makeHelp();
    document.body.replaceChildren(this.bar(), this.middle(), this.help);
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("beforeunload", (event) => {
      if (!this.saver.isDone) event.preventDefault();
    });
    this.openCamera(0);
  }

  /** Read-only numbers for tests and for the console. */
  get camera(): string {
    return this.given.cameras[this.at]?.name ?? "";
  }

  get nextToClick(): string | null {
    return this.next;
  }

  get clicks(): number {
    return countOf(this.clicked, this.camera);
  }

  get drawnLines(): number {
    return this.fit?.lines.length ?? 0;
  }

  get isSaved(): boolean {
    return this.saver.isDone;
  }

  private get fit(): Fit | null {
    return this.fits.find((fit) => fit.camera === this.camera) ?? null;
  }

  // How it is laid out.

  private bar(): HTMLElement {
    const cameras = element("nav", { class: "cameras", label: "Cameras" });
    this.given.cameras.forEach((camera, i) => {
      const tab = button(camera.name, `The picture of ${camera.name}: ${camera.picture}`, () => this.openCamera(i));
      this.tabs.push(tab);
      cameras.append(tab);
    });
    const zoom = [
      button("−", "Farther (−)", () => this.picture.zoomBy(1 / 1.5), "icon"),
      button("+", "Nearer (+)", () => this.picture.zoomBy(1.5), "icon"),
      button("All", "All of the picture (0)", () => this.picture.fitToScreen()),
      button("Court", "The drawn court away, and back (L)", () => this.picture.toggleCourt()),
    ];
    const theme = button("◐", "Dark or light (D)", () => this.theme.toggle(), "icon");
    const help = button("?", "How to click marks (?)", () => this.help.showModal(), "icon");
    const title = element("h1", {}, element("span", { class: "brand", text: "Farfield" }), element("span", { text: "marks" }));
    return element("header", { class: "bar" }, title, this.saved, cameras, element("div", { class: "tools" }, this.undo, this.redo, ...zoom, theme, help));
  }

  private middle(): HTMLElement {
    const noCourt = "No court: `farfield calibrate marks --court futsal ...` gives marks and lines by name.";
    const map = this.map?.root ?? element("p", { class: "hint", text: noCourt });
    const skip = button("Not in this picture", "On to the next name (N)", () => this.step(1));
    const side = element("aside", { class: "side" });
    const task = element("div", { class: "task-row" }, this.task, skip);
    const edge = element("p", { class: "hint", text: edgeOf(this.given.court) });
    const guide = element("div", { class: "guide" }, task, map, edge, this.verdict);
    side.append(guide, element("div", { class: "listing" }, this.list.root, this.file));
    return element("main", {}, this.picture.root, side);
  }

  private makeHelp(): void {
    const rows = KEYS.map(([key, does]) => element("div", {}, element("dt", {}, element("kbd", { text: key })), element("dd", { text: does })));
    const close = button("✕", "Close (Esc)", () => this.help.close(), "icon");
    this.help.append(
      element("div", { class: "detail-head" }, element("h2", { text: "How to click marks" }), close),
      element("p", {
        text:
          "Say where the corners and lines of the court are in each picture. The mark to click next is lit on the little map; " +
          "choose another by its name. Come near with the wheel: parts of a pixel count. " +
          `${edgeOf(this.given.court)} ` +
          "From four marks on, where the lens is known, the court is drawn over the picture: where it does not lie on the lines, " +
          "a mark is wrong. Which end of the court is west is up to you, but it must be the same in all pictures. " +
          "Every change is in the file at once.",
      }),
      element("dl", {}, ...rows),
    );
  }

  // What is shown.

  private update(): void {
    const { clicked, camera, fit, next, selected } = this;
    this.picture.show({ clicked, camera, fit, next, selected });
    this.list.update({ clicked, camera, fit, next, selected });
    const own = Object.entries(clicked.camera[camera] ?? {}).filter(([, pixels]) => pixels.length > 0);
    this.map?.update({ next, clicked: new Set(own.map(([name]) => name)), fit });
    this.tabs.forEach((tab, i) => {
      const name = this.given.cameras[i]?.name ?? "";
      const state = this.fits.find((one) => one.camera === name);
      const isBad = state?.state === "contradicts" || (state?.residuals.some((one) => one.isOutlier) ?? false);
      const sign = isBad ? " ✕" : state?.state === "fits" ? " ✓" : "";
      setText(tab, `${name} ${countOf(clicked, name)}${sign}`);
      setClass(tab, "is-off", isBad);
      tab.setAttribute("aria-pressed", i === this.at ? "true" : "false");
    });
    setText(this.task, this.taskText());
    this.undo.disabled = !this.past.canUndo;
    this.redo.disabled = !this.past.canRedo;
    this.updateVerdict(fit);
    const isWhole = this.problem === null;
    setText(this.file, isWhole ? `✓ ${this.given.file} is what --marks takes` : `Not yet for --marks: ${this.problem}`);
  }

  private taskText(): string {
    if (this.next === null) return "Every name is clicked here. On to the next camera, or correct what is off.";
    const kind = kindOf(this.clicked, this.given.court, this.next);
    if (kind === "line") return `Click anywhere on ${inWords(this.next)}, as often as you like`;
    return `Click ${inWords(this.next)}`;
  }

  private updateVerdict(fit: Fit | null): void {
    const shown = JSON.stringify([fit?.state, fit?.text, fit?.warnings, fit?.residuals.map((one) => one.isOutlier)]);
    if (shown === this.verdictShown) return;
    this.verdictShown = shown;
    const level = fit === null ? "" : fit.state === "fits" && fit.residuals.every((one) => !one.isOutlier) ? "good" : fit.state === "too_few" || fit.state === "no_lens" ? "" : "failed";
    const sign = level === "good" ? "✓ " : level === "failed" ? "✕ " : "";
    const said = element("p", { class: `verdict-text ${level}`, text: sign + (fit?.text ?? "") });
    const warnings = (fit?.warnings ?? []).map((text) => element("p", { class: "hint", text }));
    this.verdict.replaceChildren(said, ...warnings);
  }

  private tellSaved(saved: Saved): void {
    const [text, kind] =
      saved.kind === "saved" ? ["✓ saved", "good"] : saved.kind === "saving" ? ["saving…", ""] : ["✕ not saved", "failed"];
    setText(this.saved, text);
    for (const name of ["good", "failed"]) setClass(this.saved, name, name === kind);
    this.saved.title = saved.kind === "failed" ? saved.reason : `in ${this.given.file}`;
    if (saved.kind === "failed") setText(this.task, `Not saved: ${saved.reason}`);
  }

  private take(state: State, whose: Whose): void {
    const isForeign = whose === "foreign";
    // What was clicked here is not lost: undoing brings it back.
    if (isForeign) this.past.note(this.beforeDrag ?? this.clicked);
    if (whose !== "ours") this.replace(state.clicked);
    [this.fits, this.problem] = [state.fits, state.problem];
    // The fit says which marks this picture shows: what was lit before may not be one of them.
    if (!isForeign && !this.isChosen && this.next !== null && this.fit?.state === "fits" && !this.isShown(this.next)) this.advance(this.next);
    this.update();
    if (isForeign) setText(this.task, "The file was changed elsewhere, in another window or by hand: this is what is in it now. Ctrl Z brings yours back.");
    if (whose === "merged") setText(this.task, "Cameras whose pictures are not here keep their clicks, and the names that were clicked there.");
  }

  /** A change that cannot be in the file: with it none after it could be. */
  private takeBack(accepted: Clicked, reason: string): void {
    this.past.backTo(accepted, this.beforeDrag ?? this.clicked);
    this.replace(accepted);
    this.update();
    setText(this.task, `Taken back: ${reason}`);
  }

  /** All that is clicked, in the place of what was. */
  private replace(clicked: Clicked): void {
    this.clicked = clicked;
    this.selected = null;
    this.beforeDrag = null;
    this.isNudging = false;
    // A name that is none any more cannot be clicked.
    if (this.next !== null && kindOf(clicked, this.given.court, this.next) === null) this.next = null;
    if (this.next === null) this.advance(null);
  }

  /** Whether the picture shows a mark, as far as is known. */
  private isShown(name: string): boolean {
    const isMark = kindOf(this.clicked, this.given.court, name) === "mark";
    return !isMark || this.fit === null || this.fit.marks.size === 0 || this.fit.marks.has(name);
  }

  // What is done.

  private change(to: Clicked, before: Clicked = this.clicked): void {
    this.isNudging = false;
    if (to === before) return;
    this.past.note(before);
    this.clicked = to;
    this.saver.save(to);
    this.update();
  }

  private advance(from: string | null): void {
    const names = this.list.names(this.clicked);
    const shown = new Set(names.filter((name) => this.isShown(name)));
    this.next = nextName(this.clicked, this.camera, names, from, shown);
    this.isChosen = false;
    if (this.next !== null) this.list.reveal(this.next);
  }

  private openCamera(at: number): void {
    const camera = this.given.cameras[at];
    if (camera === undefined) return;
    this.undrag();
    this.at = at;
    this.selected = null;
    this.advance(null);
    this.picture.setPicture(null);
    const asked = this.load(at);
    this.asked = asked;
    asked.then(
      (bitmap) => this.asked === asked && this.picture.setPicture(bitmap),
      (error: unknown) => this.asked === asked && this.picture.setPicture(`The picture did not come: ${String(error)}`),
    );
    this.update();
  }

  click(at: Pixel): void {
    const name = this.next;
    if (name === null) return setText(this.task, "Choose a name first: what is it that you click?");
    const isLine = kindOf(this.clicked, this.given.court, name) === "line";
    const to = placed(this.clicked, this.camera, name, at, isLine);
    this.selected = { name, index: pixelsOf(to, this.camera, name).length - 1 };
    const before = this.clicked;
    this.clicked = to;
    if (!isLine) this.advance(name);
    this.change(to, before);
  }

  select(selected: Selected): void {
    this.selected = selected;
    this.isNudging = false;
    const px = pixelsOf(this.clicked, this.camera, selected.name)[selected.index];
    if (px !== undefined) this.picture.lookAt(px);
    this.update();
  }

  drag(selected: Selected, to: Pixel, isOver: boolean): void {
    const camera = this.given.cameras[this.at];
    if (camera === undefined) return;
    this.beforeDrag ??= this.clicked;
    this.clicked = moved(this.clicked, camera, selected.name, selected.index, to);
    if (!isOver) return this.update();
    const before = this.beforeDrag;
    this.beforeDrag = null;
    this.change(this.clicked, before);
  }

  undrag(): void {
    if (this.beforeDrag === null) return;
    this.clicked = this.beforeDrag;
    this.beforeDrag = null;
    this.update();
  }

  remove(selected: Selected): void {
    this.undrag();
    this.selected = null;
    [this.next, this.isChosen] = [selected.name, true];
    this.change(removed(this.clicked, this.camera, selected.name, selected.index));
  }

  choose(name: string): void {
    [this.next, this.isChosen] = [name, true];
    this.selected = null;
    this.list.reveal(name);
    const about = this.fit?.marks.get(name);
    if (about !== undefined) this.picture.lookAt(about);
    this.update();
  }

  forget(name: string): void {
    this.selected = null;
    this.change(forgotten(this.clicked, this.given.court, name));
    this.advance(null);
    this.update();
  }

  addPlace(name: string, at_m: readonly number[]): string | null {
    return this.isTaken(name) ?? this.added(withPlace(this.clicked, name, at_m), name);
  }

  addFloor(name: string): string | null {
    return this.isTaken(name) ?? this.added(withFloor(this.clicked, name), name);
  }

  addLength(first: string, second: string, length_m: number): string | null {
    // Ends may be known places or points of the floor, and of several lengths.
    const { court } = this.given;
    const wrong = [first, second].find((name) => kindOf(this.clicked, court, name) === "line");
    if (wrong !== undefined) return `${wrong} is a line: a length ends at points.`;
    return this.added(withLength(this.clicked, [first, second], length_m), first);
  }

  private isTaken(name: string): string | null {
    return kindOf(this.clicked, this.given.court, name) === null ? null : `There is ${name} already.`;
  }

  private added(to: Clicked, name: string): null {
    this.change(to);
    [this.next, this.isChosen] = [name, true];
    this.update();
    return null;
  }

  private goBack(): void {
    this.undrag();
    this.goTo(this.past.undo(this.clicked));
  }

  private goForth(): void {
    this.undrag();
    this.goTo(this.past.redo(this.clicked));
  }

  private goTo(clicked: Clicked | null): void {
    if (clicked === null) return;
    this.replace(clicked);
    this.saver.save(clicked);
    this.update();
  }

  private step(by: number): void {
    const names = this.list.names(this.clicked);
    if (names.length === 0) return;
    const at = this.next === null ? -1 : names.indexOf(this.next);
    // Back from none of them is the last.
    const name = names[(Math.max(at, by < 0 ? 0 : -1) + by + names.length) % names.length];
    if (by > 0) this.advance(this.next);
    else if (name !== undefined) this.choose(name);
    this.update();
  }

  private nudge(dx: number, dy: number): void {
    if (this.selected === null) return;
    const { name, index } = this.selected;
    const camera = this.given.cameras[this.at];
    const px = pixelsOf(this.clicked, this.camera, name)[index];
    if (camera === undefined || px === undefined) return;
    const to = moved(this.clicked, camera, name, index, [px[0] + dx, px[1] + dy]);
    if (this.isNudging) {
      this.clicked = to;
      this.saver.save(to);
      this.update();
    } else this.change(to);
    this.isNudging = true;
    this.picture.lookAt(pixelsOf(to, this.camera, name)[index] ?? px);
  }

  private key(event: KeyboardEvent): void {
    const target = event.target;
    const isTyping = target instanceof HTMLInputElement || target instanceof HTMLSelectElement;
    if (isTyping || this.help.open || event.altKey) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const act = event.ctrlKey || event.metaKey ? this.controlKey(key, event.shiftKey) : this.plainKey(key, event.shiftKey);
    if (act === null) return;
    event.preventDefault();
    act();
  }

  private controlKey(key: string, isShifted: boolean): (() => void) | null {
    if (key === "z") return () => (isShifted ? this.goForth() : this.goBack());
    return key === "y" ? () => this.goForth() : null;
  }

  private plainKey(key: string, isShifted: boolean): (() => void) | null {
    const by = isShifted ? LARGE_NUDGE_PX : NUDGE_PX;
    const { selected } = this;
    const count = this.given.cameras.length;
    const acts: Readonly<Record<string, () => void>> = {
      ArrowLeft: () => this.nudge(-by, 0),
      ArrowRight: () => this.nudge(by, 0),
      ArrowUp: () => this.nudge(0, -by),
      ArrowDown: () => this.nudge(0, by),
      Delete: () => selected !== null && this.remove(selected),
      Backspace: () => selected !== null && this.remove(selected),
      n: () => this.step(1),
      p: () => this.step(-1),
      "[": () => this.openCamera((this.at + count - 1) % count),
      "]": () => this.openCamera((this.at + 1) % count),
      "0": () => this.picture.fitToScreen(),
      "+": () => this.picture.zoomBy(1.5),
      "=": () => this.picture.zoomBy(1.5),
      "-": () => this.picture.zoomBy(1 / 1.5),
      l: () => this.picture.toggleCourt(),
      d: () => this.theme.toggle(),
      "?": () => this.help.showModal(),
    };
    // Without a chosen mark they scroll the page.
    if (selected === null && key.startsWith("Arrow")) return null;
    return Object.hasOwn(acts, key) ? (acts[key] ?? null) : null;
  }
}
