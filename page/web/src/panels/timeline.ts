// Time: back over the last minutes or through a recording, speed, steps, a loop, and live again.

import { button, element, setHidden, setPressed, setText } from "../dom.ts";
import { hasEnded, runTime_s, wordsOf, type Actions, type PageState } from "../state.ts";
import { clockTime } from "../units.ts";

const SPEEDS = [-1, 0.1, 0.25, 0.5, 1, 2, 4] as const;
/** Length of a loop about the moment at which it was asked for, seconds. */
const LOOP_S = 4;
/** While the thumb is dragged, most requests a second: the server closes on who asks too often. */
const SEEK_EVERY_MS = 80;
/** Events that are marked on the line. */
const MARKED = /^(confirm|recognise|lose|find|revive|step_back|drop)/;

export class Timeline {
  readonly root = element("footer", { class: "time", label: "Time" });
  private readonly play = button("❚❚", "Pause or play (space)", () => this.togglePlay(), "icon play");
  private readonly live: HTMLButtonElement;
  private readonly slider = element("input", {
    label: "Tick",
    attributes: { type: "range", min: "0", max: "0", step: "1" },
  });
  private readonly marks = element("canvas", { class: "marks", attributes: { "aria-hidden": "true" } });
  private readonly place = element("output", { class: "place" });
  private readonly speed = element("select", { label: "Speed", title: "Speed" });
  private readonly loop = button("Loop", `Play the ${LOOP_S} s about this moment again and again (O)`, () => this.toggleLoop());
  private isDragged = false;
  private lastSeek_ms = 0;
  private pendingSeek = 0;
  private drawnMarks = "";

  constructor(
    private readonly actions: Actions,
    private readonly state: PageState,
  ) {
    const words = wordsOf(state);
    this.live = button(words.newest, words.goesToNewest, () => this.goLive(), "live");
    for (const speed of SPEEDS) {
      this.speed.append(element("option", { text: `${speed < 0 ? "−" : ""}${Math.abs(speed)}×`, attributes: { value: `${speed}` } }));
    }
    this.speed.value = "1";
    this.speed.addEventListener("change", () => this.playFrom(null));
    this.slider.addEventListener("input", () => this.drag());
    this.slider.addEventListener("change", () => (this.isDragged = false));
    const back = button("◂", "One tick back (,)", () => this.step(-1), "icon");
    const on = button("▸", "One tick on (.)", () => this.step(1), "icon");
    const line = element("div", { class: "line" }, this.marks, this.slider);
    this.root.append(back, this.play, on, line, this.place, this.speed, this.loop, this.live);
  }

  update(): void {
    const playback = this.state.playback;
    const [first, last] = [playback?.first ?? null, playback?.last ?? null];
    const isOpen = this.state.connection.kind === "open";
    const isUsable = isOpen && first !== null && last !== null && last > first;
    for (const child of this.root.querySelectorAll<HTMLInputElement>("button, select, input")) child.disabled = !isUsable;
    if (playback === null || first === null || last === null) return setText(this.place, "");
    const isLive = playback.state === "live";
    setPressed(this.live, isLive && isOpen);
    setText(this.play, playback.state === "paused" ? "▶" : "❚❚");
    setPressed(this.loop, playback.loop !== null);
    const tick = Number.isFinite(this.state.tick) ? this.state.tick : last;
    this.slider.min = `${first}`;
    this.slider.max = `${last}`;
    // Live, what is drawn is a few ticks behind the newest; nobody needs to see that here.
    if (!this.isDragged) this.slider.value = `${isLive ? last : Math.round(tick)}`;
    const shown = this.isDragged ? Number(this.slider.value) : tick;
    const text = momentText(this.state, isLive, shown, first, last);
    setText(this.place, `${text} · tick ${Math.round(shown)}`);
    this.slider.setAttribute("aria-valuetext", text);
    setHidden(this.live, false);
    this.drawMarks(first, last);
  }

  togglePlay(): void {
    if (this.state.playback?.state === "paused") this.playFrom(null);
    else this.actions.send({ do: "pause" });
  }

  goLive(): void {
    this.speed.value = "1";
    this.actions.send({ do: "live" });
  }

  step(ticks: number): void {
    this.actions.send({ do: "step", ticks });
  }

  /** Goes by seconds, from where it is. */
  skip(seconds: number): void {
    const tick = Number.isFinite(this.state.tick) ? this.state.tick : 0;
    this.actions.send({ do: "seek", tick: Math.round(tick + seconds * this.state.venue.rate_hz) });
  }

  faster(steps: number): void {
    const next = Math.min(SPEEDS.length - 1, Math.max(0, this.speed.selectedIndex + steps));
    this.speed.selectedIndex = next;
    this.playFrom(null);
  }

  toggleLoop(): void {
    if (this.state.playback?.loop) return this.playFrom(null);
    const [first, last] = [this.state.playback?.first ?? 0, this.state.playback?.last ?? 0];
    const half = (LOOP_S / 2) * this.state.venue.rate_hz;
    const end = Math.min(last, Math.max(first + 2 * half, Math.round(this.state.tick + half)));
    this.playFrom([Math.max(first, Math.round(end - 2 * half)), end]);
  }

  private playFrom(loop: readonly [number, number] | null): void {
    const speed = Number(this.speed.value);
    this.actions.send(loop === null ? { do: "play", speed } : { do: "play", speed, loop });
  }

  private drag(): void {
    this.isDragged = true;
    const now_ms = performance.now();
    clearTimeout(this.pendingSeek);
    const wait_ms = Math.max(0, this.lastSeek_ms + SEEK_EVERY_MS - now_ms);
    this.pendingSeek = window.setTimeout(() => {
      this.lastSeek_ms = performance.now();
      this.actions.send({ do: "seek", tick: Number(this.slider.value) });
    }, wait_ms);
  }

  /** Marks of who was confirmed, lost, found, let go. */
  private drawMarks(first: number, last: number): void {
    const width = this.marks.clientWidth;
    const signature = `${width} ${Math.round(first / 60)} ${Math.round(last / 60)} ${this.state.events.length}`;
    if (signature === this.drawnMarks || width === 0) return;
    this.drawnMarks = signature;
    this.marks.width = width * devicePixelRatio;
    this.marks.height = this.marks.clientHeight * devicePixelRatio;
    const pen = this.marks.getContext("2d");
    if (pen === null) return;
    for (const event of this.state.events) {
      if (!MARKED.test(event.change) || event.tick < first || event.tick > last) continue;
      const isBad = /^(lose|drop|step_back)/.test(event.change);
      pen.fillStyle = isBad ? "#e69f00" : "#2bb39a";
      const x = ((event.tick - first) / (last - first)) * (this.marks.width - 2);
      pen.fillRect(x, 0, 2, this.marks.height);
    }
  }
}

/** Which moment `tick` is: how long ago, or how far in what was recorded. */
export function momentText(state: PageState, isNewest: boolean, tick: number, first: number, last: number): string {
  if (state.venue.mode !== "live") return clockTime(runTime_s(state, tick, first));
  if (!isNewest) return clockTime((tick - last) / state.venue.rate_hz);
  if (hasEnded(state) || state.hasRunEnded) return "the end";
  return state.connection.kind === "open" ? "now" : "the last that came";
}
