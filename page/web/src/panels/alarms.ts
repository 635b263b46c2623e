// What is wrong, first of all: in words, with what mends it. The worst stands on top.

import { KeyedChildren, button, element, setClass, setHidden, setText } from "../dom.ts";
import { LEVEL_SIGNS } from "../palette.ts";
import { RUN_ENDED, hasEnded, wordsOf, type PageState } from "../state.ts";
import { grouped, type Alarm, type AlarmGroup } from "./alarm_groups.ts";

/** Alarms that are shown before somebody asks for all. */
const FIRST_FEW = 3;

/** Keys of alarms that the page raises itself; the server has no such keys. */
const OWN = "here/";
/** What is told where alarms are, and is none: an end. */
const ENDS = new Set([`${OWN}away`, RUN_ENDED]);

class Row {
  readonly root = element("li", { class: "alarm" });
  private readonly sign = element("span", { class: "alarm-sign", attributes: { "aria-hidden": "true" } });
  private readonly text = element("strong");
  private readonly remedy = element("span", { class: "alarm-remedy" });
  private shownRemedy = "";
  private readonly since = element("span", { class: "alarm-since" });
  private readonly each = element("ul", { class: "alarm-each" });
  private readonly lines = new KeyedChildren(this.each, () => ({ root: element("li") }));
  private readonly open = button("", "Show each of them", () => this.toggle(), "alarm-open");

  constructor() {
    const words = element("div", { class: "alarm-words" }, this.text, this.remedy, this.each);
    this.root.append(this.sign, words, this.open, this.since);
    this.setOpen(false);
  }

  fill(alarm: AlarmGroup, now_us: number): void {
    setHidden(this.open, alarm.members.length === 0);
    this.lines.update(
      alarm.members.map((member) => member.key),
      (line, i) => setText(line.root, sentence(alarm.members[i]?.text ?? "")),
    );
    const isNote = !alarm.isFailed && ENDS.has(alarm.key);
    setClass(this.root, "failed", alarm.isFailed);
    setClass(this.root, "note", isNote);
    setText(this.sign, alarm.isFailed ? LEVEL_SIGNS.failed : isNote ? "■" : LEVEL_SIGNS.warning);
    setText(this.text, sentence(alarm.text));
    this.setRemedy(alarm.remedy === "" ? "" : sentence(alarm.remedy));
    setText(this.since, alarm.since_us === null ? "" : duration((now_us - alarm.since_us) / 1e6));
  }

  private toggle(): void {
    this.setOpen(this.each.hidden);
  }

  private setOpen(isOpen: boolean): void {
    setHidden(this.each, !isOpen);
    setText(this.open, isOpen ? "Together" : "Each");
    this.open.setAttribute("aria-expanded", isOpen ? "true" : "false");
  }

  /** Commands stand between backticks, and are set as such. */
  private setRemedy(text: string): void {
    if (text === this.shownRemedy) return;
    this.shownRemedy = text;
    const parts = text.split("`");
    this.remedy.replaceChildren(...parts.map((part, i) => (i % 2 === 1 ? element("code", { text: part }) : part)));
  }
}

export class AlarmStrip {
  readonly root = element("section", { class: "alarms", label: "Alarms" });
  private readonly list = element("ul");
  private readonly rows = new KeyedChildren(this.list, () => new Row());
  private readonly more = button("", "Show all alarms", () => this.toggle(), "alarms-more");
  /** For who hears the page: texts that count seconds would be read out every second, so this changes with the alarms. */
  readonly announced = element("div", { class: "unseen", attributes: { role: "alert" } });
  private shownKeys = "";
  private areAllShown = false;

  constructor() {
    this.root.append(this.list, this.more);
  }

  update(state: PageState): void {
    const alarms = grouped(alarmsOf(state));
    const few = this.areAllShown ? alarms : alarms.slice(0, FIRST_FEW);
    // By the server's clock, which the page's need not agree with; while one looks back, by the time that is shown.
    const then_us = state.status?.at_us ?? Date.now() * 1000;
    const now_us = then_us + (performance.now() - state.status_ms) * 1000;
    this.rows.update(
      few.map((alarm) => alarm.key),
      (row, i) => {
        const alarm = few[i];
        if (alarm !== undefined) row.fill(alarm, alarm.key.startsWith(OWN) ? Date.now() * 1000 : now_us);
      },
    );
    const keys = alarms.map((alarm) => alarm.key).join(" ");
    if (keys !== this.shownKeys) {
      this.shownKeys = keys;
      setText(this.announced, alarms.length === 0 ? "No alarms" : alarms.map((alarm) => alarm.text).join(". "));
    }
    const hidden = alarms.length - few.length;
    setHidden(this.more, hidden === 0 && !this.areAllShown);
    setText(this.more, this.areAllShown ? "Show fewer" : `${hidden} more`);
    setHidden(this.root, alarms.length === 0);
  }

  private toggle(): void {
    this.areAllShown = !this.areAllShown;
  }
}

/** Alarms of the server, and before them what only the page can know: that the server is away. */
export function alarmsOf(state: PageState): Alarm[] {
  const own: Alarm[] = [];
  const connection = state.connection;
  if (connection.kind === "away") {
    const words = wordsOf(state);
    const isEnd = hasEnded(state);
    own.push({
      key: `${OWN}away`,
      isFailed: !isEnd,
      text: isEnd ? words.ended : `Nothing comes from ${words.name}: ${connection.reason}`,
      remedy: isEnd ? words.afterEnd : words.remedy,
      since_us: connection.since_ms * 1000,
    });
  }
  if (connection.kind === "refused") {
    own.push({ key: `${OWN}refused`, isFailed: true, text: "This page is refused", remedy: connection.reason, since_us: null });
  }
  if (state.unreadable > 0) {
    own.push({
      key: `${OWN}unreadable`,
      isFailed: false,
      text: `${state.unreadable} messages of ${wordsOf(state).name} could not be read: ${state.unreadableReason}`,
      remedy: "Load the page again; if it stays, the page and what serves it are of different releases.",
      since_us: null,
    });
  }
  // Once the end is told by the page itself, since when nothing comes, it is not told twice.
  const told = (state.status?.alarms ?? []).filter((alarm) => alarm.key !== RUN_ENDED || !hasEnded(state));
  const theirs = told.map((alarm) => ({
    key: alarm.key,
    isFailed: alarm.severity === "failed",
    text: alarm.text,
    remedy: alarm.remedy,
    since_us: alarm.since_us,
  }));
  const seen = new Set<string>();
  return [...own, ...theirs].filter((alarm) => !seen.has(alarm.key) && seen.add(alarm.key));
}

/** With a capital letter, as words on their own stand. */
function sentence(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}

function duration(s: number): string {
  if (!Number.isFinite(s) || s < 1) return "now";
  if (s < 120) return `${Math.floor(s)} s`;
  if (s < 7200) return `${Math.floor(s / 60)} min`;
  return `${Math.floor(s / 3600)} h`;
}
