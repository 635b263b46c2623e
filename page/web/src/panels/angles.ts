// Which angles of the followed person are charted, and where their values come from: the past from the server's series,
// what comes from the ticks.

import { FIRST_CHOSEN, readings, type AngleReading } from "../angle_names.ts";
import { AngleChart, CHART_S, LINE_COLOURS } from "../charts/angle_chart.ts";
import type { ChartColours } from "../charts/pen.ts";
import { AngleSeries } from "../charts/series.ts";
import type { Connection } from "../connection.ts";
import { element, setText } from "../dom.ts";
import { bitOf, type ChosenAngles } from "../protocol/ticks.ts";
import type { Series } from "../protocol/text.ts";
import type { PageState } from "../state.ts";
import { UNKNOWN } from "../units.ts";

const MOST_ANGLES = LINE_COLOURS.length;
/** After a jump in time the past is asked for once the moment has stayed for so long. */
const SETTLE_MS = 300;
/** Seconds of ticks that may be missing before they are asked for. */
const GAP_S = 0.1;

export class AnglePanel {
  readonly root = element("div", { class: "angles" });
  readonly all: readonly AngleReading[];
  private chosen: AngleReading[];
  private readonly chart = new AngleChart();
  private readonly legend = element("div", { class: "legend" });
  private readonly values: HTMLElement[] = [];
  private series: AngleSeries;
  private timer = 0;
  private asked = 0;

  constructor(
    private readonly state: PageState,
    private readonly connection: Connection,
  ) {
    this.all = readings(state.venue.angles);
    const first = FIRST_CHOSEN.map((name) => state.venue.angles.findIndex((angle) => angle.name === name));
    this.chosen = this.all.filter((angle) => first.includes(angle.index));
    this.series = new AngleSeries(this.chosen.length);
    this.root.append(element("h3", { text: "Joint angles, degrees, flexion positive" }));
    this.root.append(this.chart.chart.canvas, this.legend, this.picker());
    this.drawLegend();
  }

  /** The followed person, the chosen angles or the moment is another: begins anew. */
  restart(): void {
    this.series.clear();
    const person = this.state.followed;
    const isAny = person !== null && this.chosen.length > 0;
    this.connection.send({ do: "angles", persons: isAny ? [person] : [], angles: isAny ? this.indices() : [] });
    if (isAny) this.fetchPast();
  }

  /** Values of a tick that came. `unobserved` says of a person and angle whether a prior carried it at that tick. */
  take(message: ChosenAngles, isUnobserved: (person: number, angle: number) => boolean): void {
    const person = message.persons.find(({ id }) => id === this.state.followed);
    if (person === undefined || person.values.length !== this.chosen.length) return;
    const step = message.tick - this.series.lastTick;
    // Ticks that this page was too slow for are asked for again, as is the past after a jump.
    if (step < 0 || step > GAP_S * this.state.venue.rate_hz) this.fetchPast();
    this.series.push(message.tick, (a) => {
      const angle = this.chosen[a];
      return angle === undefined || isUnobserved(person.id, angle.index) ? NaN : (person.values[a] ?? NaN);
    });
  }

  draw(colours: ChartColours): void {
    if (this.state.followed === null) return;
    const tick = Number.isFinite(this.series.lastTick) ? this.series.lastTick : this.state.tick;
    this.chart.draw(this.series, this.chosen, tick, this.state.venue.rate_hz, colours);
    const at = this.state.people.indexOf(this.state.followed);
    this.chosen.forEach((angle, a) => {
      const target = this.values[a];
      if (target === undefined) return;
      const isUnobserved = at >= 0 && bitOf(this.state.people.unobserved, at, angle.index);
      const deg = this.series.length === 0 ? NaN : this.series.valueAt(this.series.length - 1, a) * angle.degreesPerRadian;
      setText(target, isUnobserved ? "not observed" : Number.isFinite(deg) ? `${deg.toFixed(0)}°` : UNKNOWN);
    });
  }

  private indices(): number[] {
    return this.chosen.map((angle) => angle.index);
  }

  private fetchPast(): void {
    if (this.timer !== 0) return;
    this.timer = window.setTimeout(() => {
      this.timer = 0;
      void this.askPast();
    }, SETTLE_MS);
  }

  private async askPast(): Promise<void> {
    const person = this.state.followed;
    const tick = Math.round(this.state.tick);
    if (person === null || !Number.isFinite(tick) || this.chosen.length === 0) return;
    const asked = ++this.asked;
    const from = tick - CHART_S * this.state.venue.rate_hz;
    const past = await this.connection.series(person, this.indices(), from, tick).catch(() => null);
    // Somebody else may have been chosen meanwhile.
    if (past !== null && asked === this.asked && past.person === this.state.followed) this.merge(past);
  }

  /** The past, and behind it what came while it was asked for. */
  private merge(past: Series): void {
    const newer = this.series;
    this.series = new AngleSeries(this.chosen.length);
    past.ticks.forEach((tick, i) => {
      const unobserved = past.unobserved[i] ?? [];
      this.series.push(tick, (a) => {
        const isUnobserved = unobserved.includes(this.chosen[a]?.index ?? -1);
        return isUnobserved ? NaN : (past.values[i]?.[a] ?? NaN);
      });
    });
    for (let i = 0; i < newer.length; i++) {
      if (newer.tickAt(i) > this.series.lastTick) this.series.push(newer.tickAt(i), (a) => newer.valueAt(i, a));
    }
  }

  private picker(): HTMLElement {
    const groups = new Map<string, HTMLElement>();
    for (const angle of this.all) {
      let group = groups.get(angle.group);
      if (group === undefined) {
        group = element("fieldset", {}, element("legend", { text: angle.group }));
        groups.set(angle.group, group);
      }
      const box = element("input", { attributes: { type: "checkbox" } });
      box.checked = this.chosen.includes(angle);
      box.addEventListener("change", () => this.choose(angle, box));
      group.append(element("label", {}, box, element("span", { text: angle.name })));
    }
    const summary = element("summary", { text: "Choose angles" });
    return element("details", { class: "angle-picker" }, summary, ...groups.values());
  }

  private choose(angle: AngleReading, box: HTMLInputElement): void {
    if (box.checked && this.chosen.length >= MOST_ANGLES) {
      box.checked = false;
      return;
    }
    this.chosen = box.checked ? [...this.chosen, angle] : this.chosen.filter((other) => other !== angle);
    this.series = new AngleSeries(this.chosen.length);
    this.drawLegend();
    this.restart();
  }

  private drawLegend(): void {
    this.values.length = 0;
    this.legend.replaceChildren(
      ...this.chosen.map((angle, a) => {
        const swatch = element("i", { class: "swatch" });
        swatch.style.background = LINE_COLOURS[a] ?? "";
        const value = element("b", { text: UNKNOWN });
        this.values.push(value);
        return element("span", { class: "legend-entry" }, swatch, element("span", { text: angle.name }), value);
      }),
    );
  }
}
