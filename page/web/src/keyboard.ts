// Keys, and the overlay that lists them: both from one table.

import { button, element } from "./dom.ts";

export interface Key {
  /** `KeyboardEvent.key`, lower case. */
  readonly key: string;
  /** As it is written on the key. */
  readonly shown: string;
  readonly does: string;
  readonly group: string;
  readonly act: () => void;
}

/** What signs and colours mean. */
const SIGNS: readonly (readonly [string, string])[] = [
  ["✓ ! ✕", "works, warning, failed: lamps, and the cones of cameras in the same colours"],
  ["veiled body", "tentative (not confirmed yet) or coasting (not seen by two viewpoints at the moment)"],
  ["grey, dashed", "nothing that is seen determines where this limb is: the body model carries it"],
  ["lines to cameras", "which cameras serve the followed person"],
  ["σ", "one standard deviation of a joint's place: how sure it is"],
  ["edge, fusion", "the computer at a viewpoint that reads its cameras; the one that makes skeletons of what all edges send"],
  ["viewpoint", "cameras at one place, with one edge: of each person it sends what its best camera sees"],
  ["agrees to", "how far what a camera shows of people is from what the other cameras show"],
  ["not observed", "an angle that what is seen does not determine at the moment: the body model carries it"],
  ["tick", "the number of a picture, the same for all cameras"],
  ["delay, P99", "from the picture to the pose; 99 of 100 poses are quicker than P99"],
];

export class Keyboard {
  readonly overlay = element("dialog", { class: "help", label: "Keys and signs" });

  constructor(private readonly keys: readonly Key[]) {
    addEventListener("keydown", (event) => this.take(event));
    const groups = new Map<string, HTMLElement>();
    for (const { shown, does, group } of keys) {
      let list = groups.get(group);
      if (list === undefined) {
        list = element("dl", {}, element("h3", { text: group }));
        groups.set(group, list);
      }
      list.append(element("div", {}, element("dt", {}, element("kbd", { text: shown })), element("dd", { text: does })));
    }
    const signs = element("dl", { class: "signs" }, element("h3", { text: "Signs" }));
    for (const [sign, meaning] of SIGNS) {
      signs.append(element("div", {}, element("dt", { text: sign }), element("dd", { text: meaning })));
    }
    const close = button("✕", "Close (Esc)", () => this.overlay.close(), "icon");
    const head = element("div", { class: "detail-head" }, element("h2", { text: "Keys and signs" }), close);
    const mouse = element("p", {
      class: "hint",
      text: "Drag turns the view, right drag or two fingers move it, the wheel or pinching comes nearer. Click somebody to follow.",
    });
    this.overlay.append(head, mouse, element("div", { class: "help-groups" }, ...groups.values(), signs));
  }

  toggle(): void {
    if (this.overlay.open) this.overlay.close();
    else this.overlay.showModal();
  }

  private take(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event)) return;
    const found = this.keys.find((key) => key.key === event.key.toLowerCase());
    if (found === undefined || (this.overlay.open && found.key !== "?")) return;
    event.preventDefault();
    found.act();
  }
}

/** Keys that a control needs for itself. */
function isTyping(event: KeyboardEvent): boolean {
  const target = event.target;
  if (!(target instanceof HTMLElement)) return false;
  if (target instanceof HTMLInputElement && target.type !== "checkbox") {
    return target.type !== "range" || event.key.startsWith("Arrow") || event.key === "Home" || event.key === "End";
  }
  if (target instanceof HTMLSelectElement) return true;
  return target.matches("button, summary, [role=tab]") && (event.key === " " || event.key === "Enter");
}
