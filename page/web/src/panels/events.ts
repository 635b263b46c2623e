// Who became who, newest first, each with its reason.

import { element, setText } from "../dom.ts";
import type { Actions, PageState } from "../state.ts";
import { clockTime } from "../units.ts";

const MOST_SHOWN = 80;

export class EventsPanel {
  readonly root = element("div", { class: "events" });
  private readonly list = element("ol");
  private readonly hint = element("p", { class: "hint" });
  private shown = "";

  constructor(private readonly actions: Actions) {
    this.root.append(this.hint, this.list);
  }

  update(state: PageState): void {
    const newest = state.events.slice(-MOST_SHOWN).reverse();
    const signature = `${newest[0]?.at_us} ${newest[0]?.text} ${newest.length}`;
    if (signature === this.shown) return;
    this.shown = signature;
    setText(this.hint, newest.length === 0 ? "Nothing has changed who is who." : "Who came, went, was lost and found. Click to go there.");
    const last = state.playback?.last ?? state.tick;
    const first = state.venue.mode === "recording" ? (state.playback?.first ?? 0) : last;
    this.list.replaceChildren(
      ...newest.map((event) => {
        const go = element("button", { attributes: { type: "button" } });
        const time = clockTime((event.tick - first) / state.venue.rate_hz);
        go.append(element("time", { text: time }), element("span", { text: event.text }));
        go.addEventListener("click", () => this.actions.send({ do: "seek", tick: event.tick }));
        return element("li", {}, go);
      }),
    );
  }
}
