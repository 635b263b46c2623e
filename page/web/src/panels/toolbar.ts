// The buttons over the scene: from where it is looked at, what is shown, what colours mean.

import { button, element, setHidden, setPressed } from "../dom.ts";
import { SIGMA_LEAST_M, SIGMA_MOST_M, css, viridis } from "../palette.ts";
import type { FieldScene, Shown } from "../scene/scene.ts";
import type { Actions, PageState } from "../state.ts";

const KEY_STEPS = 24;
/** Marks of the key, millimetres. */
const KEY_MARKS_MM = [5, 10, 20, 50, 100] as const;

export class Toolbar {
  readonly root = element("div", { class: "toolbar", label: "View", attributes: { role: "toolbar" } });
  /** What colours and dashes mean, while there are any. */
  readonly keys: HTMLElement;
  private readonly sigmaKey = sigmaKey();
  private readonly guessKey = guessKey();
  private readonly orbit: HTMLButtonElement;
  private readonly top: HTMLButtonElement;
  private readonly followed: HTMLButtonElement;
  private readonly cameras = element("select", { label: "Look from a camera", title: "Look from a camera" });
  private readonly sigma: HTMLButtonElement;
  private readonly toggles: [keyof Shown, HTMLButtonElement][];

  constructor(
    private readonly scene: FieldScene,
    private readonly actions: Actions,
    state: PageState,
  ) {
    this.keys = element("div", { class: "keys" }, this.guessKey, this.sigmaKey);
    this.orbit = button("Field", "Look at the whole field (F)", () => this.toField());
    this.top = button("Top", "Look from above (T)", () => this.toTop());
    this.followed = button("Following", "Stop following (Esc)", () => actions.follow(null), "following");
    this.cameras.append(element("option", { text: "Camera…", attributes: { value: "" } }));
    state.venue.cameras.forEach((camera, i) => {
      this.cameras.append(element("option", { text: camera.name, attributes: { value: `${i}` } }));
    });
    this.cameras.addEventListener("change", () => {
      if (this.cameras.value === "") this.toField();
      else actions.lookThrough(Number(this.cameras.value));
    });
    this.sigma = button("Certainty", "Colour bodies by how sure each joint is (C)", () => this.toggleSigma());
    this.toggles = [
      ["labels", button("Names", "Names or ids above heads (N)", () => this.toggle("labels"))],
      ["trails", button("Trails", "Where people were in the last seconds (P)", () => this.toggle("trails"))],
      ["cameras", button("Cameras", "Cameras, coloured by their health (V)", () => this.toggle("cameras"))],
      ["bones", button("Bones", "Thin bones in the place of bodies (B)", () => this.toggle("bones"))],
    ];
    const group = (label: string, ...children: Node[]): HTMLElement =>
      element("div", { class: "group", label, attributes: { role: "group" } }, ...children);
    this.root.append(
      group("From where", this.orbit, this.top, this.cameras, this.followed),
      group("What is shown", this.sigma, ...this.toggles.map(([, made]) => made)),
    );
  }

  update(): void {
    const view = this.scene.view;
    setHidden(this.followed, view.followed === null);
    const through = view.through === null ? "" : `${view.through}`;
    if (this.cameras.value !== through) this.cameras.value = through;
    setPressed(this.sigma, this.scene.colouring === "sigma");
    setHidden(this.sigmaKey, this.scene.colouring !== "sigma");
    setHidden(this.guessKey, !this.scene.areGuessesDrawn);
    for (const [what, made] of this.toggles) setPressed(made, this.scene.shown[what]);
  }

  toField(): void {
    this.actions.follow(null);
    this.scene.view.setOrbit();
  }

  toTop(): void {
    this.actions.follow(null);
    this.scene.view.setTop();
  }

  toggleSigma(): void {
    this.scene.colouring = this.scene.colouring === "sigma" ? "person" : "sigma";
    this.update();
  }

  toggle(what: keyof Shown): void {
    this.scene.shown[what] = !this.scene.shown[what];
    this.update();
  }
}

/** What a limb means that is drawn as a guess. */
function guessKey(): HTMLElement {
  const sign = element("i", { class: "guess-sign", attributes: { "aria-hidden": "true" } });
  return element("div", { class: "guess-key" }, sign, "A guess: nothing seen determines it");
}

/** The key of the colours of certainty, logarithmic like these. */
function sigmaKey(): HTMLElement {
  const bar = element("div", { class: "key-bar", attributes: { "aria-hidden": "true" } });
  for (let i = 0; i < KEY_STEPS; i++) {
    const step = element("i");
    step.style.background = css(viridis(i / (KEY_STEPS - 1)));
    bar.append(step);
  }
  const marks = element("div", { class: "key-marks" });
  for (const mm of KEY_MARKS_MM) {
    const mark = element("span", { text: `${mm}` });
    mark.style.left = `${(100 * Math.log(mm / 1000 / SIGMA_LEAST_M)) / Math.log(SIGMA_MOST_M / SIGMA_LEAST_M)}%`;
    marks.append(mark);
  }
  const label = "Standard deviation of a joint's place, mm";
  return element("div", { class: "key", label }, element("div", { text: `Sure → unsure: σ of a joint, mm` }), bar, marks);
}
