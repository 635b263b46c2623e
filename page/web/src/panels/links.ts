// Links and nodes: bytes against the budget, delay, loss, compression level, shed persons, clocks; how the delay is made up.

import { KeyedChildren, element, setClass, setHidden, setText } from "../dom.ts";
import { LEVEL_SIGNS, type Level } from "../palette.ts";
import { LatencyChart, PARTS, WHOLE } from "../charts/latency_chart.ts";
import type { ChartColours } from "../charts/pen.ts";
import type { LinkStatus, NodeStatus, StageTime, State, Status } from "../protocol/status.ts";
import type { Mode } from "../protocol/venue.ts";
import { REPLAY_TELLS } from "../source_words.ts";
import type { PageState } from "../state.ts";
import { UNKNOWN, bytesPerSecond, fixed, milliseconds, words } from "../units.ts";

const LEVEL_OF: Readonly<Record<State, Level>> = { works: "good", warning: "warning", failed: "failed", unknown: "unknown" };
const PART_NAMES: Readonly<Record<string, string>> = { capture_to_send: "at the edge", link: "link", fusion: "fusion" };
const PART_COLOURS = ["#4a8fd6", "#1fb58a", "#d98cb8"] as const;

function lampOf(lamp: HTMLElement, level: Level): void {
  setText(lamp, LEVEL_SIGNS[level]);
  for (const name of ["good", "warning", "failed", "unknown"]) setClass(lamp, name, name === level);
}

class Fact {
  readonly root = element("div");
  private readonly value = element("dd");

  constructor(name: string, title: string) {
    this.root.title = title;
    this.root.append(element("dt", { text: name }), this.value);
  }

  set(text: string, isBad = false): void {
    setText(this.value, text);
    setClass(this.value, "bad", isBad);
  }
}

class LinkCard {
  readonly root = element("article", { class: "card" });
  private readonly lamp = element("span", { class: "lamp" });
  private readonly name = element("b");
  private readonly said = element("p", { class: "card-said" });
  private readonly used = element("i");
  private readonly budget = element("div", { class: "budget", title: "Bytes against the link's budget" }, this.used);
  private readonly bytes = new Fact("sends", "Payload that arrived in the last second, of the link's budget");
  private readonly trip = new Fact("round trip", "There and back on the network alone");
  private readonly loss = new Fact("missing / late", "Ticks per second of which nothing came, and that came too late");
  private readonly level = new Fact("compression level", "0: lossless, 6: fewest bytes; how the edge keeps its link free");
  private readonly shed = new Fact("persons sent", "Persons per tick whose maps are sent; where not all are, they come in turn");
  private readonly clock = new Fact("clock", "The edge's clock less that of fusion, and how far that may be off");

  constructor() {
    const facts = [this.bytes, this.trip, this.loss, this.level, this.shed, this.clock];
    const list = element("dl", {}, ...facts.map((fact) => fact.root));
    this.root.append(element("div", { class: "card-head" }, this.lamp, this.name), this.said, this.budget, list);
  }

  fill(link: LinkStatus): void {
    lampOf(this.lamp, LEVEL_OF[link.state]);
    setText(this.name, link.name);
    setText(this.said, link.refused === null ? "" : `Refused: ${link.refused}`);
    setHidden(this.said, link.refused === null);
    const share = link.bytesPerSecond !== null && link.budgetBytesPerSecond ? link.bytesPerSecond / link.budgetBytesPerSecond : 0;
    this.used.style.width = `${Math.min(100, 100 * share).toFixed(0)}%`;
    setClass(this.budget, "full", share > 0.9);
    setHidden(this.budget, link.budgetBytesPerSecond === null);
    const of = link.budgetBytesPerSecond === null ? "" : ` of ${bytesPerSecond(link.budgetBytesPerSecond)}`;
    this.bytes.set(`${bytesPerSecond(link.bytesPerSecond)}${of}`, share > 0.9);
    this.trip.set(milliseconds(link.roundTrip_us));
    const isLossy = (link.missingPerSecond ?? 0) >= 1 || (link.latePerSecond ?? 0) >= 1;
    this.loss.set(`${fixed(link.missingPerSecond, 1)} / ${fixed(link.latePerSecond, 1)} per s`, isLossy);
    const isAbove = link.compressionLevel !== null && link.usualLevel !== null && link.compressionLevel > link.usualLevel;
    this.level.set(levelText(link, isAbove), isAbove);
    const isShed = link.personsPerTick !== null || (link.everyNthTick ?? 1) > 1;
    this.shed.set(shedText(link), isShed);
    this.clock.set(clockText(link));
  }
}

function levelText(link: LinkStatus, isAbove: boolean): string {
  if (link.compressionLevel === null) return UNKNOWN;
  return isAbove ? `${link.compressionLevel} (usually ${link.usualLevel ?? 0})` : `${link.compressionLevel}`;
}

function shedText(link: LinkStatus): string {
  const persons = link.personsPerTick === null ? "all" : `${link.personsPerTick} a tick, in turn`;
  const every = link.everyNthTick ?? 1;
  return every > 1 ? `${persons}, every ${every}. tick` : persons;
}

