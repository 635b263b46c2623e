// The text messages of the server, and what the page asks of it.

import { Fields, ProtocolError } from "./checked.ts";
import { readStatus, type Status } from "./status.ts";

export interface IdentityEvent {
  /** Ids of two sessions are unrelated. */
  readonly session: number;
  readonly tick: number;
  readonly at_us: number;
  readonly person: number;
  readonly other: number | null;
  readonly change: string;
  readonly text: string;
}

export interface Playback {
  readonly state: "live" | "playing" | "paused";
  readonly tick: number | null;
  readonly speed: number;
  readonly loop: readonly [number, number] | null;
  readonly first: number | null;
  readonly last: number | null;
  readonly isLoading: boolean;
}

export type TextMessage =
  | { type: "hello"; mayAct: boolean; actions: readonly string[] }
  | { type: "names"; names: ReadonlyMap<number, string> }
  | { type: "events"; events: readonly IdentityEvent[] }
  | { type: "playback"; playback: Playback }
  | { type: "status"; status: Status }
  | { type: "answer"; request: number | null; isOk: boolean; error: string | null };

export type Request =
  | { do: "live" | "pause" | "start_recording" | "stop_recording" }
  | { do: "seek"; tick: number }
  | { do: "step"; ticks: number }
  | { do: "play"; speed: number; loop?: readonly [number, number] }
  | { do: "camera"; camera: number | null }
  | { do: "angles"; persons: readonly number[]; angles: readonly number[] }
  | { do: "rate"; hz: number | null }
  | { do: "name_person"; person: number; name: string };

/** Longest name of a person, characters. */
export const MOST_NAME_CHARACTERS = 64;

/** Reads a text message; `null` of a type that this page does not know. */
export function readText(text: string): TextMessage | null {
  let json: unknown;
  try {
    json = JSON.parse(text);
  } catch {
    throw new ProtocolError("a text message that is not JSON");
  }
  const fields = Fields.of(json, "message");
  switch (fields.text("type")) {
    case "hello":
      return { type: "hello", mayAct: fields.flag("may_act"), actions: fields.list("actions", String) };
    case "names":
      return { type: "names", names: readNames(fields.object("names")) };
    case "events":
      return { type: "events", events: fields.list("events", (v, path) => readEvent(Fields.of(v, path))) };
    case "playback":
      return { type: "playback", playback: readPlayback(fields) };
    case "status":
      return { type: "status", status: readStatus(fields) };
    case "answer":
      return {
        type: "answer",
        request: fields.numberOrNull("request"),
        isOk: fields.flag("ok"),
        error: fields.textOrNull("error"),
      };
    default:
      return null;
  }
}

function readNames(fields: Fields): Map<number, string> {
  const names = new Map<number, string>();
  for (const key of fields.names()) {
    const id = Number(key);
    if (Number.isInteger(id) && id >= 0) names.set(id, fields.text(key).slice(0, MOST_NAME_CHARACTERS));
  }
  return names;
}

function readEvent(fields: Fields): IdentityEvent {
  return {
    session: fields.whole("session"),
    tick: fields.number("tick"),
    at_us: fields.number("at_us"),
    person: fields.whole("person"),
    other: fields.wholeOrNull("other"),
    change: fields.text("change"),
    text: fields.text("text"),
  };
}

function readPlayback(fields: Fields): Playback {
  const loop = fields.numbersOrNull("loop", 2);
  return {
    state: fields.word("state", ["playing", "paused", "live"]),
    tick: fields.numberOrNull("tick"),
    speed: fields.number("speed", -64, 64),
    loop: loop && [loop[0] ?? 0, loop[1] ?? 0],
    first: fields.numberOrNull("first"),
    last: fields.numberOrNull("last"),
    isLoading: fields.flag("loading"),
  };
}

/** `GET /api/series`: the past of chosen angles. */
export interface Series {
  readonly session: number;
  readonly person: number;
  readonly angles: readonly number[];
  readonly ticks: readonly number[];
  readonly values: readonly (readonly number[])[];
  /** Per tick: which of the angles a prior carried. */
  readonly unobserved: readonly (readonly number[])[];
}

export function readSeries(json: unknown): Series {
  const fields = Fields.of(json, "series");
  const row = (value: unknown, path: string): number[] => Fields.of({ row: value }, path).list("row", Number);
  const series = {
    session: fields.whole("session"),
    person: fields.whole("person"),
    angles: fields.list("angles", Number),
    ticks: fields.list("ticks", Number),
    values: fields.list("values", row),
    unobserved: fields.list("unobserved", row),
  };
  if (series.values.length !== series.ticks.length || series.unobserved.length !== series.ticks.length) {
    throw new ProtocolError("series.values has not a row per tick");
  }
  return series;
}
