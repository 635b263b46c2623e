"""A clip in the making: tracks become a moving body.

A clip is a dictionary of tracks. A track is a number (held), or keys [(seconds, value), ...] that a
monotone cubic joins; a cyclic clip's keys are in shares of its cycle. Lengths in cm, angles in
degrees; what the tracks mean is listed at NEUTRAL and SIDE. Legs reach for feet that are planted on
the floor (`body.Plant`), so that a standing foot does not move; `free` lets a leg off its foot, and
then its own angles lead it.
"""

from pathlib import Path

import numpy as np

import body
from body import applied, between, rot_x, rot_y, rot_z, transposed

NEUTRAL = {
    # The pelvis: place (x left, y up, z forward), turned to the left, leaning forward, left side up.
    "x": 0, "y": 92.6, "z": 0, "yaw": 0, "pitch": 0, "roll": 0,
    # Trunk over the pelvis, shared by spine and chest; head over the trunk, shared by neck and head.
    "trunk_pitch": 2, "trunk_roll": 0, "trunk_yaw": 0,
    "head_pitch": 0, "head_roll": 0, "head_yaw": 0,
}  # fmt: skip
SIDE = {
    # The upper arm: raised by `arm` from hanging (180: straight up) in a plane turned outwards by
    # `arm_out` from straight ahead (90: sideways), turned inwards about itself by `arm_turn`.
    "arm": 7, "arm_out": 75, "arm_turn": 12, "elbow": 14, "palm": 0,
    "hand": 0,
    # The foot: toes up against the floor. The leg where it is free: thigh forward, sideways, knee.
    "foot": 0, "free": 0, "thigh": 0, "thigh_out": 4, "knee": 10, "point": 0,
    # The knee turned outwards.
    "knee_out": 4,
}  # fmt: skip


