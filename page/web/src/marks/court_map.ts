// The court from above, as on a map: which mark is to be clicked next, which ones are clicked, where the camera stands.

import { inWords } from "./clicked.ts";
import type { Court, Fit } from "./document.ts";

const SPACE = "http://www.w3.org/2000/svg";
/** About the court, as a share of half its length: room for the letters, and for cameras. */
const MARGIN = 0.16;

function shape(tag: string, attributes: Readonly<Record<string, string | number>>): SVGElement {
  const made = document.createElementNS(SPACE, tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, String(value));
  return made;
}

export interface MapShown {
  readonly next: string | null;
  readonly clicked: ReadonlySet<string>;
  readonly fit: Fit | null;
}

export class CourtMap {
  readonly root: SVGElement;
  private readonly marks = new Map<string, SVGElement>();
  private readonly lines = new Map<string, SVGElement>();
  private readonly camera: SVGElement;
  private readonly half_m: readonly [number, number];

  constructor(court: Court, choose: (name: string) => void) {
    const [length_m = 1, width_m = 1] = court.size_m;
    const margin_m = (MARGIN * length_m) / 2;
    const half: [number, number] = [length_m / 2 + margin_m, width_m / 2 + margin_m];
    this.half_m = half;
    const size = Math.max(...half) / 20;
    this.root = shape("svg", {
      class: "court-map",
      viewBox: `${-half[0]} ${-half[1]} ${2 * half[0]} ${2 * half[1]}`,
      role: "img",
      "aria-label": `The ${court.name} court from above, north up`,
    });
    for (const line of court.lines) {
      const points = line.points_m.map(([x = 0, y = 0]) => `${x},${-y}`).join(" ");
      const drawn = shape("polyline", { class: "court-line", points });
      this.lines.set(line.name, drawn);
      this.root.append(drawn);
    }
    for (const [text, x, y] of [["N", 0, -half[1]], ["S", 0, half[1]], ["W", -half[0], 0], ["E", half[0], 0]] as const) {
      const inward = 0.5 * margin_m;
      const at = { x: x - Math.sign(x) * inward, y: y - Math.sign(y) * inward };
      const letter = shape("text", { ...at, class: "court-side", "font-size": 1.9 * size, "text-anchor": "middle", "dominant-baseline": "central" });
      letter.textContent = text;
      this.root.append(letter);
    }
    this.camera = shape("path", { class: "court-camera", d: "" });
    this.root.append(this.camera);
    for (const mark of court.marks) {
      const [x = 0, y = 0] = mark.position_m;
      const drawn = shape("circle", { class: "court-mark", cx: x, cy: -y, r: 0.42 * size });
      const title = shape("title", {});
      title.textContent = inWords(mark.name);
      drawn.append(title);
      drawn.addEventListener("click", () => choose(mark.name));
      this.marks.set(mark.name, drawn);
      this.root.append(drawn);
    }
  }

  update({ next, clicked, fit }: MapShown): void {
    for (const [of, kind] of [[this.marks, "court-mark"], [this.lines, "court-line"]] as const) {
      for (const [name, drawn] of of) {
        const isBad = fit?.residuals.some((one) => one.name === name && one.isOutlier) ?? false;
        const about = `${clicked.has(name) ? " is-clicked" : ""}${isBad ? " is-off" : ""}${name === next ? " is-next" : ""}`;
        drawn.setAttribute("class", kind + about);
      }
    }
    // What is lit must not lie under a neighbour: posts and crossbars are at one place from above.
    const lit = next === null ? undefined : this.marks.get(next);
    if (lit !== undefined && this.root.lastElementChild !== lit) this.root.append(lit);
    this.drawCamera(fit);
  }

  private drawCamera(fit: Fit | null): void {
    const [x, y] = fit?.center_m ?? [];
    if (x === undefined || y === undefined) return this.camera.setAttribute("d", "");
    const [w, h] = this.half_m;
    const size = Math.max(w, h) / 22;
    // At the border where it stands beyond it.
    const cx = Math.min(w - size, Math.max(size - w, x));
    const cy = Math.min(h - size, Math.max(size - h, -y));
    this.camera.setAttribute("d", `M${cx - size} ${cy}L${cx} ${cy - size}L${cx + size} ${cy}L${cx} ${cy + size}Z`);
  }
}
