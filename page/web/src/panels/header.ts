// The bar on top: whose venue it is, whether all is well, the numbers that matter, recording, theme, help.

import { button, element, setClass, setHidden, setText } from "../dom.ts";
import type { Status } from "../protocol/status.ts";
import { COASTING, TENTATIVE } from "../protocol/ticks.ts";
import { hasEnded, isOfThen, wordsOf, type Actions, type PageState } from "../state.ts";
import type { Theme } from "../theme.ts";
import { UNKNOWN, byteCount, count, fixed, milliseconds, wholeSeconds } from "../units.ts";

class Fact {
  readonly root: HTMLElement;
  private readonly value = element("b", { text: UNKNOWN });
  private readonly name = element("span");

  constructor(name: string, title: string) {
    this.root = element("div", { class: "fact", title }, this.value, this.name);
    setText(this.name, name);
  }

  set(text: string, name?: string): void {
    setText(this.value, text);
    if (name !== undefined) setText(this.name, name);
  }
}

export class Header {
  readonly root = element("header", { class: "bar" });
  private readonly state = element("span", { class: "pill", attributes: { role: "status" } });
  private readonly people = new Fact("people", "Confirmed people, and those that are not confirmed yet or not seen at the moment");
  private readonly rate = new Fact("poses/s", "Ticks per second for which fusion gives poses");
  private readonly delay = new Fact("delay", "From the picture to the pose: half of all poses are quicker (P50)");
  private readonly worst = new Fact("P99", "From the picture to the pose: 99 of 100 are quicker");
  private readonly record = button("Record", "Start or stop a recording (R)", () => void this.toggleRecording(), "record");
  private isRecording = false;
  private wasRunning = false;

  constructor(
    private readonly actions: Actions,
    venueName: string,
    theme: Theme,
    showHelp: () => void,
  ) {
    const themeButton = button("◐", "Dark or light (D)", () => theme.toggle(), "icon");
    const help = button("?", "Keys and signs (?)", showHelp, "icon");
    this.root.append(
      element("h1", {}, element("span", { class: "brand", text: "Farfield" }), element("span", { text: venueName })),
      this.state,
      element("div", { class: "facts" }, this.people.root, this.rate.root, this.delay.root, this.worst.root),
      this.record,
      themeButton,
      help,
    );
  }

  update(state: PageState): void {
    const [text, kind] = stateOf(state);
    setText(this.state, text);
    for (const name of ["good", "warning", "failed", "past"]) setClass(this.state, name, name === kind);
    this.people.set(...peopleText(state));
    this.rate.set(fixed(state.status?.posesPerSecond ?? null, 0));
    const whole = state.status?.latency.find((stage) => stage.stage === "capture_to_pose");
    this.delay.set(milliseconds(whole?.p50_us ?? null));
    this.worst.set(milliseconds(whole?.p99_us ?? null));
    // Poses of a replay come when they come, and have no delay.
    for (const fact of [this.delay, this.worst]) setHidden(fact.root, state.venue.mode === "replay");
    // Also of who looks back: what the button does is done now.
    const now = state.newestStatus;
    // A recording ends with its run.
    this.isRecording = !hasEnded(state) && (now?.recording?.isRunning ?? false);
    this.tellWhole(now);
    const may = state.actions.has("record");
    setHidden(this.record, !state.venue.actions.has("record") || (!may && !this.isRecording));
    this.record.disabled = !may || state.connection.kind !== "open";
    setClass(this.record, "on", this.isRecording);
    setText(this.record, this.isRecording ? recordingText(now) : "Record");
    this.record.title = recordingTitle(now);
  }

  /** Says where a recording is that this page has seen running, once it is whole. */
  private tellWhole(status: Status | null): void {
    const recording = status?.recording ?? null;
    if (recording === null) return;
    const isWhole = this.wasRunning && !recording.isRunning && recording.text !== null;
    // What failed is an alarm.
    if (isWhole && !recording.text.startsWith("failed")) this.actions.say(`Recorded: ${recording.text}`);
    this.wasRunning = recording.isRunning;
  }

  async toggleRecording(): Promise<void> {
    if (this.record.hidden || this.record.disabled) {
      this.actions.say("Recording needs the address with the token that fusion printed.");
      return;
    }
    const isEnd = this.isRecording;
    const error = await this.actions.ask({ do: isEnd ? "stop_recording" : "start_recording" });
    this.actions.say(error ?? (isEnd ? "The recording is being closed." : "The recording begins."));
    // Until the next status says so.
    if (error === null) this.isRecording = !isEnd;
  }
}

/** Since when it goes on, and how large it is. */
export function recordingText(status: Pick<Status, "at_us" | "recording"> | null): string {
  const { since_us = null, bytes = null } = status?.recording ?? {};
  const parts = ["Recording"];
  const at_us = status?.at_us ?? null;
  if (since_us !== null && at_us !== null) parts.push(wholeSeconds(Math.max(0, at_us - since_us) / 1e6));
  if (bytes !== null) parts.push(byteCount(bytes));
  return parts.join(" · ");
}

function recordingTitle(status: Status | null): string {
  const recording = status?.recording ?? null;
  const todo = "Start or stop a recording (R)";
  if (recording?.text == null) return todo;
  if (recording.isRunning) return `${todo}: ${recording.text}`;
  const size = recording.bytes === null ? "" : `, ${byteCount(recording.bytes)}`;
  return `${todo}. The last: ${recording.text}${size}`;
}

/** Number and name: those who are confirmed and seen, and how many are not. */
function peopleText(state: PageState): [string, string] {
  let confirmed = 0;
  let others = 0;
  for (let i = 0; i < state.people.count; i++) {
    const phase = state.people.states[i];
    if (phase === TENTATIVE || phase === COASTING) others++;
    else confirmed++;
  }
  const name = confirmed === 1 ? "person" : "people";
  return [`${confirmed}`, others === 0 ? name : `${name}, ${others} unsure`];
}

/** How everything is, in a word, and how that is coloured. */
export function stateOf(state: PageState): [string, "good" | "warning" | "failed" | "past"] {
  switch (state.connection.kind) {
    case "connecting":
      return ["Connecting", "past"];
    case "asleep":
      return ["Asleep", "past"];
    case "refused":
      return ["Refused", "failed"];
    case "away":
      return hasEnded(state) ? [wordsOf(state).ended, "past"] : [wordsOf(state).away, "failed"];
    case "open":
  }
  // Nobody says of a replay whether all was well.
  if (state.venue.mode === "replay") return ["Replay", "past"];
  const alarms = state.status?.alarms ?? [];
  const failed = alarms.filter((alarm) => alarm.severity === "failed").length;
  // Who looks back sees what was wrong then.
  const then = isOfThen(state) ? "Then: " : "";
  if (failed > 0) return [`${then}✕ ${count(failed, "failure", "failures")}`, "failed"];
  if (state.hasRunEnded && then === "") return [wordsOf(state).ended, "past"];
  if (alarms.length > 0) return [`${then}! ${count(alarms.length, "warning", "warnings")}`, "warning"];
  if (state.status === null) return ["Connected", "past"];
  return then === "" ? ["✓ All is well", "good"] : ["Then: ✓ all was well", "past"];
}
