// Colours that people with the common kinds of colour blindness can tell apart, as 0xRRGGBB in sRGB.

/** Persons, in turn: after Okabe and Ito 2008 ("Color Universal Design"), lightened where dark grounds need it. */
const PERSONS = [0xe69f00, 0x56b4e9, 0x1fb58a, 0xf0e442, 0x4a8fd6, 0xe8702a, 0xd98cb8, 0xb8b8c4] as const;

export function personColour(id: number): number {
  return PERSONS[id % PERSONS.length] ?? 0xffffff;
}

/** Viridis (van der Walt and Smith 2015), from where it can be seen on a dark ground: sure is blue, unsure yellow. */
const VIRIDIS = [0x414487, 0x355f8d, 0x2a788e, 0x21918c, 0x22a884, 0x44bf70, 0x7ad151, 0xbddf26, 0xfde725] as const;

/** Standard deviations at the ends of the key, metres. Between them the key is logarithmic. */
export const SIGMA_LEAST_M = 0.005;
export const SIGMA_MOST_M = 0.1;
/** A joint of which nothing is known. */
export const SIGMA_UNKNOWN_COLOUR = 0x8a8f98;
/** A limb that nothing determines; it is dashed as well, since a person's colour may be a grey. */
export const GUESS_COLOUR = SIGMA_UNKNOWN_COLOUR;

const SIGMA_SPAN = Math.log(SIGMA_MOST_M / SIGMA_LEAST_M);

/** Where a standard deviation stands on the key, 0 to 1. */
export function sigmaShare(sigma_m: number): number {
  return Math.min(1, Math.max(0, Math.log(sigma_m / SIGMA_LEAST_M) / SIGMA_SPAN));
}

export function sigmaColour(sigma_m: number): number {
  return Number.isFinite(sigma_m) && sigma_m > 0 ? viridis(sigmaShare(sigma_m)) : SIGMA_UNKNOWN_COLOUR;
}

/** The key's colour at a share of its length. */
export function viridis(share: number): number {
  const at = Math.min(1, Math.max(0, share)) * (VIRIDIS.length - 1);
  const i = Math.min(VIRIDIS.length - 2, Math.floor(at));
  return mix(VIRIDIS[i] ?? 0, VIRIDIS[i + 1] ?? 0, at - i);
}

export function mix(a: number, b: number, share: number): number {
  const channel = (shift: number): number => {
    const from = (a >> shift) & 255;
    return Math.round(from + (((b >> shift) & 255) - from) * share) << shift;
  };
  return channel(16) | channel(8) | channel(0);
}

export function css(colour: number): string {
  return `#${colour.toString(16).padStart(6, "0")}`;
}

/** How something is; every colour of it goes with a word or a sign. */
export type Level = "good" | "warning" | "failed" | "unknown";

export const LEVEL_COLOURS: Readonly<Record<Level, number>> = {
  good: 0x2bb39a,
  warning: 0xe69f00,
  failed: 0xf0503c,
  unknown: 0x8a8f98,
};

export const LEVEL_SIGNS: Readonly<Record<Level, string>> = { good: "✓", warning: "!", failed: "✕", unknown: "?" };
