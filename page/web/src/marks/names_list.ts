// All that can be clicked, by name: what is clicked in this picture, how far it is off, and names of one's own.

import { button, element, setClass, setText } from "../dom.ts";
import { FARTHEST_M, givenNames, inWords, kindOf, pixelsOf, problemOfName } from "./clicked.ts";
import type { Clicked, Court, Fit } from "./document.ts";
import type { Selected } from "./picture.ts";

export interface ListActs {
  choose(name: string): void;
  select(selected: Selected): void;
  remove(selected: Selected): void;
  forget(name: string): void;
  addPlace(name: string, at_m: readonly number[]): string | null;
  addFloor(name: string): string | null;
  addLength(first: string, second: string, length_m: number): string | null;
}

export interface ListShown {
  readonly clicked: Clicked;
  readonly camera: string;
  readonly fit: Fit | null;
  readonly next: string | null;
  readonly selected: Selected | null;
}

/** One name: a button that makes it the next, and a chip for each of its clicks. */
class Row {
  readonly root = element("li", { class: "mark-row" });
  private readonly choose: HTMLButtonElement;
  private readonly said = element("span", { class: "mark-said" });
  private readonly chips = element("span", { class: "mark-chips" });
  private drawn = "";

  constructor(
    private readonly name: string,
    about: string,
    private readonly acts: ListActs,
    /** What forgetting it does, where it can be forgotten. */
    forget: string | null,
  ) {
    this.choose = button(inWords(name), "Click this one next", () => acts.choose(name), "mark-name");
    this.root.append(this.choose, this.said, this.chips);
    if (about !== "") this.root.append(element("span", { class: "mark-about", text: about }));
    if (forget !== null) this.root.append(button("Forget", forget, () => acts.forget(name), "mark-forget"));
  }

  update(shown: ListShown): void {
    const { clicked, camera, fit, next, selected } = shown;
    const pixels = pixelsOf(clicked, camera, this.name);
    const others = Object.entries(clicked.camera).filter(([one, own]) => one !== camera && (own[this.name]?.length ?? 0) > 0).length;
    setClass(this.root, "is-next", next === this.name);
    setClass(this.root, "is-clicked", pixels.length > 0);
    const unseen = pixels.length === 0 && fit !== null && fit.marks.size > 0 && !fit.marks.has(this.name);
    const isMark = kindOf(clicked, null, this.name) === null && fit?.lines.every((line) => line.name !== this.name) === true;
    setText(this.said, others > 0 ? `in ${others} other${others > 1 ? "s" : ""}` : unseen && isMark ? "not in this picture" : "");
    const wanted = JSON.stringify([pixels, fit?.residuals.filter((one) => one.name === this.name), selected]);
    if (wanted === this.drawn) return;
    this.drawn = wanted;
    this.chips.replaceChildren(...pixels.map(([x, y], index) => this.chip(shown, index, `${x.toFixed(1)}, ${y.toFixed(1)}`)));
  }

  private chip({ fit, selected }: ListShown, index: number, at: string): HTMLElement {
    const residual = fit?.residuals.find((one) => one.name === this.name && one.index === index);
    const off = residual === undefined ? "" : ` · ${residual.px < 100 ? residual.px.toFixed(1) : Math.round(residual.px)} px`;
    const metres = residual === undefined ? "" : `, ${(1000 * residual.m).toFixed(0)} mm in the field`;
    const one = { name: this.name, index };
    const show = button(`${at}${off}`, `Show and correct this click${metres}`, () => this.acts.select(one));
    setClass(show, "bad", residual?.isOutlier === true || fit?.state === "contradicts");
    show.setAttribute("aria-pressed", selected?.name === this.name && selected.index === index ? "true" : "false");
    const remove = button("✕", `Take this click of ${inWords(this.name)} away`, () => this.acts.remove(one));
    return element("span", { class: "mark-chip" }, show, remove);
  }
}

export class NamesList {
  readonly root = element("div", { class: "names" });
  private readonly rows = new Map<string, Row>();
  /** Also marks of the court, where a length ends at one: they have a row in either list. */
  private readonly ownRows = new Map<string, Row>();
  private readonly own = element("ul", {});
  private readonly ownHint = element("p", {
    class: "hint",
    text: "A door post that was measured, a scratch on the floor, the ends of a wand: what no court has.",
  });
  private ownShown = "";

  constructor(
    private readonly court: Court | null,
    private readonly acts: ListActs,
  ) {
    if (court !== null) {
      this.root.append(
        this.group("Marks", court.marks.map((mark) => mark.name)),
        this.group("Lines (anywhere on them)", court.lines.map((line) => line.name)),
      );
    }
    this.root.append(element("h3", { text: "Names of your own" }), this.ownHint, this.own, this.adding());
  }