function clockText(link: LinkStatus): string {
  if (link.clockOffset_us === null) return UNKNOWN;
  const sign = link.clockOffset_us < 0 ? "−" : "+";
  const uncertainty = link.clockUncertainty_us === null ? "" : ` ± ${(link.clockUncertainty_us / 1000).toFixed(2)}`;
  return `${sign}${(Math.abs(link.clockOffset_us) / 1000).toFixed(2)}${uncertainty} ms`;
}

class NodeRow {
  readonly root = element("article", { class: "card" });
  private readonly lamp = element("span", { class: "lamp" });
  private readonly name = element("b");
  private readonly about = element("span", { class: "card-about" });
  private readonly said = element("p", { class: "card-said" });

  constructor() {
    this.root.append(element("div", { class: "card-head" }, this.lamp, this.name, this.about), this.said);
  }

  fill(node: NodeStatus): void {
    lampOf(this.lamp, LEVEL_OF[node.state]);
    setText(this.name, node.name === node.kind ? node.name : `${node.kind} ${node.name}`);
    const rate = node.ticksPerSecond === null ? "" : `${node.ticksPerSecond.toFixed(0)} ticks/s`;
    const silent = (node.heardAgo_s ?? 0) > 3 ? `not heard for ${node.heardAgo_s?.toFixed(0)} s` : "";
    setText(this.about, [rate, silent, node.backend ?? "", node.release ?? ""].filter((part) => part !== "").join(" · "));
    const slow = node.stages.map((stage) => `${words(stage.stage)} ${milliseconds(stage.p50_us)}`).slice(0, 6);
    const said = [node.failure ?? "", ...node.notices].filter((text) => text !== "");
    setText(this.said, said.length > 0 ? said.join(" · ") : slow.join(" · "));
    setClass(this.said, "bad", said.length > 0);
  }
}

export class LinksPanel {
  readonly root = element("div", { class: "links" });
  private readonly chart = new LatencyChart();
  private readonly stages = element("div", { class: "stage-bar", attributes: { role: "img" } });
  private readonly stageText = element("p", { class: "hint" });
  private readonly linkList = element("div", { class: "cards" });
  private readonly nodeList = element("div", { class: "cards" });
  private readonly links = new KeyedChildren(this.linkList, () => new LinkCard());
  private readonly nodes = new KeyedChildren(this.nodeList, () => new NodeRow());
  private readonly noLinks = element("p", { class: "hint", text: "No links: nothing is known of edges at this moment." });

  constructor(mode: Mode) {
    if (mode === "replay") {
      this.root.append(element("p", { class: "hint", text: REPLAY_TELLS }));
      return;
    }
    this.root.append(
      element("h3", { text: "Delay from capture to pose" }),
      this.chart.chart.canvas,
      this.stages,
      this.stageText,
      element("h3", { text: "Links, edge to fusion" }),
      this.noLinks,
      this.linkList,
      element("h3", { text: "Nodes" }),
      this.nodeList,
    );
    for (const colour of PART_COLOURS) {
      const part = element("i");
      part.style.background = colour;
      this.stages.append(part);
    }
  }

  /** Takes a status, also while the panel is not shown: its plot goes on. */
  take(status: Status): void {
    this.chart.push(status.latency);
  }

  update(state: PageState): void {
    const status = state.status;
    const links = status?.links ?? [];
    setHidden(this.noLinks, links.length > 0);
    this.links.update(links.map((link) => `${link.viewpoint}/${link.name}`), (card, i) => {
      const link = links[i];
      if (link !== undefined) card.fill(link);
    });
    const nodes = status?.nodes ?? [];
    this.nodes.update(nodes.map((node) => `${node.kind}/${node.name}`), (row, i) => {
      const node = nodes[i];
      if (node !== undefined) row.fill(node);
    });
    this.fillStages(status?.latency ?? []);
  }

  draw(colours: ChartColours): void {
    this.chart.draw(colours);
  }

  private fillStages(stages: readonly StageTime[]): void {
    const p50 = (name: string): number => stages.find((stage) => stage.stage === name)?.p50_us ?? 0;
    const sum = PARTS.reduce((total, part) => total + p50(part), 0);
    PARTS.forEach((part, i) => {
      const bar = this.stages.children[i] as HTMLElement | undefined;
      if (bar !== undefined) bar.style.flexGrow = sum === 0 ? "1" : `${p50(part) / sum}`;
    });
    const parts = PARTS.map((part) => `${PART_NAMES[part]} ${milliseconds(p50(part))}`).join(" + ");
    const whole = stages.find((stage) => stage.stage === WHOLE);
    const text = whole === undefined ? "Not known at this moment." : `Median ${milliseconds(whole.p50_us)}, 99 of 100 within ${milliseconds(whole.p99_us)}. Medians of the parts: ${parts}`;
    setText(this.stageText, text);
    this.stages.setAttribute("aria-label", text);
  }
}
