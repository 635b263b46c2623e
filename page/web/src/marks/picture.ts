// The picture of one camera: zoomed and moved, with what was clicked in it and the court as the fit draws it, and a magnifier.

import { element, setHidden } from "../dom.ts";
import { inWords } from "./clicked.ts";
import type { Clicked, Fit, Pixel } from "./document.ts";
import { Zoom } from "./zoom.ts";

/** How near to a mark a press takes it, screen pixels: of a mouse, and of a finger. */
const GRAB = { mouse: 11, touch: 18 };
/** How far a press may move and be a click. */
const CLICK_SLACK = { mouse: 4, touch: 9 };
const WHEEL = 0.0016;
const MAGNIFIED = 8;
const MAGNIFIER_SIZE = 176;
/** From which scale on every mark has its name beside it. */
const NAMES_FROM = 1;
/** On pictures, whatever the page looks like: what is drawn, what is next, what is wrong. */
const COURT_COLOUR = "#39d5ff";
const NEXT_COLOUR = "#7ee0ff";
const BAD_COLOUR = "#ff6a55";
/** From which scale on pixels are shown as squares. */
const SQUARES_FROM = 3;

export interface Selected {
  readonly name: string;
  readonly index: number;
}

/** What the picture tells of what is done in it. */
export interface PictureActs {
  click(at: Pixel): void;
  select(selected: Selected): void;
  /** A mark is dragged; `isOver`: and let go. */
  drag(selected: Selected, to: Pixel, isOver: boolean): void;
  /** What was dragged goes back to where it was. */
  undrag(): void;
}

/** What is drawn over the picture. */
export interface Shown {
  readonly clicked: Clicked;
  readonly camera: string;
  readonly fit: Fit | null;
  /** What is to be clicked next. */
  readonly next: string | null;
  readonly selected: Selected | null;
}

interface Press {
  readonly id: number;
  readonly from: readonly [number, number];
  at: readonly [number, number];
  /** The mark that is held; else the picture is. */
  held: Selected | null;
  hasMoved: boolean;
}

export class PictureView {
  readonly root: HTMLElement;
  readonly canvas = element("canvas", {
    class: "picture",
    label: "The picture. Click to place the mark that is lit; the wheel comes nearer; drag moves it.",
  });
  private readonly magnifier = element("canvas", { class: "magnifier", attributes: { "aria-hidden": "true" } });
  private readonly waiting = element("p", { class: "waiting", text: "The picture is coming…", attributes: { role: "status" } });
  private bitmap: ImageBitmap | null = null;
  private zoom = new Zoom(1, 1);
  private isFitted = true;
  private shown: Shown | null = null;
  private pointer: Pixel | null = null;
  private readonly presses = new Map<number, Press>();
  private isAsked = false;
  private hasCourt = true;