  /** All names in the order in which they are shown. */
  names(clicked: Clicked): string[] {
    return [...new Set([...(this.court?.marks.map((mark) => mark.name) ?? []), ...givenNames(clicked)])];
  }

  update(shown: ListShown): void {
    this.updateOwn(shown.clicked);
    for (const row of [...this.rows.values(), ...this.ownRows.values()]) row.update(shown);
  }

  /** Brings a name to where it can be seen. */
  reveal(name: string): void {
    const row = (this.rows.get(name) ?? this.ownRows.get(name))?.root;
    // On a phone the list is below the picture: nobody wants to be taken there.
    if (row !== undefined && matchMedia("(min-width: 761px)").matches) row.scrollIntoView({ block: "nearest" });
  }

  private group(title: string, names: readonly string[]): HTMLElement {
    const list = element("ul", {});
    for (const name of names) {
      const row = new Row(name, "", this.acts, null);
      this.rows.set(name, row);
      list.append(row.root);
    }
    return element("div", {}, element("h3", { text: title }), list);
  }

  private updateOwn(clicked: Clicked): void {
    const shown = JSON.stringify([clicked.places, clicked.floor, clicked.lengths]);
    if (shown === this.ownShown) return;
    this.ownShown = shown;
    this.ownRows.clear();
    for (const name of givenNames(clicked)) {
      const what = this.rows.has(name) ? "the lengths that end there; it keeps its clicks" : "the name, with its clicks in all cameras";
      this.ownRows.set(name, new Row(name, aboutOf(clicked, name), this.acts, `Forget ${inWords(name)}: ${what}`));
    }
    this.own.replaceChildren(...[...this.ownRows.values()].map((row) => row.root));
  }

  private adding(): HTMLElement {
    const form = element("form", { class: "adding" });
    const kind = element("select", { label: "What it is" });
    for (const [value, text] of [["place", "a place, metres"], ["floor", "on the floor"], ["length", "a length, two ends"]] as const) {
      kind.append(element("option", { text, attributes: { value } }));
    }
    const input = (label: string, hint: string): HTMLInputElement =>
      element("input", { label, attributes: { placeholder: hint, autocomplete: "off", spellcheck: "false" } });
    const [name, other, metres] = [input("Name", "door_post"), input("Other end", "wand_blue"), input("Metres", "3.1, -10.2, 0")];
    const told = element("p", { class: "hint bad", attributes: { role: "alert" } });
    const arrange = (): void => {
      other.hidden = kind.value !== "length";
      metres.hidden = kind.value === "floor";
      metres.placeholder = kind.value === "length" ? "1.0" : "3.1, -10.2, 0";
      name.placeholder = kind.value === "length" ? "wand_red" : kind.value === "floor" ? "scratch" : "door_post";
    };
    kind.addEventListener("change", arrange);
    arrange();
    form.append(kind, name, other, metres, element("button", { text: "Add", attributes: { type: "submit" } }), told);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      const values = metres.value.trim().split(/[\s,;]+/).map(Number);
      const problem = this.add(kind.value, name.value.trim(), other.value.trim(), values);
      setText(told, problem ?? "");
      if (problem === null) for (const field of [name, other, metres]) field.value = "";
    });
    return form;
  }

  private add(kind: string, name: string, other: string, values: readonly number[]): string | null {
    const problem = problemOfName(name) ?? (kind === "length" ? problemOfName(other) : null);
    if (problem !== null) return problem;
    if (kind === "floor") return this.acts.addFloor(name);
    if (values.some((value) => !Number.isFinite(value))) return "Metres are numbers: 3.1, -10.2, 0";
    if (values.some((value) => Math.abs(value) > FARTHEST_M)) return `Metres go up to ${FARTHEST_M}.`;
    if (kind === "length") {
      const [length_m] = values;
      if (values.length !== 1 || length_m === undefined || length_m <= 0) return "A length is one number of metres: 1.0";
      return name === other ? "A length has two different ends." : this.acts.addLength(name, other, length_m);
    }
    return values.length === 3 ? this.acts.addPlace(name, values) : "A place is three numbers of metres: x, y, z";
  }
}

function aboutOf(clicked: Clicked, name: string): string {
  const about: string[] = [];
  const at_m = Object.hasOwn(clicked.places, name) ? clicked.places[name] : undefined;
  if (at_m !== undefined) about.push(`at ${at_m.join(", ")} m`);
  if (clicked.floor.includes(name)) about.push("on the floor");
  for (const { between, length_m } of clicked.lengths) {
    if (between.includes(name)) about.push(`${length_m} m to ${inWords(between[0] === name ? between[1] : between[0])}`);
  }
  return about.join(" · ");
}
