// What the page knows at the moment, for all panels to read; only main.ts writes it.

import type { ConnectionState } from "./connection.ts";
import type { People } from "./protocol/ticks.ts";
import type { IdentityEvent, Playback, Request } from "./protocol/text.ts";
import type { Status } from "./protocol/status.ts";
import type { Venue } from "./protocol/venue.ts";

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

/** Whether a moment of a live venue is shown that is not now. */
export function isPast(state: PageState): boolean {
  return state.venue.mode === "live" && state.playback !== null && state.playback.state !== "live";
}

/** The events of a session: its first ones come before its first tick. */
export function eventsOf(events: readonly IdentityEvent[], session: number): IdentityEvent[] {
  return events.filter((event) => event.session === session);
}

/** How people call somebody. */
export function nameOf(state: PageState, id: number): string {
  return state.names.get(id) ?? `Person ${id}`;
}
