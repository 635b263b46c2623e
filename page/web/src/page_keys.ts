// What each key of the page does, in the order in which the overlay lists them.

import type { Key } from "./keyboard.ts";
import type { Timeline } from "./panels/timeline.ts";
import type { Toolbar } from "./panels/toolbar.ts";
import type { View } from "./scene/view.ts";
import type { Theme } from "./theme.ts";

/** What keys act upon; panels are asked for late, because they are made after the keys. */
export interface KeyTargets {
  readonly view: View;
  readonly theme: Theme;
  toolbar(): Toolbar;
  timeline(): Timeline;
  openTab(at: number): void;
  followNext(step: number): void;
  escape(): void;
  /** To where the key of the newest moment goes. */
  readonly newest: string;
  /** `null`: this server records nothing. */
  readonly toggleRecording: (() => void) | null;
  showHelp(): void;
}

export function pageKeys(page: KeyTargets): Key[] {
  const key = (pressed: string, shown: string, group: string, does: string, act: () => void): Key => ({
    key: pressed,
    shown,
    group,
    does,
    act,
  });
  const nudge = (left: number, up: number, away: number) => (): void => page.view.nudge(left, up, away);
  return [
    key("f", "F", "View", "the whole field", () => page.toolbar().toField()),
    key("t", "T", "View", "from above", () => page.toolbar().toTop()),
    key("e", "E", "View", "follow the next person", () => page.followNext(1)),
    key("q", "Q", "View", "follow the person before", () => page.followNext(-1)),
    key("escape", "Esc", "View", "stop following; leave a camera", () => page.escape()),
    key("arrowleft", "←", "View", "turn left", nudge(-1, 0, 0)),
    key("arrowright", "→", "View", "turn right", nudge(1, 0, 0)),
    key("arrowup", "↑", "View", "higher", nudge(0, 1, 0)),
    key("arrowdown", "↓", "View", "lower", nudge(0, -1, 0)),
    key("+", "+", "View", "nearer", nudge(0, 0, -1)),
    key("-", "−", "View", "farther", nudge(0, 0, 1)),
    key("c", "C", "Shown", "certainty as colour", () => page.toolbar().toggleSigma()),
    key("n", "N", "Shown", "names", () => page.toolbar().toggle("labels")),
    key("p", "P", "Shown", "trails", () => page.toolbar().toggle("trails")),
    key("v", "V", "Shown", "cameras", () => page.toolbar().toggle("cameras")),
    key("b", "B", "Shown", "bones or bodies", () => page.toolbar().toggle("bones")),
    key("1", "1", "Shown", "people", () => page.openTab(0)),
    key("2", "2", "Shown", "cameras", () => page.openTab(1)),
    key("3", "3", "Shown", "links", () => page.openTab(2)),
    key("4", "4", "Shown", "events", () => page.openTab(3)),
    key("d", "D", "Shown", "dark or light", () => page.theme.toggle()),
    key(" ", "space", "Time", "pause or play", () => page.timeline().togglePlay()),
    key("l", "L", "Time", page.newest, () => page.timeline().goLive()),
    key(",", ",", "Time", "one tick back", () => page.timeline().step(-1)),
    key(".", ".", "Time", "one tick on", () => page.timeline().step(1)),
    key("j", "J", "Time", "five seconds back", () => page.timeline().skip(-5)),
    key("k", "K", "Time", "five seconds on", () => page.timeline().skip(5)),
    key("<", "<", "Time", "slower", () => page.timeline().faster(-1)),
    key(">", ">", "Time", "faster", () => page.timeline().faster(1)),
    key("o", "O", "Time", "loop about this moment", () => page.timeline().toggleLoop()),
    ...(page.toggleRecording === null ? [] : [key("r", "R", "Time", "start or stop a recording", page.toggleRecording)]),
    key("?", "?", "Time", "this list", () => page.showHelp()),
  ];
}
