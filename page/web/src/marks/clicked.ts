// Changes of what was clicked, each giving a new one: so that undoing is taking the one before.

import type { Clicked, Court, Pixel, PictureOfCamera } from "./document.ts";

/** Hundredths of a pixel are what the file holds. */
export function rounded([x, y]: Pixel): Pixel {
  const hundredths = (value: number): number => Math.round(value * 100) / 100;
  return [hundredths(x), hundredths(y)];
}

/** Lengths and places that a file may hold: metres, and bytes of a name. */
export const FARTHEST_M = 1e4;
const LONGEST_NAME = 64;

/** Why a name cannot be in the file; `null` where it can. */
export function problemOfName(name: string): string | null {
  if (name.trim() === "") return "It needs a name.";
  if (/\p{Cc}/u.test(name)) return "A name must consist of printable characters.";
  return new TextEncoder().encode(name).length > LONGEST_NAME ? `A name has at most ${LONGEST_NAME} letters.` : null;
}

export type Kind = "mark" | "line" | "place" | "floor" | "length";

/** What a name is; `null` where it is nothing that can be clicked. */
export function kindOf(clicked: Clicked, court: Court | null, name: string): Kind | null {
  if (court?.marks.some((mark) => mark.name === name)) return "mark";
  if (court?.lines.some((line) => line.name === name)) return "line";
  if (Object.hasOwn(clicked.places, name)) return "place";
  if (clicked.floor.includes(name)) return "floor";
  return clicked.lengths.some((length) => length.between.includes(name)) ? "length" : null;
}

export function pixelsOf(clicked: Clicked, camera: string, name: string): readonly Pixel[] {
  const own = clicked.camera[camera];
  return own !== undefined && Object.hasOwn(own, name) ? (own[name] ?? []) : [];
}

function withPixels(clicked: Clicked, camera: string, name: string, pixels: readonly Pixel[]): Clicked {
  const { [name]: _, ...others } = clicked.camera[camera] ?? {};
  const own = pixels.length === 0 ? others : { ...others, [name]: pixels };
  return { ...clicked, camera: { ...clicked.camera, [camera]: own } };
}

/** A click: another one on a line, the one of a point. */
export function placed(clicked: Clicked, camera: string, name: string, at: Pixel, isLine: boolean): Clicked {
  const before = isLine ? pixelsOf(clicked, camera, name) : [];
  return withPixels(clicked, camera, name, [...before, rounded(at)]);
}

/** A click elsewhere in its picture: at the edge, where `to` is beyond. */
export function moved(
  clicked: Clicked,
  camera: PictureOfCamera,
  name: string,
  index: number,
  to: Pixel,
): Clicked {
  const pixels = pixelsOf(clicked, camera.name, name);
  if (pixels[index] === undefined) return clicked;
  const [w = 0, h = 0] = camera.size_px;
  const inside = (value: number, size: number): number => Math.min(size - 0.5, Math.max(-0.5, value));
  const at = rounded([inside(to[0], w), inside(to[1], h)]);
  return withPixels(clicked, camera.name, name, pixels.map((px, i) => (i === index ? at : px)));
}

export function removed(clicked: Clicked, camera: string, name: string, index: number): Clicked {
  const pixels = pixelsOf(clicked, camera, name);
  return withPixels(clicked, camera, name, pixels.filter((_, i) => i !== index));
}

export function withPlace(clicked: Clicked, name: string, at_m: readonly number[]): Clicked {
  return { ...clicked, places: { ...clicked.places, [name]: at_m } };
}

export function withFloor(clicked: Clicked, name: string): Clicked {
  return clicked.floor.includes(name) ? clicked : { ...clicked, floor: [...clicked.floor, name] };
}

export function withLength(clicked: Clicked, between: readonly [string, string], length_m: number): Clicked {
  return { ...clicked, lengths: [...clicked.lengths, { between, length_m }] };
}