  constructor(private readonly acts: PictureActs) {
    this.canvas.tabIndex = 0;
    this.root = element("section", { class: "pictures", label: "Picture" }, this.canvas, this.magnifier, this.waiting);
    new ResizeObserver(() => this.resized()).observe(this.canvas);
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event, true));
    canvas.addEventListener("pointercancel", (event) => this.up(event, false));
    canvas.addEventListener("pointerleave", () => this.point(null));
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /** `null`: it is on its way; a text: why there is none. */
  setPicture(picture: ImageBitmap | string | null): void {
    this.bitmap = picture instanceof ImageBitmap ? picture : null;
    // What is held is of the picture before.
    this.presses.clear();
    this.waiting.textContent = typeof picture === "string" ? picture : "The picture is coming…";
    setHidden(this.waiting, this.bitmap !== null);
    if (this.bitmap !== null) this.zoom = new Zoom(this.bitmap.width, this.bitmap.height);
    this.fitToScreen();
  }

  show(shown: Shown): void {
    this.shown = shown;
    this.draw();
  }

  fitToScreen(): void {
    this.isFitted = true;
    this.zoom.fit(this.canvas.clientWidth, this.canvas.clientHeight);
    this.draw();
  }

  /** Takes the drawn court away, so that what is painted is seen, and brings it back. */
  toggleCourt(): void {
    this.hasCourt = !this.hasCourt;
    this.draw();
  }

  zoomBy(factor: number): void {
    this.isFitted = false;
    this.zoom.by(factor, this.canvas.clientWidth / 2, this.canvas.clientHeight / 2);
    this.draw();
  }

  /** Shows where a mark is, in the middle where it is not on the screen, and large enough to correct it. */
  lookAt(at: Pixel): void {
    const [w, h] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const [x, y] = this.zoom.toScreen(at);
    const isSeen = x > 0 && y > 0 && x < w && y < h;
    if (!isSeen) this.zoom.lookAt(at, w, h);
    this.point(at);
  }

  // What is done with it.

  private at(event: PointerEvent | WheelEvent): [number, number] {
    const { canvas } = this;
    const bounds = canvas.getBoundingClientRect();
    // A canvas whose height is no whole number is stretched by a part of a pixel.
    const x = ((event.clientX - bounds.left) * canvas.clientWidth) / bounds.width;
    return [x, ((event.clientY - bounds.top) * canvas.clientHeight) / bounds.height];
  }

  private down(event: PointerEvent): void {
    if (this.bitmap === null) return;
    this.canvas.setPointerCapture(event.pointerId);
    const at = this.at(event);
    const grab = event.pointerType === "touch" ? GRAB.touch : GRAB.mouse;
    const held = event.button === 0 && this.presses.size === 0 ? this.markAt(at, grab) : null;
    if (held !== null) this.acts.select(held);
    // Another button than the first moves the picture and clicks nothing.
    this.presses.set(event.pointerId, { id: event.pointerId, from: at, at, held, hasMoved: event.button !== 0 });
    if (this.presses.size > 1) this.beginPinch();
  }

  /** Two fingers move the picture: neither clicks, and the mark that the first one held stays where it was. */
  private beginPinch(): void {
    for (const press of this.presses.values()) [press.held, press.hasMoved] = [null, true];
    this.acts.undrag();
  }

  private move(event: PointerEvent): void {
    const at = this.at(event);
    const press = this.presses.get(event.pointerId);
    this.point(this.zoom.toPixel(...at));
    if (press === undefined) return;
    const slack = event.pointerType === "touch" ? CLICK_SLACK.touch : CLICK_SLACK.mouse;
    if (Math.hypot(at[0] - press.from[0], at[1] - press.from[1]) > slack) press.hasMoved = true;
    if (!press.hasMoved) return;
    if (this.presses.size === 2) this.pinch(press, at);
    else if (press.held !== null) this.acts.drag(press.held, this.zoom.toPixel(...at), false);
    else this.pan(at[0] - press.at[0], at[1] - press.at[1]);
    press.at = at;
  }

  private up(event: PointerEvent, isMeant: boolean): void {
    const press = this.presses.get(event.pointerId);
    this.presses.delete(event.pointerId);
    if (press === undefined) return;
    if (event.pointerType === "touch" && press.held === null) this.point(null);
    const px = this.zoom.toPixel(...this.at(event));
    if (!isMeant) this.acts.undrag();
    else if (press.held !== null && press.hasMoved) this.acts.drag(press.held, px, true);
    else if (!press.hasMoved && press.held === null && this.zoom.contains(px)) this.acts.click(px);
  }

  private pinch(press: Press, at: readonly [number, number]): void {
    const other = [...this.presses.values()].find((one) => one.id !== press.id);
    if (other === undefined) return;
    const distance = (p: readonly [number, number]): number => Math.max(1, Math.hypot(p[0] - other.at[0], p[1] - other.at[1]));
    const middle = (p: readonly [number, number]): [number, number] => [(p[0] + other.at[0]) / 2, (p[1] + other.at[1]) / 2];
    const [before, after] = [middle(press.at), middle(at)];
    this.pan(after[0] - before[0], after[1] - before[1]);
    this.zoom.by(distance(at) / distance(press.at), ...after);
    this.draw();
  }

  private pan(dx: number, dy: number): void {
    this.isFitted = false;
    this.zoom.pan(dx, dy);
    this.draw();
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    if (this.bitmap === null) return;
    this.isFitted = false;
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 33 : 1;
    this.zoom.by(Math.exp(-WHEEL * lines * event.deltaY), ...this.at(event));
    this.draw();
  }

  private point(at: Pixel | null): void {
    this.pointer = at;
    this.draw();
  }

  /** The mark that was clicked nearest to a place of the screen. */
  private markAt([x, y]: readonly [number, number], within: number): Selected | null {
    let nearest: Selected | null = null;
    let least = within;
    for (const [name, pixels] of Object.entries(this.shown?.clicked.camera[this.shown.camera] ?? {})) {
      pixels.forEach((px, index) => {
        const [a, b] = this.zoom.toScreen(px);
        const distance = Math.hypot(a - x, b - y);
        if (distance < least) [nearest, least] = [{ name, index }, distance];
      });
    }
    return nearest;
  }

  // What is drawn.

  private resized(): void {
    if (this.isFitted) this.fitToScreen();
    else this.draw();
  }

  /** At the next frame, however often it is asked for until then. */
  private draw(): void {
    if (this.isAsked) return;
    this.isAsked = true;
    requestAnimationFrame(() => {
      this.isAsked = false;
      this.drawNow();
    });
  }

  private drawNow(): void {
    const { canvas, bitmap, zoom, shown } = this;
    const [w, h, ratio] = [canvas.clientWidth, canvas.clientHeight, Math.min(3, devicePixelRatio)];
    sizeTo(canvas, w * ratio, h * ratio);
    const pen = canvas.getContext("2d");
    if (pen === null || w === 0 || h === 0) return;
    // What is drawn fills the canvas, of which whole pixels are taken, as pointers do.
    pen.setTransform(canvas.width / w, 0, 0, canvas.height / h, 0, 0);
    pen.clearRect(0, 0, w, h);
    setHidden(this.magnifier, bitmap === null || this.pointer === null || !zoom.contains(this.pointer));
    if (bitmap === null || shown === null) return;
    const [x, y] = zoom.toScreen([-0.5, -0.5]);
    pen.imageSmoothingEnabled = zoom.scale < SQUARES_FROM;
    pen.imageSmoothingQuality = "high";
    pen.drawImage(bitmap, x, y, bitmap.width * zoom.scale, bitmap.height * zoom.scale);
    this.drawOver(pen, shown, (px) => zoom.toScreen(px), true);
    this.drawMagnifier(bitmap, shown);
  }

  private drawMagnifier(bitmap: ImageBitmap, shown: Shown): void {
    if (this.pointer === null || this.magnifier.hidden) return;
    const { magnifier, zoom, pointer } = this;
    const [size, ratio] = [MAGNIFIER_SIZE, Math.min(3, devicePixelRatio)];
    // Away from where is pointed.
    const [sx] = zoom.toScreen(pointer);
    magnifier.classList.toggle("left", sx > this.canvas.clientWidth / 2);
    sizeTo(magnifier, size * ratio, size * ratio);
    const pen = magnifier.getContext("2d");
    if (pen === null) return;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, size, size);
    const scale = Math.max(MAGNIFIED, 2 * zoom.scale);
    const place = ([x, y]: Pixel): [number, number] => [
      size / 2 + (x - pointer[0]) * scale,
      size / 2 + (y - pointer[1]) * scale,
    ];
    const [x, y] = place([-0.5, -0.5]);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(bitmap, x, y, bitmap.width * scale, bitmap.height * scale);
    this.drawOver(pen, shown, place, false);
    line(pen, [[[size / 2, 0], [size / 2, size / 2 - 7]], [[size / 2, size / 2 + 7], [size / 2, size]]], "#fff", 1);
    line(pen, [[[0, size / 2], [size / 2 - 7, size / 2]], [[size / 2 + 7, size / 2], [size, size / 2]]], "#fff", 1);
  }

  private drawOver(pen: CanvasRenderingContext2D, shown: Shown, place: (px: Pixel) => [number, number], hasNames: boolean): void {
    const { fit, clicked, camera, selected } = shown;
    for (const { pieces } of (this.hasCourt && fit?.lines) || []) {
      line(pen, pieces.map((piece) => piece.map(place)), COURT_COLOUR, 1.25);
    }
    const own = clicked.camera[camera] ?? {};
    for (const [name, px] of (this.hasCourt && fit?.marks) || []) {
      if (Object.hasOwn(own, name) && (own[name]?.length ?? 0) > 0) continue;
      const [x, y] = place(px);
      ring(pen, x, y, name === shown.next ? 9 : 3.5, name === shown.next ? NEXT_COLOUR : COURT_COLOUR);
      if (hasNames && name === shown.next) label(pen, x, y, `${inWords(name)}: about here`, NEXT_COLOUR);
    }
    for (const [name, pixels] of Object.entries(own)) {
      pixels.forEach((px, index) => {
        const residual = fit?.residuals.find((one) => one.name === name && one.index === index);
        const isSelected = selected?.name === name && selected.index === index;
        const isBad = residual !== undefined && (residual.isOutlier || fit?.state === "contradicts");
        const colour = isBad ? BAD_COLOUR : isSelected ? "#ffffff" : "#ffd23e";
        const [x, y] = place(px);
        const drawn = fit?.marks.get(name);
        if (isBad && drawn !== undefined) line(pen, [[[x, y], place(drawn)]], BAD_COLOUR, 2);
        cross(pen, x, y, isSelected ? 10 : 7, colour);
        const off = isBad ? ` ✕ ${residual.px.toFixed(1)} px off` : "";
        if (hasNames && (isSelected || isBad || this.zoom.scale >= NAMES_FROM)) label(pen, x, y, inWords(name) + off, colour);
      });
    }
  }
}

