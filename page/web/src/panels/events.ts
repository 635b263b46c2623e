// Who became who, newest first, each with its reason.

import { element, setText } from "../dom.ts";
import { runTime_s, type Actions, type PageState } from "../state.ts";
import { UNKNOWN, clockTime } from "../units.ts";

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
    const first = state.playback?.first ?? 0;
    this.list.replaceChildren(
      ...newest.map((event) => {
        const go = element("button", { attributes: { type: "button" } });
        const isLive = state.venue.mode === "live";
        const time = isLive ? timeOfDay(event.at_us) : clockTime(runTime_s(state, event.tick, first));
        go.append(element("time", { text: time }), element("span", { text: event.text }));
        go.addEventListener("click", () => this.actions.send({ do: "seek", tick: event.tick }));
        return element("li", {}, go);
      }),
    );
  }
}

function timeOfDay(at_us: number): string {
  const at = new Date(at_us / 1000);
  return Number.isNaN(at.getTime()) ? UNKNOWN : at.toLocaleTimeString([], { hour12: false });
}
