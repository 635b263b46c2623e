// Numbers as operators read them. What is unknown is a dash, never a zero.

export const UNKNOWN = "–";

export function fixed(value: number | null, digits: number): string {
  return value === null || !Number.isFinite(value) ? UNKNOWN : value.toFixed(digits);
}

/** Microseconds as milliseconds. */
export function milliseconds(us: number | null): string {
  if (us === null || !Number.isFinite(us)) return UNKNOWN;
  const ms = us / 1000;
  return `${ms.toFixed(Math.abs(ms) < 10 ? 1 : 0)} ms`;
}

export function bytesPerSecond(bytes: number | null): string {
  return bytes === null ? UNKNOWN : `${byteCount(bytes)}/s`;
}

export function byteCount(bytes: number): string {
  if (!Number.isFinite(bytes)) return UNKNOWN;
  if (bytes < 1000) return `${bytes.toFixed(0)} B`;
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(bytes < 1e4 ? 1 : 0)} kB`;
  if (bytes < 1e9) return `${(bytes / 1e6).toFixed(bytes < 1e7 ? 2 : 1)} MB`;
  return `${(bytes / 1e9).toFixed(2)} GB`;
}

/** Seconds as m:ss.d, with a minus sign where negative. */
export function clockTime(seconds: number): string {
  const sign = seconds < 0 ? "−" : "";
  const tenths = Math.round(Math.abs(seconds) * 10);
  const whole = Math.floor(tenths / 10);
  const minutes = Math.floor(whole / 60);
  return `${sign}${minutes}:${String(whole % 60).padStart(2, "0")}.${tenths % 10}`;
}

/** Seconds as m:ss, or h:mm:ss. */
export function wholeSeconds(seconds: number): string {
  const whole = Math.floor(seconds);
  const two = (n: number): string => String(n % 60).padStart(2, "0");
  const [minutes, hours] = [Math.floor(whole / 60), Math.floor(whole / 3600)];
  return hours > 0 ? `${hours}:${two(minutes)}:${two(whole)}` : `${minutes}:${two(whole)}`;
}

/** One or many: `count(1, "person", "people")`. */
export function count(n: number, one: string, many: string): string {
  return `${n} ${n === 1 ? one : many}`;
}

/** A name of the model as words: `right_hip` becomes `right hip`. */
export function words(name: string): string {
  return name.replaceAll("_", " ");
}
