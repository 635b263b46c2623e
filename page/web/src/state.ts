// What the page knows at the moment, for all panels to read; only main.ts writes it.

import type { ConnectionState } from "./connection.ts";
import type { People } from "./protocol/ticks.ts";
import type { IdentityEvent, Playback, Request } from "./protocol/text.ts";
import type { Status } from "./protocol/status.ts";
import type { Venue } from "./protocol/venue.ts";
import { SOURCE_WORDS, type SourceWords } from "./source_words.ts";

/** Events that are kept: as many as the server sends to who comes new. */
export const KEPT_EVENTS = 400;

export interface PageState {
  readonly venue: Venue;
  connection: ConnectionState;
  /** People of the drawn moment. */
  people: People;
  /** The drawn tick, with its fraction; NaN before the first. */
  tick: number;
  status: Status | null;
  /** The newest of all statuses, also while one of then is shown: what can be done now is told by it. */
  newestStatus: Status | null;
  /** Whether the newest status, of whatever moment one looks at, said that the run is over. */
  hasRunEnded: boolean;
  /** When the status came, as `performance.now()`. */
  status_ms: number;
  playback: Playback | null;
  names: ReadonlyMap<number, string>;
  /** In the order in which they happened. */
  events: IdentityEvent[];
  /** What this page may ask for beyond reading. */
  actions: ReadonlySet<string>;
  followed: number | null;
  /** The camera whose boxes and keypoints are asked for. */
  openCamera: number | null;
  /** Messages of the server that could not be read, and the last reason. */
  unreadable: number;
  unreadableReason: string;
}

/** What panels may ask for. */
export interface Actions {
  follow(person: number | null): void;
  openCamera(camera: number | null): void;
  lookThrough(camera: number): void;
  send(request: Request): void;
  /** The promise is what the server says against it, `null` when it was done. */
  ask(request: Request): Promise<string | null>;
  /** Tells the operator something for a few seconds. */
  say(text: string): void;
}

/** Key of the server's alarm that a run is over. */
export const RUN_ENDED = "run/ended";

/** Whether a moment is shown that is not the newest of those that come by themselves. */
export function isPast(state: PageState): boolean {
  return state.venue.mode !== "recording" && state.playback !== null && state.playback.state !== "live";
}

/** Whether what is shown was some other time, so that what was wrong then need not be wrong now. */
export function isOfThen(state: PageState): boolean {
  return state.venue.mode === "recording" || isPast(state);
}

/** Whether nothing comes any more, as it should be: a run is over, or somebody has ended what serves the page. */
export function hasEnded(state: PageState): boolean {
  return state.connection.kind === "away" && (state.hasRunEnded || state.connection.isEnded);
}

/**
 * How far in a recording `tick` is, seconds: from its first tick on; of a replay, which forgets the oldest in time, from the first tick of the
 * run that was recorded.
 */
export function runTime_s(state: PageState, tick: number, first: number): number {
  return (tick - (state.venue.mode === "recording" ? first : 0)) / state.venue.rate_hz;
}

/** How people call what the page shows. */
export function wordsOf(state: PageState): SourceWords {
  return SOURCE_WORDS[state.venue.mode];
}

/** The events of a session: its first ones come before its first tick. */
export function eventsOf(events: readonly IdentityEvent[], session: number): IdentityEvent[] {
  return events.filter((event) => event.session === session);
}

/** How people call somebody. */
export function nameOf(state: PageState, id: number): string {
  return state.names.get(id) ?? `Person ${id}`;
}
