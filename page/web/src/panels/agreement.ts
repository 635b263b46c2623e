// How far cameras are from each other, in words.

import type { Agreement } from "../protocol/status.ts";
import { fixed } from "../units.ts";

/** How far a camera is from the others, in words, whatever makes it so; empty where nothing could be compared. */
export function agreementInWords(agreement: Agreement | null): string {
  if (agreement === null || agreement.distance_mm === null) return "";
  const late = agreement.late_ticks ?? 0;
  const clock = Math.abs(late) < 0.05 ? "" : `, ${fixed(Math.abs(late), 1)} ticks ${late > 0 ? "late" : "early"}`;
  const apart = `${fixed(agreement.distance_mm, 0)} mm`;
  switch (agreement.verdict) {
    case "agrees":
      return `agrees to ${apart}${clock}`;
    case "disagrees":
      return `${apart} off the others${clock}`;
    case "unknown":
      return `${apart} from the others, not yet judged`;
  }
}