/** Without a given name, its clicks in all cameras, and the lengths that end there. What the court has keeps its clicks. */
export function forgotten(clicked: Clicked, court: Court | null, name: string): Clicked {
  const { [name]: _, ...places } = clicked.places;
  let left: Clicked = {
    ...clicked,
    places,
    floor: clicked.floor.filter((one) => one !== name),
    lengths: clicked.lengths.filter((length) => !length.between.includes(name)),
  };
  // The other end of a length that has gone means nothing any more.
  const ends = clicked.lengths.filter((length) => length.between.includes(name)).flatMap((length) => length.between);
  for (const end of [name, ...ends]) {
    if (kindOf(left, court, end) !== null) continue;
    for (const camera of Object.keys(left.camera)) left = withPixels(left, camera, end, []);
  }
  return left;
}

/** Names that were given, each once, in the order of the file. */
export function givenNames(clicked: Clicked): string[] {
  const ends = clicked.lengths.flatMap((length) => length.between);
  return [...new Set([...Object.keys(clicked.places), ...clicked.floor, ...ends])];
}

/** How many clicks a camera has. */
export function countOf(clicked: Clicked, camera: string): number {
  return Object.values(clicked.camera[camera] ?? {}).reduce((sum, pixels) => sum + pixels.length, 0);
}

/**
 * Which mark to click after `name`: the next of `names` that has no click in this camera. Where it is known which ones the picture shows
 * (`seen`), one of those.
 */
export function nextName(
  clicked: Clicked,
  camera: string,
  names: readonly string[],
  name: string | null,
  seen: ReadonlySet<string> | null,
): string | null {
  const from = name === null ? -1 : names.indexOf(name);
  const order = names.map((_, i) => names[(from + 1 + i) % names.length] ?? "");
  const isOpen = (one: string): boolean => pixelsOf(clicked, camera, one).length === 0;
  const isSeen = (one: string): boolean => seen === null || seen.has(one);
  return order.find((one) => isOpen(one) && isSeen(one)) ?? null;
}

/** Whether a file would say the same: whatever the order, and without cameras and names that have no click. */
export function isSame(one: Clicked, other: Clicked): boolean {
  return inOrder(one) === inOrder(other);
}

function inOrder({ camera, ...others }: Clicked): string {
  const sorted = (_: string, value: unknown): unknown =>
    value !== null && typeof value === "object" && !Array.isArray(value)
      ? Object.entries(value).sort(([a], [b]) => (a < b ? -1 : 1))
      : value;
  const clicks = Object.entries(camera).map(([name, own]) => [name, Object.entries(own).filter(([, pixels]) => pixels.length > 0)] as const);
  const some = clicks.filter(([, own]) => own.length > 0).map(([name, own]) => [name, Object.fromEntries(own)] as const);
  return JSON.stringify({ ...others, camera: Object.fromEntries(some) }, sorted);
}

/** As people say it. */
export function inWords(name: string): string {
  return name.replaceAll("_", " ");
}

/** Undo and redo. */
export class Past {
  private readonly before: Clicked[] = [];
  private readonly after: Clicked[] = [];

  constructor(private readonly most = 500) {}

  /** Notes what there was before a change. */
  note(clicked: Clicked): void {
    this.before.push(clicked);
    if (this.before.length > this.most) this.before.shift();
    this.after.length = 0;
  }

  undo(now: Clicked): Clicked | null {
    const before = this.before.pop();
    if (before === undefined) return null;
    this.after.push(now);
    return before;
  }

  redo(now: Clicked): Clicked | null {
    const after = this.after.pop();
    if (after === undefined) return null;
    this.before.push(now);
    return after;
  }

  /** From `now` back to a state that there was: what came after it is forgotten, and what was undone from it can be undone again. */
  backTo(clicked: Clicked, now: Clicked): void {
    const undone = this.after.lastIndexOf(clicked);
    if (undone >= 0) {
      this.before.push(now, ...this.after.splice(undone).slice(1).reverse());
      return;
    }
    const at = this.before.lastIndexOf(clicked);
    if (at >= 0) this.before.length = at;
    this.after.length = 0;
  }

  get canUndo(): boolean {
    return this.before.length > 0;
  }

  get canRedo(): boolean {
    return this.after.length > 0;
  }
}
