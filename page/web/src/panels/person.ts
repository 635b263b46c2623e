// One person: name, state and why, views, certainty per part of the body, angles that are not observed, angles over time.

import { Determined } from "../determined.ts";
import { element, button, setClass, setHidden, setText } from "../dom.ts";
import { css, personColour, sigmaColour, sigmaShare } from "../palette.ts";
import { bitOf, type People } from "../protocol/ticks.ts";
import { MOST_NAME_CHARACTERS } from "../protocol/text.ts";
import { nameOf, type Actions, type PageState } from "../state.ts";
import { clockTime } from "../units.ts";
import type { AngleReading } from "../angle_names.ts";
import { STATE_WORDS, viewCount } from "./people.ts";

/** Parts of the body whose certainty is shown, each the worst of its joints. */
const PARTS: readonly (readonly [string, readonly string[]])[] = [
  ["Head", ["head", "nose", "left_ear", "right_ear"]],
  ["Trunk", ["pelvis", "spine", "neck"]],
  ["Right arm", ["right_shoulder", "right_elbow", "right_wrist"]],
  ["Left arm", ["left_shoulder", "left_elbow", "left_wrist"]],
  ["Right leg", ["right_hip", "right_knee", "right_ankle"]],
  ["Left leg", ["left_hip", "left_knee", "left_ankle"]],
  ["Right foot", ["right_heel", "right_toe"]],
  ["Left foot", ["left_heel", "left_toe"]],
];

class Part {
  readonly root = element("div", { class: "part" });
  private readonly bar = element("i");
  private readonly value = element("span");

  constructor(
    name: string,
    private readonly joints: readonly number[],
    private readonly determined: Determined,
  ) {
    this.root.append(element("span", { text: name }), element("div", { class: "part-bar" }, this.bar), this.value);
  }

  fill(people: People, at: number): void {
    let worst_m = NaN;
    for (const joint of this.joints) {
      const sigma_m = people.sigma_m[at * people.jointCount + joint] ?? NaN;
      if (!(worst_m >= sigma_m)) worst_m = sigma_m;
    }
    const isGuess = this.joints.some((joint) => this.determined.isGuess(people, at, joint));
    setClass(this.root, "guess", isGuess);
    if (isGuess) return setText(this.value, "a guess");
    this.bar.style.width = Number.isFinite(worst_m) ? `${(4 + 96 * sigmaShare(worst_m)).toFixed(0)}%` : "0";
    this.bar.style.background = css(sigmaColour(worst_m));
    setText(this.value, Number.isFinite(worst_m) ? `${(1000 * worst_m).toFixed(0)} mm` : "unknown");
  }
}

export class PersonPanel {
  readonly root = element("section", { class: "detail", label: "The followed person" });
  private readonly title = element("h2");
  private readonly dot = element("i", { class: "dot" });
  private readonly why = element("p", { class: "why" });
  private readonly views = element("p", { class: "seen-by" });
  private readonly event = element("p", { class: "event" });
  private readonly unobserved = element("p");
  private readonly unobservedCount = element("summary");
  private readonly clamped = element("p");
  private readonly nameForm = element("form", { class: "name-form" });
  private readonly name = element("input", {
    label: "Name of this person",
    attributes: { maxlength: `${MOST_NAME_CHARACTERS}`, placeholder: "Name", autocomplete: "off" },
  });
  private readonly parts: Part[] = [];

