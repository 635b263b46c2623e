// The `status` of the server, once a second: alarms, nodes, links, cameras, delays.

import { Fields, numberOf, textOf } from "./checked.ts";

export const STATES = ["works", "warning", "failed", "unknown"] as const;
export type State = (typeof STATES)[number];
export const CAMERA_STATES = ["works", "frozen", "black", "silent", "failed", "unknown"] as const;
export type CameraState = (typeof CAMERA_STATES)[number];

export const VERDICTS = ["unknown", "agrees", "disagrees"] as const;
export type Verdict = (typeof VERDICTS)[number];

export interface Alarm {
  readonly severity: "failed" | "warning";
  readonly key: string;
  readonly subject: string;
  readonly text: string;
  readonly remedy: string;
  readonly since_us: number | null;
}

export interface StageTime {
  readonly stage: string;
  readonly p50_us: number;
  readonly p99_us: number;
}

export interface NodeStatus {
  readonly name: string;
  readonly kind: string;
  readonly state: State;
  readonly heardAgo_s: number | null;
  readonly release: string | null;
  readonly ticksPerSecond: number | null;
  readonly backend: string | null;
  readonly failure: string | null;
  readonly notices: readonly string[];
  readonly missedTicks: number | null;
  readonly stages: readonly StageTime[];
}

export interface LinkStatus {
  readonly viewpoint: number;
  readonly name: string;
  readonly state: State;
  readonly refused: string | null;
  readonly roundTrip_us: number | null;
  readonly clockOffset_us: number | null;
  readonly clockUncertainty_us: number | null;
  readonly horizon_ticks: number | null;
  readonly bytesPerSecond: number | null;
  readonly budgetBytesPerSecond: number | null;
  readonly compressionLevel: number | null;
  readonly usualLevel: number | null;
  readonly personsPerTick: number | null;
  readonly everyNthTick: number | null;
  readonly late: number | null;
  readonly missing: number | null;
  readonly latePerSecond: number | null;
  readonly missingPerSecond: number | null;
}

export interface CameraStatus {
  readonly camera: number;
  readonly name: string;
  readonly state: CameraState;
  readonly framesPerSecond: number | null;
  readonly captureOffset_us: number | null;
  readonly reason: string | null;
  /** Null where nothing could be compared. */
  readonly agreement: Agreement | null;
  readonly persons: readonly number[];
}

/** How a camera agrees with the others. */
export interface Agreement {
  readonly verdict: Verdict;
  readonly distance_mm: number | null;
  readonly distance_px: number | null;
  readonly late_ticks: number | null;
}

export interface Recording {
  readonly isRunning: boolean;
  /** Its name, or what became of it. */
  readonly text: string | null;
  /** When it began, microseconds of Unix time. */
  readonly since_us: number | null;
  readonly bytes: number | null;
}

export interface Status {
  readonly tick: number | null;
  /** When it was so, Unix time by the server's clock. */
  readonly at_us: number | null;
  readonly alarms: readonly Alarm[];
  readonly nodes: readonly NodeStatus[];
  readonly links: readonly LinkStatus[];
  readonly cameras: readonly CameraStatus[];
  readonly latency: readonly StageTime[];
  readonly latencyWindow_s: number | null;
  readonly posesPerSecond: number | null;
  readonly recording: Recording | null;
}

export function readStatus(fields: Fields): Status {
  const latency = fields.objectOrNull("latency");
  return {
    tick: fields.numberOrNull("tick"),
    at_us: fields.numberOrNull("at_us"),
    alarms: fields.list("alarms", (value, path) => readAlarm(Fields.of(value, path))),
    nodes: fields.list("nodes", (value, path) => readNode(Fields.of(value, path))),
    links: fields.list("links", (value, path) => readLink(Fields.of(value, path))),
    cameras: fields.list("cameras", (value, path) => readCamera(Fields.of(value, path))),
    latency: latency?.list("stages", readStage) ?? [],
    latencyWindow_s: latency?.numberOrNull("window_s") ?? null,
    posesPerSecond: fields.numberOrNull("poses_per_s"),
    recording: readRecording(fields.objectOrNull("recording")),
  };
}

function readRecording(fields: Fields | null): Recording | null {
  return fields && {
    isRunning: fields.flag("running"),
    text: fields.textOrNull("text"),
    since_us: fields.numberOrNull("since_us"),
    bytes: fields.numberOrNull("bytes"),
  };
}

function readAlarm(fields: Fields): Alarm {
  return {
    severity: fields.word("severity", ["failed", "warning"]),
    key: fields.text("key"),
    subject: fields.text("subject"),
    text: fields.text("text"),
    remedy: fields.text("remedy"),
    since_us: fields.numberOrNull("since_us"),
  };
}

function readStage(value: unknown, path: string): StageTime {
  const fields = Fields.of(value, path);
  return { stage: fields.text("stage"), p50_us: fields.number("p50_us"), p99_us: fields.number("p99_us") };
}

function readNode(fields: Fields): NodeStatus {
  return {
    name: fields.text("name"),
    kind: fields.text("kind"),
    state: fields.word("state", STATES),
    heardAgo_s: fields.numberOrNull("heard_ago_s"),
    release: fields.textOrNull("release"),
    ticksPerSecond: fields.numberOrNull("ticks_per_s"),
    backend: fields.textOrNull("backend"),
    failure: fields.textOrNull("failure"),
    notices: fields.list("notices", textOf),
    missedTicks: fields.numberOrNull("missed_ticks"),
    stages: fields.list("stages", readStage),
  };
}

function readLink(fields: Fields): LinkStatus {
  return {
    viewpoint: fields.whole("viewpoint"),
    name: fields.text("name"),
    state: fields.word("state", STATES),
    refused: fields.textOrNull("refused"),
    roundTrip_us: fields.numberOrNull("round_trip_us"),
    clockOffset_us: fields.numberOrNull("clock_offset_us"),
    clockUncertainty_us: fields.numberOrNull("clock_uncertainty_us"),
    horizon_ticks: fields.numberOrNull("horizon_ticks"),
    bytesPerSecond: fields.numberOrNull("bytes_per_s"),
    budgetBytesPerSecond: fields.numberOrNull("budget_bytes_per_s"),
    compressionLevel: fields.numberOrNull("compression_level"),
    usualLevel: fields.numberOrNull("usual_level"),
    personsPerTick: fields.numberOrNull("persons_per_tick"),
    everyNthTick: fields.numberOrNull("every_nth_tick"),
    late: fields.numberOrNull("late"),
    missing: fields.numberOrNull("missing"),
    latePerSecond: fields.numberOrNull("late_per_s"),
    missingPerSecond: fields.numberOrNull("missing_per_s"),
  };
}

function readCamera(fields: Fields): CameraStatus {
  return {
    camera: fields.whole("camera"),
    name: fields.text("name"),
    state: fields.word("state", CAMERA_STATES),
    framesPerSecond: fields.numberOrNull("frames_per_s"),
    captureOffset_us: fields.numberOrNull("capture_offset_us"),
    reason: fields.textOrNull("reason"),
    agreement: readAgreement(fields.objectOrNull("agreement")),
    persons: fields.list("persons", numberOf),
  };
}

function readAgreement(fields: Fields | null): Agreement | null {
  return (
    fields && {
      verdict: fields.word("verdict", VERDICTS),
      distance_mm: fields.numberOrNull("distance_mm"),
      distance_px: fields.numberOrNull("distance_px"),
      late_ticks: fields.numberOrNull("late_ticks"),
    }
  );
}