function sizeTo(canvas: HTMLCanvasElement, width: number, height: number): void {
  const [w, h] = [Math.max(1, Math.round(width)), Math.max(1, Math.round(height))];
  if (canvas.width !== w) canvas.width = w;
  if (canvas.height !== h) canvas.height = h;
}

/** Light on a dark edge: seen on any picture. */
function line(pen: CanvasRenderingContext2D, pieces: readonly (readonly (readonly [number, number])[])[], colour: string, width: number): void {
  pen.beginPath();
  for (const piece of pieces) piece.forEach(([x, y], i) => (i === 0 ? pen.moveTo(x, y) : pen.lineTo(x, y)));
  pen.lineJoin = "round";
  stroke(pen, colour, width);
}

function stroke(pen: CanvasRenderingContext2D, colour: string, width: number): void {
  pen.strokeStyle = "rgb(0 0 0 / 0.5)";
  pen.lineWidth = width + 1.5;
  pen.stroke();
  pen.strokeStyle = colour;
  pen.lineWidth = width;
  pen.stroke();
}

function ring(pen: CanvasRenderingContext2D, x: number, y: number, radius: number, colour: string): void {
  pen.beginPath();
  pen.arc(x, y, radius, 0, 2 * Math.PI);
  stroke(pen, colour, 1.5);
}

/** Open in the middle: what is clicked stays seen. */
function cross(pen: CanvasRenderingContext2D, x: number, y: number, size: number, colour: string): void {
  pen.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
    pen.moveTo(x + 2.5 * dx, y + 2.5 * dy);
    pen.lineTo(x + size * dx, y + size * dy);
  }
  stroke(pen, colour, 1.5);
}

function label(pen: CanvasRenderingContext2D, x: number, y: number, text: string, colour: string): void {
  pen.font = "600 12px system-ui, sans-serif";
  pen.lineWidth = 3;
  pen.lineJoin = "round";
  pen.strokeStyle = "rgb(0 0 0 / 0.75)";
  pen.strokeText(text, x + 10, y - 8);
  pen.fillStyle = colour;
  pen.fillText(text, x + 10, y - 8);
}