  constructor(
    private readonly state: PageState,
    private readonly actions: Actions,
    private readonly angles: readonly AngleReading[],
    chart: HTMLElement,
  ) {
    const indexOf = (name: string): number => state.venue.joints.findIndex((joint) => joint.name === name);
    const partList = element("div", { class: "parts" });
    const determined = new Determined(state.venue);
    for (const [name, joints] of PARTS) {
      const part = new Part(name, joints.map(indexOf).filter((joint) => joint >= 0), determined);
      this.parts.push(part);
      partList.append(part.root);
    }
    this.nameForm.append(this.name, element("button", { text: "Save", title: "Call this person so, on all pages, in streams and exports", attributes: { type: "submit" } }));
    this.nameForm.addEventListener("submit", (event) => {
      event.preventDefault();
      void this.giveName();
    });
    const close = button("✕", "Stop following (Esc)", () => actions.follow(null), "icon");
    const head = element("div", { class: "detail-head" }, this.dot, this.title, close);
    const unobserved = element("details", { class: "unobserved" }, this.unobservedCount, this.unobserved);
    this.root.append(head, this.nameForm, this.why, this.views, this.event, chart, this.clamped, unobserved);
    this.root.append(element("h3", { text: "How sure: standard deviation of the worst joint" }), partList);
  }

  /** Before the panel is shown for somebody else. */
  open(id: number): void {
    this.name.value = this.state.names.get(id) ?? "";
  }

  update(): void {
    const id = this.state.followed;
    setHidden(this.root, id === null);
    if (id === null) return;
    const people = this.state.people;
    const at = people.indexOf(id);
    setText(this.title, nameOf(this.state, id));
    this.dot.style.background = css(personColour(id));
    setHidden(this.nameForm, !this.state.actions.has("name_person"));
    const phase = STATE_WORDS[people.states[at] ?? -1];
    setText(this.why, at < 0 ? "Not there at this moment." : `${capital(phase?.[0])}: ${phase?.[1] ?? ""}.`);
    setText(this.views, at < 0 ? "" : this.viewsText(at));
    setText(this.event, this.eventText(id));
    this.fillAngles(at);
    if (at >= 0) for (const part of this.parts) part.fill(people, at);
  }

  private viewsText(at: number): string {
    // Maps of somebody may show nobody, as those of who is hidden do: who sends some is told apart from how many saw something.
    const seenBy = capital(viewCount(this.state, at));
    if (this.state.venue.mode === "replay") return `${seenBy}.`;
    const names = (sees: boolean): string[] =>
      this.state.venue.viewpoints.filter((_, v) => bitOf(this.state.people.viewpoints, at, v) === sees).map((v) => v.name);
    const [sends, silent] = [names(true), names(false)];
    if (sends.length === 0) return "No viewpoint sends maps of this person at the moment.";
    return `${seenBy}; maps come from ${silent.length === 0 ? "all" : `${sends.join(", ")}, not from ${silent.join(", ")}`}.`;
  }

  /** Angles that a prior carried are no evidence of anything: they are told by name. */
  private fillAngles(at: number): void {
    const people = this.state.people;
    const listed = (bits: Uint32Array): string[] =>
      at < 0 ? [] : this.angles.filter((angle) => bitOf(bits, at, angle.index)).map((angle) => angle.name.toLowerCase());
    const [unobserved, clamped] = [listed(people.unobserved), listed(people.clamped)];
    setText(this.clamped, clamped.length === 0 ? "" : `At the end of the range of motion: ${clamped.join(", ")}.`);
    setText(this.unobservedCount, `${unobserved.length} of ${this.angles.length} angles are not observed: a prior carries them`);
    setText(this.unobserved, `${unobserved.join(", ")}.`);
  }

  private eventText(id: number): string {
    for (let i = this.state.events.length - 1; i >= 0; i--) {
      const event = this.state.events[i];
      if (event === undefined || event.session !== this.state.people.session) continue;
      if (event.person !== id && event.other !== id) continue;
      const ago_s = (this.state.tick - event.tick) / this.state.venue.rate_hz;
      if (ago_s < -0.5) continue;
      return `${capital(event.text)}${Number.isFinite(ago_s) ? ` (${clockTime(Math.max(0, ago_s))} ago)` : ""}.`;
    }
    return "";
  }

  private async giveName(): Promise<void> {
    if (this.state.followed === null) return;
    const name = this.name.value.trim();
    const error = await this.actions.ask({ do: "name_person", person: this.state.followed, name });
    this.actions.say(error ?? (name === "" ? "The name is taken away." : `Called ${name} from now on.`));
    this.name.blur();
  }
}

function capital(text = ""): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
