// How far cameras are from each other, in words.

import type { Agreement } from "../protocol/status.ts";
import { fixed } from "../units.ts";

/** How far a camera is from the others, in words; empty where nothing could be compared. */
export function agreementInWords(agreement: Agreement | null): string {
  if (agreement === null || agreement.distance_mm === null) return "";
  const late = agreement.late_ticks ?? 0;
  const clock = Math.abs(late) < 0.05 ? "" : `, ${fixed(Math.abs(late), 1)} ticks ${late > 0 ? "late" : "early"}`;
  return `agrees to ${fixed(agreement.distance_mm, 0)} mm${clock}`;
}
