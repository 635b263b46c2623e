// The list of people: who, in which state, seen by which viewpoints, how sure.

import { KeyedChildren, element, setClass, setHidden, setText } from "../dom.ts";
import { css, personColour, sigmaColour } from "../palette.ts";
import { COASTING, TENTATIVE, bitOf, type People } from "../protocol/ticks.ts";
import { hasEnded, nameOf, wordsOf, type Actions, type PageState } from "../state.ts";
import { UNKNOWN, count } from "../units.ts";

export const STATE_WORDS: Readonly<Record<number, readonly [word: string, meaning: string]>> = {
  0: ["tentative", "not confirmed yet: more views must agree"],
  1: ["tracked", "confirmed, and seen by enough viewpoints"],
  2: ["coasting", "not seen by two viewpoints: the model carries this person until views return"],
};

/** Mean of a person's known standard deviations, metres; NaN where none is known. */
export function meanSigma_m(people: People, person: number): number {
  let sum = 0;
  let known = 0;
  for (let j = 0; j < people.jointCount; j++) {
    const sigma = people.sigma_m[person * people.jointCount + j] ?? NaN;
    if (!Number.isFinite(sigma)) continue;
    sum += sigma;
    known++;
  }
  return known === 0 ? NaN : sum / known;
}

/** How many viewpoints gave evidence, where it is not told which: a replay is made of what they sent, and does not say it again. */
export function viewCount(state: PageState, at: number): string {
  const seen = state.people.views[at] ?? 0;
  return seen === 0 ? "seen by no viewpoint" : `seen by ${seen} of ${count(state.venue.viewpoints.length, "viewpoint", "viewpoints")}`;
}

class Row {
  readonly root = element("button", { class: "person", attributes: { type: "button" } });
  readonly views: HTMLElement[] = [];
  private readonly dot = element("i", { class: "dot", attributes: { "aria-hidden": "true" } });
  private readonly name = element("b");
  private readonly state = element("span", { class: "state" });
  private readonly viewList = element("span", { class: "views" });
  private readonly sigma = element("span", { class: "sigma" });
  id = -1;

  constructor(actions: Actions, state: PageState) {
    this.root.addEventListener("click", () => actions.follow(state.followed === this.id ? null : this.id));
    const named = state.venue.mode === "replay" ? [] : state.venue.viewpoints;
    for (const viewpoint of named) {
      const chip = element("i", { text: viewpoint.name });
      this.views.push(chip);
      this.viewList.append(chip);
    }
    this.root.append(this.dot, this.name, this.state, this.sigma, this.viewList);
  }

  fill(state: PageState, at: number): void {
    const people = state.people;
    this.id = people.ids[at] ?? 0;
    this.dot.style.background = css(personColour(this.id));
    setText(this.name, nameOf(state, this.id));
    const phase = people.states[at] ?? 1;
    setText(this.state, STATE_WORDS[phase]?.[0] ?? UNKNOWN);
    this.state.title = STATE_WORDS[phase]?.[1] ?? "";
    setClass(this.root, "unsure", phase === COASTING || phase === TENTATIVE);
    const sigma_m = meanSigma_m(people, at);
    setText(this.sigma, Number.isFinite(sigma_m) ? `σ ${(1000 * sigma_m).toFixed(0)} mm` : `σ ${UNKNOWN}`);
    this.sigma.style.borderColor = css(sigmaColour(sigma_m));
    if (state.venue.mode === "replay") setText(this.viewList, viewCount(state, at));
    this.views.forEach((chip, v) => {
      const sees = bitOf(people.viewpoints, at, v);
      setClass(chip, "sees", sees);
      chip.title = `${chip.textContent} sends ${sees ? "maps" : "nothing"} of this person`;
    });
    setClass(this.root, "chosen", state.followed === this.id);
    this.root.setAttribute("aria-pressed", state.followed === this.id ? "true" : "false");
  }
}

export class PeopleList {
  readonly root = element("div", { class: "people" });
  private readonly list = element("div", { class: "people-list" });
  private readonly empty = element("p", { class: "hint" });
  private readonly rows: KeyedChildren<Row>;

  constructor(actions: Actions, state: PageState) {
    this.rows = new KeyedChildren(this.list, () => new Row(actions, state));
    this.root.append(this.empty, this.list);
  }

  update(state: PageState): void {
    const people = state.people;
    const keys: string[] = [];
    for (let i = 0; i < people.count; i++) keys.push(`${people.session}/${people.ids[i]}`);
    this.rows.update(keys, (row, i) => row.fill(state, i));
    setHidden(this.empty, people.count > 0);
    setText(this.empty, emptyText(state));
  }
}

function emptyText(state: PageState): string {
  if (hasEnded(state)) return `${wordsOf(state).ended}: nobody was there any more.`;
  if (state.connection.kind !== "open") return "Nobody is shown, since nothing comes.";
  if (state.tick < 0 || Number.isNaN(state.tick)) return "There are no poses yet.";
  return wordsOf(state).nobody;
}
