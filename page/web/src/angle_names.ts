// Joint angles as a biomechanist reads them: named, in degrees, flexion positive.
//
// Fusion reports the angles of OpenSim's Rajagopal model, whose trunk extends and whose pelvis tilts back as they grow;
// here these are turned, and said so by their names.

import type { Angle } from "./protocol/venue.ts";
import { words } from "./units.ts";

/** What is shown: name and sign against what fusion reports. */
type Reading = readonly [name: string, sign: 1 | -1];

const READINGS: Readonly<Record<string, Reading>> = {
  pelvis_tilt: ["Pelvis forward tilt", -1],
  pelvis_list: ["Pelvis list to the right", 1],
  pelvis_rotation: ["Pelvis rotation to the left", 1],
  lumbar_extension: ["Trunk flexion", -1],
  lumbar_bending: ["Trunk bending to the right", 1],
  lumbar_rotation: ["Trunk rotation to the left", 1],
  neck_flexion: ["Neck flexion", 1],
  neck_bending: ["Neck bending to the right", 1],
  neck_rotation: ["Neck rotation to the left", 1],
  scapula_elevation: ["scapula elevation", 1],
  scapula_protraction: ["scapula protraction", 1],
  scapula_tilt: ["scapula forward tilt", 1],
  arm_flex: ["shoulder flexion", 1],
  arm_add: ["shoulder adduction", 1],
  arm_rot: ["shoulder internal rotation", 1],
  elbow_flex: ["elbow flexion", 1],
  hip_flexion: ["hip flexion", 1],
  hip_adduction: ["hip adduction", 1],
  hip_rotation: ["hip internal rotation", 1],
  knee_angle: ["knee flexion", 1],
  ankle_angle: ["ankle dorsiflexion", 1],
  subtalar_angle: ["foot inversion", 1],
  foot_rotation: ["foot toe-in", 1],
};

export interface AngleReading {
  /** Position among the venue's angles. */
  readonly index: number;
  readonly name: string;
  /** Degrees shown per radian reported. */
  readonly degreesPerRadian: number;
  /** Where it is listed: the part of the body. */
  readonly group: string;
}

/** The angles of a venue that can be charted: those in radians. */
export function readings(angles: readonly Angle[]): AngleReading[] {
  return angles.flatMap((angle, index) => (angle.unit === "rad" ? [reading(angle.name, index)] : []));
}

function reading(name: string, index: number): AngleReading {
  const side = name.endsWith("_r") ? "Right " : name.endsWith("_l") ? "Left " : "";
  const plain = side === "" ? name : name.slice(0, -2);
  const [shown, sign] = Object.hasOwn(READINGS, plain) ? (READINGS[plain] ?? [words(plain), 1]) : [words(plain), 1];
  const full = side + shown;
  return {
    index,
    name: full,
    degreesPerRadian: (sign * 180) / Math.PI,
    group: side === "" ? "Trunk and neck" : `${side}${/^(scapula|arm|elbow)/.test(plain) ? "arm" : "leg"}`,
  };
}

/** What is charted before somebody chooses. */
export const FIRST_CHOSEN = ["knee_angle_r", "knee_angle_l"] as const;
