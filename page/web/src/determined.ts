// Which joints nothing determines at the moment: what is seen does not say where they are, and the body model carries them.
//
// Overlays and exports take a joint for unknown by the same bound. Beside it the angles count: of a foot without keypoints
// nothing is ever seen, however sure its ankle is, and an arm that is hidden is a guess at once, before its deviation has grown.

import type { People } from "./protocol/ticks.ts";
import type { Venue } from "./protocol/venue.ts";

/**
 * Standard deviation beyond which nothing is known of where a joint is, metres: it may as well be on another limb. 0.1, and half of the
 * steps in which deviations come, so that single precision does not decide.
 */
const UNKNOWN_M = 0.101;

/** Angles that turn the link to a joint: while none of them is observed, nothing says where the joint is. */
const TURNED_BY: readonly (readonly [joints: readonly string[], angles: readonly string[]])[] = [
  [["head", "nose", "left_eye", "right_eye", "left_ear", "right_ear"], ["neck_flexion", "neck_bending", "neck_rotation"]],
  ...(["left", "right"] as const).flatMap((side) => {
    const rows: [string[], string[]][] = [
      [["elbow"], ["arm_flex", "arm_add"]],
      [["wrist", "hand"], ["elbow_flex"]],
      [["knee"], ["hip_flexion", "hip_adduction"]],
      [["ankle"], ["knee_angle"]],
      [["heel", "toe"], ["ankle_angle", "subtalar_angle"]],
    ];
    return rows.map(([joints, angles]) => [
      joints.map((joint) => `${side}_${joint}`),
      angles.map((angle) => `${angle}_${side.charAt(0)}`),
    ] as const);
  }),
];

export class Determined {
  /** Per joint the bits of its angles, 0 to 31 and 32 to 63; none of a joint that only its deviation tells of. */
  private readonly angles: Uint32Array;

  constructor(venue: Pick<Venue, "joints" | "angles">) {
    this.angles = new Uint32Array(2 * venue.joints.length);
    for (const [joints, names] of TURNED_BY) {
      const bits = names.map((name) => venue.angles.findIndex((angle) => angle.name === name));
      if (bits.some((bit) => bit < 0 || bit > 63)) continue;
      venue.joints.forEach(({ name }, joint) => {
        if (joints.includes(name)) for (const bit of bits) this.add(2 * joint + (bit >> 5), bit & 31);
      });
    }
  }

  /** Whether where a joint of somebody is drawn is a guess. */
  isGuess(people: People, person: number, joint: number): boolean {
    if ((people.sigma_m[person * people.jointCount + joint] ?? NaN) > UNKNOWN_M) return true;
    const [low, high] = [this.angles[2 * joint] ?? 0, this.angles[2 * joint + 1] ?? 0];
    if ((low | high) === 0) return false;
    return ((people.unobserved[2 * person] ?? 0) & low) >>> 0 === low && ((people.unobserved[2 * person + 1] ?? 0) & high) >>> 0 === high;
  }

  private add(half: number, bit: number): void {
    this.angles[half] = ((this.angles[half] ?? 0) | (1 << bit)) >>> 0;
  }
}