class Clip:
    """A clip in the making: tracks sampled finely, feet, and how to write it."""

    def __init__(self, seconds, tracks, plants, swings, cycles=0, smooth_s=0.045, slower=1.0):
        """A clip of `seconds`, or of `cycles` of `seconds`, played `slower`."""
        self.cycle_s = seconds if cycles else 0.0
        self.length_s = seconds * max(cycles, 1)
        margin = 2 * seconds if cycles else 0.5
        n = int(round((self.length_s + 2 * margin) * body.FINE_HZ)) + 1
        self.t = np.arange(n) / body.FINE_HZ - round(margin * body.FINE_HZ) / body.FINE_HZ
        self.smooth_s, self.slower = smooth_s, slower
        known = dict(NEUTRAL)
        for side in ("left", "right"):
            known |= {f"{side}_{name}": value for name, value in SIDE.items()}
        unknown = set(tracks) - set(known)
        if unknown:
            raise ValueError(f"unknown tracks: {sorted(unknown)}")
        self.track = {name: self.sampled(tracks.get(name, value)) for name, value in known.items()}
        self.feet = {
            side: body.Foot(self.t, plants[side], self.track[f"{side}_foot"], swings[side])
            for side in ("left", "right")
        }
        self.hands = {}

    def sampled(self, keys):
        """A track's values at the fine times."""
        if not isinstance(keys, list):
            return np.full(len(self.t), float(keys))
        if self.cycle_s:
            first, last = int(np.floor(self.t[0] / self.cycle_s)) - 1, int(np.ceil(self.t[-1] / self.cycle_s)) + 1
            keys = [((k + s) * self.cycle_s, v) for k in range(first, last + 1) for s, v in keys if s < 1]
        times, values = zip(*keys)
        return body.smoothed(body.pchip(self.t, times, values), self.smooth_s)

    def angle(self, name):
        """A track of degrees in radians."""
        return np.radians(self.track[name])

    def local(self):
        """Place of the hips (n, 3) and local rotations by bone at the fine times."""
        hips = np.stack([self.track["x"], self.track["y"], self.track["z"]], -1)
        root = rot_y(self.angle("yaw")) @ rot_x(self.angle("pitch")) @ rot_z(self.angle("roll"))
        rotations = {"hips": root}
        trunk = [self.angle(f"trunk_{axis}") / 2 for axis in ("yaw", "pitch", "roll")]
        half = rot_y(trunk[0]) @ rot_x(trunk[1]) @ rot_z(trunk[2])
        rotations["spine"] = rotations["chest"] = half
        head = [self.angle(f"head_{axis}") / 2 for axis in ("yaw", "pitch", "roll")]
        rotations["neck"] = rotations["head"] = rot_y(head[0]) @ rot_x(head[1]) @ rot_z(head[2])
        for side, sign in (("left", 1), ("right", -1)):
            self.arm(side, sign, rotations)
        hips[:, 1] -= self.sink(hips, root)
        for side, sign in (("left", 1), ("right", -1)):
            self.leg(side, sign, hips, root, rotations)
        for side, sign in (("left", 1), ("right", -1)):
            if side in self.hands:
                self.reach(side, sign, hips, root, half, rotations)
        return hips, rotations

    def arm(self, side, sign, rotations):
        """The collar follows the raised arm, the shoulder does the rest."""
        raised = self.track[f"{side}_arm"]
        out = sign * self.angle(f"{side}_arm_out")
        share = np.clip((raised - 30) / 150, 0, 1)
        collar = rot_z(sign * np.radians(28) * share * share * (3 - 2 * share))
        elevation = np.radians(raised)
        arm = rot_y(out) @ rot_x(-elevation) @ rot_y(-out) @ rot_y(-sign * self.angle(f"{side}_arm_turn"))
        rotations[f"{side}_collar"] = collar
        rotations[f"{side}_shoulder"] = transposed(collar) @ arm
        rotations[f"{side}_elbow"] = rot_x(-self.angle(f"{side}_elbow")) @ rot_y(-sign * self.angle(f"{side}_palm"))
        rotations[f"{side}_wrist"] = rot_x(-self.angle(f"{side}_hand"))

    def sink(self, hips, root):
        """How far the pelvis must come down for both legs to reach their feet, smoothly."""
        drop = np.zeros(len(hips))
        for side in ("left", "right"):
            foot = self.feet[side]
            start = hips + applied(root, body.OFFSET_CM[f"{side}_hip"])
            flat = np.sum((start - foot.ankle)[:, [0, 2]] ** 2, axis=-1)
            top = foot.ankle[:, 1] + np.sqrt(np.maximum(body.REACH_CM**2 - flat, 0))
            need = np.maximum(start[:, 1] - top, 0) * (self.track[f"{side}_free"] < 0.01)
            drop = np.maximum(drop, need)
        reach = int(0.07 * body.FINE_HZ)
        widened = np.max([np.roll(drop, k) for k in range(-reach, reach + 1)], axis=0)
        return body.smoothed(widened, 0.035)

    def leg(self, side, sign, hips, root, rotations):
        """A leg that reaches its foot, or as far as it is free follows its own angles."""
        foot = self.feet[side]
        start = hips + applied(root, body.OFFSET_CM[f"{side}_hip"])
        twist = 0.6 * (foot.yaw - self.angle("yaw")) + sign * self.angle(f"{side}_knee_out")
        thigh, shank = body.two_bones(root, start, foot.ankle, body.THIGH_CM, body.SHANK_CM, twist)
        free = np.clip(self.track[f"{side}_free"], 0, 1)
        own_hip = rot_z(sign * self.angle(f"{side}_thigh_out")) @ rot_x(-self.angle(f"{side}_thigh"))
        own_hip = own_hip @ rot_y(sign * self.angle(f"{side}_knee_out"))
        own_knee = rot_x(self.angle(f"{side}_knee"))
        own_ankle = rot_x(self.angle(f"{side}_point"))
        rotations[f"{side}_hip"] = between(transposed(root) @ thigh, own_hip, free)
        rotations[f"{side}_knee"] = between(transposed(thigh) @ shank, own_knee, free)
        rotations[f"{side}_ankle"] = between(transposed(shank) @ foot.rotation, own_ankle, free)
        rotations[f"{side}_toe"] = rot_x(-foot.toe_bend * (1 - free))

    def reach(self, side, sign, hips, root, half, rotations):
        """A hand that holds the floor: its arm leaves its own angles for it and comes back."""
        hand = self.hands[side]
        chest = root @ half @ half
        collar_at = hips + applied(root, body.OFFSET_CM["spine"]) + applied(root @ half, body.OFFSET_CM["chest"])
        collar_at = collar_at + applied(chest, body.OFFSET_CM[f"{side}_collar"])
        collar = chest @ rotations[f"{side}_collar"]
        start = collar_at + applied(collar, body.OFFSET_CM[f"{side}_shoulder"])
        own = collar @ rotations[f"{side}_shoulder"]
        wrist = np.broadcast_to(np.array([hand.x, body.WRIST_CM, hand.z]), hips.shape)
        upper, fore = body.two_bones(own, start, wrist, body.UPPER_ARM_CM, body.FOREARM_CM, np.zeros(len(hips)), -1)
        late = np.maximum(hand.start - self.t, self.t - hand.end)
        share = body.smoothed(np.clip(1.2 - late / 0.15, 0, 1), 0.03)
        rotations[f"{side}_shoulder"] = between(rotations[f"{side}_shoulder"], transposed(collar) @ upper, share)
        rotations[f"{side}_elbow"] = between(rotations[f"{side}_elbow"], transposed(upper) @ fore, share)

    def write(self, name):
        """Writes the clip, its first frame at time 0."""
        hips, rotations = self.local()
        first = int(np.searchsorted(self.t, -1e-9))
        count = int(round(self.length_s * self.slower * body.RATE_HZ)) + 1
        at = first + np.arange(count) * (body.FINE_HZ / body.RATE_HZ / self.slower)
        low = np.minimum(at.astype(int), len(self.t) - 2)
        share = at - low
        place = hips[low] + share[:, None] * (hips[low + 1] - hips[low])
        turned = {bone: between(r[low], r[low + 1], share) for bone, r in rotations.items()}
        body.write_bvh(Path(__file__).parent / f"{name}.bvh", place, turned)
