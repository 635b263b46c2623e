"""The keyframes of the clips beside this file: `python3 keyframes.py` writes them anew.

What tracks are and mean: `clip.py`.
"""

import sys

import numpy as np

from body import Hand, Plant, Swing
from clip import Clip


def shifted(keys, share):
    """A cyclic track later by a share of the cycle."""
    return sorted(((s + share) % 1, v) for s, v in keys)


def both(name, keys, share=0.5):
    """A cyclic track for the left side, and half a cycle later for the right one."""
    return {f"left_{name}": keys, f"right_{name}": shifted(keys, share)}


def gait(cycle_s, stride_cm, stance, ahead_cm, width_cm, toe_out, swing):
    """Plants and swings of a straight gait: the left foot lands at 0, the right half a cycle later,
    `ahead_cm` in front of the pelvis, which moves at even speed."""
    plants, swings = {}, {}
    for side, sign, share in (("left", 1, 0.0), ("right", -1, 0.5)):
        plants[side] = [
            Plant((k + share) * cycle_s, (k + share + stance) * cycle_s, sign * width_cm,
                  (k + share) * stride_cm + ahead_cm, sign * toe_out)
            for k in range(-5, 14)
        ]  # fmt: skip
        swings[side] = [swing] * (len(plants[side]) - 1)
    return plants, swings


def walk():
    """Two cycles at 1.3 m/s; the last frame is the first one, further on."""
    cycle_s, stride = 13 / 12, 142.0
    plants, swings = gait(cycle_s, stride, 0.60, 31.5, 5.0, 7.0, Swing(lift=3.0, at=0.35))
    tracks = {
        "y": [(0.02, 89.8), (0.30, 92.6), (0.52, 89.8), (0.80, 92.6)],
        "x": [(0.05, 0.0), (0.3, 1.4), (0.55, 0.0), (0.8, -1.4)],
        "yaw": [(0.02, -5), (0.52, 5)],
        "roll": [(0.12, 3.0), (0.45, -1.0), (0.62, -3.0), (0.95, 1.0)],
        "pitch": 4,
        "trunk_yaw": [(0.04, 10), (0.54, -10)],
        "trunk_roll": [(0.12, -3.0), (0.45, 1.0), (0.62, 3.0), (0.95, -1.0)],
        "trunk_pitch": [(0.08, 4), (0.33, 2), (0.58, 4), (0.83, 2)],
        "head_yaw": [(0.04, -5), (0.54, 5)],
        "head_pitch": -4,
        **both("foot", [(0.0, 20), (0.09, 0), (0.26, 0), (0.45, -20), (0.56, -52), (0.62, -68), (0.73, -38), (0.85, 4), (0.96, 20)]),
        **both("arm", [(0.02, -20), (0.52, 24)]),
        "left_arm_out": 12, "right_arm_out": 12,
        **both("elbow", [(0.05, 14), (0.55, 36)]),
    }  # fmt: skip
    clip = Clip(cycle_s, tracks, plants, swings, cycles=2)
    clip.track["z"] = stride * clip.t / cycle_s
    return clip


def jog():
    """Three cycles at 2.5 m/s; the last frame is the first one, further on."""
    return running(22 / 30, 183.3, 3, stance=0.38, ahead=19.0, lift=12.0, low=87.5, high=92.0, lean=6, hip=5,
                   arms=(-30, 16), elbow=82, heel_up=-80, hit=70.0)  # fmt: skip


def run():
    """Three cycles at 3.5 m/s with two flights each; the last frame is the first one, further on."""
    return running(0.70, 245.0, 3, stance=0.32, ahead=19.0, lift=22.0, low=85.5, high=92.5, lean=8, hip=8,
                   arms=(-33, 34), elbow=92, heel_up=-98, hit=110.0)  # fmt: skip


def sprint():
    """Three cycles at 7.8 m/s; the last frame is the first one, further on."""
    return running(28 / 60, 364.0, 3, stance=0.2, ahead=22.0, lift=20.0, low=89.0, high=92.5, lean=12, hip=10,
                   arms=(-48, 62), elbow=88, heel_up=-102, fold=-66, hit=220.0)  # fmt: skip


def running(cycle_s, stride, cycles, *, stance, ahead, lift, low, high, lean, hip, arms, elbow, heel_up, fold=-45, hit=0.0):
    """A gait with flights: pelvis between `low` and `high`, `lean`ing forward and turning by `hip` with the
    legs, arms swinging between two angles, feet up to `heel_up` behind."""
    plants, swings = gait(cycle_s, stride, stance, ahead, 3.5, 5.0, Swing(lift=lift, at=0.36, hit=hit))
    middle, air = stance * 0.42, (0.5 + stance) / 2
    foot = [(0.0, 8), (stance * 0.12, 0), (stance * 0.3, 0), (stance * 0.62, -24), (stance, -70),
            (stance + 0.12, heel_up), (stance + 0.25, heel_up + 10), (0.72, fold), (0.87, 0.1 * fold), (0.95, 10)]  # fmt: skip
    tracks = {
        "y": [(middle, low), (air, high), (middle + 0.5, low), (air + 0.5, high)],
        "x": [(middle, 0.8), (middle + 0.5, -0.8)],
        "yaw": [(air, hip), (air + 0.5, -hip)],
        "roll": [(middle, 3), (middle + 0.5, -3)],
        "pitch": [(middle, lean + 2), (air, lean - 1), (middle + 0.5, lean + 2), (air + 0.5, lean - 1)],
        "trunk_yaw": [(air, -2.5 * hip), (air + 0.5, 2.5 * hip)],
        "trunk_roll": [(middle, -3), (middle + 0.5, 3)],
        "trunk_pitch": 6,
        "head_yaw": [(air, 1.4 * hip), (air + 0.5, -1.4 * hip)],
        "head_pitch": -6 - 0.8 * lean,
        **both("foot", foot),
        **both("arm", [(0.95, arms[0]), (0.45, arms[1])]),
        "left_arm_out": 20, "right_arm_out": 20, "left_arm_turn": 25, "right_arm_turn": 25,
        **both("elbow", [(0.95, elbow - 14), (0.22, elbow), (0.45, elbow + 10), (0.7, elbow - 2)]),
    }  # fmt: skip
    clip = Clip(cycle_s, tracks, plants, swings, cycles=cycles, smooth_s=0.036 * cycle_s)
    clip.track["z"] = stride * clip.t / cycle_s
    return clip


# Where the feet of a standing person are: ankles in cm, toes out by 8 degrees.
STAND_CM, TOE_OUT = 9.5, 8.0


def steps(*ways):
    """Plants from (start, end, x, z, yaw) and a low swing between each two."""
    plants = [Plant(*way) for way in ways]
    return plants, [Swing(lift=6.0, at=0.4)] * (len(plants) - 1)


def standing(side, seconds):
    """A foot that never leaves the floor."""
    sign = 1 if side == "left" else -1
    return [Plant(-1.0, seconds + 1.0, sign * STAND_CM, 0.0, sign * TOE_OUT)], []


def on_both_feet(seconds, tracks, **more):
    """A clip of a person who stays on both feet."""
    left, right = standing("left", seconds), standing("right", seconds)
    return Clip(seconds, tracks, {"left": left[0], "right": right[0]}, {"left": [], "right": []}, **more)


def idle():
    """Stands, shifts the weight, looks around."""
    return on_both_feet(4.0, {
        "x": [(0, 0), (1.2, 2.5), (2.4, -2.5), (3.6, 0)],
        "y": [(0, 92.6), (1.2, 91.6), (1.8, 92.6), (2.4, 91.6), (3.6, 92.6)],
        "roll": [(0, 0), (1.2, 2), (2.4, -2), (3.6, 0)],
        "trunk_roll": [(0, 0), (1.2, -2.5), (2.4, 2.5), (3.6, 0)],
        "trunk_pitch": [(0, 2), (1.0, 3.5), (2.0, 2), (3.0, 3.5), (4.0, 2)],
        "head_yaw": [(0, 0), (0.6, 0), (1.3, 38), (1.8, 38), (2.6, -30), (3.0, -30), (3.7, 0)],
        "trunk_yaw": [(0.5, 0), (1.4, 7), (2.7, -6), (3.7, 0)],
        "head_pitch": [(0, 0), (1.5, 5), (2.8, -3), (3.8, 0)],
    })  # fmt: skip


def wave():
    """Raises the right arm, waves four times, lowers it."""
    swings = [(1.10 + 0.2 * k, 62 if k % 2 else 108) for k in range(9)]
    return on_both_feet(3.7, {
        "x": [(0.3, 0), (0.9, 2.5), (2.9, 2.5), (3.5, 0)],
        "y": [(0, 92.6), (0.9, 91.7), (2.9, 91.7), (3.6, 92.6)],
        "roll": [(0.3, 0), (0.9, 2), (2.9, 2), (3.5, 0)],
        "trunk_roll": [(0.3, 0), (0.9, 4), (2.9, 4), (3.5, 0)],
        "head_roll": [(0.3, 0), (1.0, -6), (2.8, -6), (3.5, 0)],
        "head_yaw": [(0.3, 0), (1.0, -10), (2.8, -10), (3.5, 0)],
        "right_arm": [(0.25, 7), (0.95, 112), (2.8, 112), (3.5, 7)],
        "right_arm_out": [(0.25, 75), (0.95, 78), (2.8, 78), (3.5, 75)],
        "right_arm_turn": [(0.25, 12), (0.55, 0), (1.0, -80), (2.75, -80), (3.15, 0), (3.5, 12)],
        "right_elbow": [(0.25, 14), (0.6, 70), *swings, (3.05, 60), (3.55, 14)],
        "left_elbow": [(0.2, 14), (1.0, 20), (2.8, 20), (3.5, 14)],
    })  # fmt: skip


def kick():
    """Two steps towards a ball, a kick with the right foot, two steps to stand again."""
    left, left_swings = steps((-1, 0.72, 9.5, 0, 8), (1.00, 2.06, 8, 105, 8), (2.46, 4, 9.5, 172, 8))
    right, right_swings = steps((-1, 0.30, -9.5, 0, -8), (0.66, 1.04, -7, 42, -6), (1.80, 4, -9.5, 172, -8))
    right_swings[1] = Swing(lift=40.0, at=0.4)
    return Clip(3.0, {
        "z": [(0, 0), (0.25, 2), (0.5, 18), (0.85, 62), (1.2, 96), (1.4, 108), (1.8, 135), (2.3, 164), (2.7, 172)],
        "x": [(0, 0), (0.3, 4), (0.7, -2), (1.15, 4), (1.5, 5), (1.85, 0), (2.2, -4), (2.7, 0)],
        "y": [(0, 92.6), (0.3, 91), (0.7, 89.5), (0.95, 90), (1.2, 87.5), (1.45, 89), (1.85, 89), (2.2, 91), (2.6, 92.6)],
        "yaw": [(0.7, 0), (1.12, -22), (1.42, 20), (1.8, 8), (2.3, 0)],
        "pitch": [(0, 0), (0.6, 4), (1.1, 6), (1.4, -12), (1.8, 2), (2.4, 2), (2.8, 0)],
        "roll": [(0.9, 0), (1.3, 5), (1.6, 4), (1.9, 0)],
        "trunk_yaw": [(0.3, 0), (0.65, -6), (1.12, 30), (1.45, -22), (1.9, -6), (2.5, 0)],
        "trunk_pitch": [(0, 2), (0.6, 6), (1.1, -4), (1.42, 26), (1.8, 8), (2.5, 2)],
        "trunk_roll": [(0.9, 0), (1.3, -8), (1.7, -3), (2.0, 0)],
        "head_pitch": [(0, 0), (0.6, 12), (1.4, 14), (1.9, 0), (2.5, 0)],
        "left_arm": [(0.2, 7), (0.65, -14), (1.1, 82), (1.4, 48), (1.8, 24), (2.5, 7)],
        "left_arm_out": [(0.2, 75), (0.65, 60), (1.1, 82), (1.42, 25), (1.8, 60), (2.5, 75)],
        "left_elbow": [(0.2, 14), (0.7, 24), (1.15, 22), (1.45, 40), (2.0, 28), (2.6, 14)],
        "right_arm": [(0.2, 7), (0.62, 20), (1.05, 14), (1.42, -46), (1.8, -8), (2.5, 7)],
        "right_arm_out": [(0.2, 75), (0.62, 20), (1.05, 40), (1.42, -30), (1.8, 20), (2.5, 75)],
        "right_elbow": [(0.2, 14), (0.7, 36), (1.15, 34), (1.45, 28), (2.0, 25), (2.6, 14)],
        "left_foot": [(0.34, 0), (0.54, -22), (0.72, -48), (0.86, -12), (0.97, 12), (1.08, 0), (1.5, 0), (1.66, -8), (1.94, -28), (2.06, -44), (2.3, -5), (2.42, 4), (2.5, 0)],
        "right_foot": [(0.12, 0), (0.3, -34), (0.45, -18), (0.6, 12), (0.72, 0), (0.86, 0), (0.98, -32), (1.04, -52), (1.25, -95), (1.45, 5), (1.68, 5), (1.84, 0)],
        "right_free": [(1.04, 0), (1.18, 1), (1.60, 1), (1.76, 0)],
        "right_thigh": [(0.95, -14), (1.16, -24), (1.28, 10), (1.37, 38), (1.50, 72), (1.62, 62), (1.8, 20)],
        "right_thigh_out": [(1.0, 4), (1.16, 16), (1.4, 4), (1.52, -12), (1.75, 2)],
        "right_knee": [(0.95, 30), (1.17, 98), (1.31, 84), (1.40, 32), (1.47, 6), (1.6, 18), (1.8, 20)],
        "right_point": [(1.0, 5), (1.2, 8), (1.36, 2), (1.5, 24), (1.75, 0)],
    }, {"left": left, "right": right}, {"left": left_swings, "right": right_swings}, smooth_s=0.03)  # fmt: skip


def jump():
    """Crouches, jumps 30 cm high and 50 cm far, lands and straightens."""
    plants, swings = {}, {}
    for side, sign in (("left", 1), ("right", -1)):
        plants[side] = [Plant(-1, 0.98, sign * 10, 0, sign * 6), Plant(1.48, 4, sign * 11, 50, sign * 8)]
        swings[side] = [Swing(lift=30.0, at=0.5)]
    air = [(0.98 + 0.05 * k, 98.0 + 30.5 * (1 - ((k - 5) / 5) ** 2)) for k in range(11)]
    sides = {}
    for side in ("left", "right"):
        sides |= {
            f"{side}_foot": [(0.25, 0), (0.6, -30), (0.76, -32), (0.9, -36), (0.98, -56), (1.12, -54), (1.3, -32), (1.48, -16), (1.58, -10), (1.76, -24), (2.1, 0)],
            f"{side}_arm": [(0.1, 7), (0.52, -48), (0.60, -48), (1.04, 128), (1.16, 132), (1.55, 55), (1.82, 20), (2.2, 7)],
            f"{side}_arm_out": [(0.1, 75), (0.4, 10), (1.2, 14), (1.5, 40), (1.8, 50), (2.2, 75)],
            f"{side}_elbow": [(0.1, 14), (0.6, 22), (0.85, 45), (1.05, 20), (1.5, 30), (2.2, 14)],
        }
    return Clip(2.4, {
        "y": [(0, 92.6), (0.15, 92.6), (0.55, 66), (0.68, 63), (0.86, 82), *air, (1.56, 88), (1.70, 70), (1.78, 69), (2.25, 92.6)],
        "z": [(0, 0), (0.4, -6), (0.66, -4), (0.98, 14), (1.48, 42), (1.7, 47), (2.1, 50)],
        "pitch": [(0.1, 0), (0.6, 38), (0.72, 38), (1.0, -2), (1.2, 4), (1.48, 8), (1.74, 30), (2.2, 0)],
        "trunk_pitch": [(0.1, 2), (0.6, 26), (0.98, -4), (1.2, 4), (1.5, 10), (1.74, 20), (2.2, 2)],
        "head_pitch": [(0.1, 0), (0.6, -38), (0.98, -6), (1.4, 6), (1.74, -22), (2.2, 0)],
        **sides,
    }, plants, swings, smooth_s=0.025)  # fmt: skip


def turn():
    """Half a turn to the left on the spot in five small steps."""
    def at(sign, yaw):
        heading = np.radians(yaw)
        return (sign * STAND_CM * np.cos(heading), -sign * STAND_CM * np.sin(heading), yaw + sign * TOE_OUT)

    left, left_swings = steps((-1, 0.20, *at(1, 0)), (0.50, 0.92, *at(1, 70)), (1.20, 1.64, *at(1, 150)), (1.90, 4, *at(1, 180)))
    right, right_swings = steps((-1, 0.55, *at(-1, 0)), (0.86, 1.26, *at(-1, 110)), (1.58, 4, *at(-1, 180)))
    lifted = lambda *times: [(0, 0), *(key for a, b in times for key in ((a - 0.16, 0), (a, -26), ((a + b) / 2, -12), (b, -3), (b + 0.08, 0)))]
    return Clip(2.2, {
        "yaw": [(0.1, 0), (0.5, 32), (0.9, 82), (1.3, 132), (1.9, 180)],
        "y": [(0, 92.6), (0.35, 91), (1.7, 91), (2.1, 92.6)],
        "x": [(0, 0), (0.3, -3.5), (0.7, 1), (1.05, 3), (1.4, -2), (1.75, 2), (2.1, 0)],
        "z": [(0, 0), (0.4, 1), (0.72, -3.5), (1.05, 2), (1.4, 3), (2.0, 0)],
        "trunk_yaw": [(0, 0), (0.35, 14), (1.3, 12), (2.0, 0)],
        "head_yaw": [(0, 0), (0.3, 30), (1.2, 24), (1.9, 0)],
        "trunk_pitch": [(0, 2), (0.8, 5), (2.0, 2)],
        "left_arm": [(0, 7), (0.5, 16), (1.5, 14), (2.1, 7)],
        "right_arm": [(0, 7), (0.5, 20), (1.5, 18), (2.1, 7)],
        "right_arm_out": [(0, 75), (0.5, 40), (1.5, 45), (2.1, 75)],
        "left_elbow": [(0, 14), (0.6, 26), (2.0, 14)],
        "right_elbow": [(0, 14), (0.6, 34), (2.0, 14)],
        "left_foot": lifted((0.20, 0.50), (0.92, 1.20), (1.64, 1.90)),
        "right_foot": lifted((0.55, 0.86), (1.26, 1.58)),
    }, {"left": left, "right": right}, {"left": left_swings, "right": right_swings}, smooth_s=0.03)  # fmt: skip


def lift():
    """Squats, reaches for the floor with both hands, lifts something to the chest."""
    sides = {}
    for side in ("left", "right"):
        sides |= {
            f"{side}_arm": [(0.2, 7), (1.0, 62), (1.3, 62), (1.8, 35), (2.3, 28), (2.9, 28), (3.5, 7)],
            f"{side}_arm_out": [(0.2, 75), (1.0, 8), (2.9, 12), (3.5, 75)],
            f"{side}_arm_turn": [(0.2, 12), (1.0, 20), (2.9, 30), (3.5, 12)],
            f"{side}_elbow": [(0.2, 14), (1.0, 16), (1.3, 16), (2.3, 104), (2.9, 104), (3.5, 14)],
            f"{side}_knee_out": [(0.2, 4), (1.0, 18), (1.3, 18), (2.2, 4)],
            f"{side}_foot": [(0.3, 0), (0.95, -38), (1.35, -38), (1.9, 0)],
        }
    return on_both_feet(3.7, {
        "y": [(0, 92.6), (0.2, 92.6), (1.1, 50), (1.3, 50), (2.2, 91.5), (3.4, 92.6)],
        "z": [(0.2, 0), (1.1, -4), (1.3, -4), (2.2, -1), (3.4, 0)],
        "pitch": [(0.2, 0), (0.9, 32), (1.3, 32), (2.2, 0)],
        "trunk_pitch": [(0.2, 2), (1.05, 40), (1.3, 40), (2.2, -4), (2.9, -4), (3.4, 2)],
        "head_pitch": [(0.2, 0), (1.0, -10), (1.5, -20), (2.3, 6), (3.3, 0)],
        **sides,
    })  # fmt: skip


def mirrored(keys, middle_s, value):
    """Keys up to the middle of a movement, and after it the same backwards."""
    before = keys if isinstance(keys, list) else [(0.0, keys)]
    return before + [(2 * middle_s - t, value(v)) for t, v in reversed(before) if t < middle_s]


def cartwheel():
    """A cartwheel to the left; the second half is the first one in a mirror, backwards in time."""
    middle_s, middle_cm = 1.50, 156.0
    left_foot, right_foot = [Plant(-1, 0.50, 9.5, 0, 8), Plant(0.86, 1.28, 60, 0, 50)], [Plant(-1, 0.96, -9.5, 0, -8)]

    def seen(plant):
        return Plant(2 * middle_s - plant.end, 2 * middle_s - plant.start, 2 * middle_cm - plant.x, plant.z, -plant.yaw)

    plants = {
        "left": left_foot + [seen(plant) for plant in reversed(right_foot)],
        "right": right_foot + [seen(plant) for plant in reversed(left_foot)],
    }
    low, high = Swing(lift=6.0, at=0.4), Swing(lift=60.0, at=0.5)
    swings = {"left": [low, high], "right": [high, low]}
    trunk = {
        "x": ([(0, 0), (0.48, -5), (0.86, 36), (1.10, 78), (1.28, 113), (1.50, 156)], lambda v: 2 * middle_cm - v),
        "y": ([(0, 92.6), (0.2, 92.6), (0.48, 91), (0.86, 84), (1.10, 89), (1.28, 107), (1.50, 120)], lambda v: v),
        "roll": ([(0, 0), (0.5, 2), (0.86, -16), (1.10, -84), (1.28, -126), (1.50, -180)], lambda v: -360 - v),
        "trunk_roll": ([(0, 0), (0.5, 0), (0.8, -8), (1.10, -24), (1.30, -14), (1.50, 0)], lambda v: -v),
        "head_roll": ([(0, 0), (0.8, 0), (1.15, 14), (1.50, 0)], lambda v: -v),
        "head_pitch": ([(0, 0), (0.8, 0), (1.15, -22), (1.50, -26)], lambda v: v),
        "trunk_pitch": ([(0, 2), (0.6, 0), (1.50, -4)], lambda v: v),
    }
    tracks = {name: mirrored(keys, middle_s, value) for name, (keys, value) in trunk.items()}
    limbs = {
        "arm": ([(0.05, 7), (0.62, 150), (1.08, 138), (1.50, 172)], [(0.05, 7), (0.62, 150), (1.2, 176), (1.50, 172)]),
        "arm_out": ([(0, 75), (0.3, 85), (1.50, 85)], [(0, 75), (0.3, 85), (1.50, 85)]),
        "arm_turn": ([(0.05, 12), (0.6, -60), (1.50, -70)], [(0.05, 12), (0.6, -60), (1.50, -70)]),
        "elbow": ([(0.05, 14), (0.3, 26), (0.62, 10), (1.50, 8)], [(0.05, 14), (0.3, 26), (0.62, 10), (1.50, 8)]),
        "hand": ([(0.8, 0), (1.08, -65), (1.50, -65)], [(0.8, 0), (1.3, -65), (1.50, -65)]),
        "foot": (
            [(0.36, 0), (0.5, -34), (0.7, -10), (0.86, 0), (1.06, 0), (1.20, -30), (1.28, -62), (1.50, -60)],
            [(0.74, 0), (0.88, -24), (0.96, -55), (1.50, -60)],
        ),
        "free": ([(1.28, 0), (1.40, 1), (1.50, 1)], [(0.96, 0), (1.10, 1), (1.50, 1)]),
        "thigh_out": ([(1.2, 35), (1.50, 52)], [(0.9, 20), (1.15, 48), (1.50, 52)]),
        "thigh": ([(1.1, 10), (1.50, 4)], [(0.9, 0), (1.50, 4)]),
        "knee": ([(1.2, 14), (1.50, 10)], [(0.9, 14), (1.1, 12), (1.50, 10)]),
        "knee_out": ([(0.4, 4), (0.86, 24), (1.3, 20), (1.50, 12)], [(0.4, 4), (1.50, 12)]),
        "point": ([(1.2, 30), (1.50, 40)], [(0.9, 20), (1.15, 40), (1.50, 40)]),
    }
    for name, (left, right) in limbs.items():
        back = {"left": right, "right": left}
        for side, keys in (("left", left), ("right", right)):
            after = [(2 * middle_s - t, v) for t, v in reversed(back[side]) if t < middle_s]
            tracks[f"{side}_{name}"] = keys + after
    clip = Clip(2 * middle_s, tracks, plants, swings, smooth_s=0.03, slower=1.2)
    clip.hands = {"left": Hand(1.12, 2 * middle_s - 1.36, 134, 0), "right": Hand(1.36, 2 * middle_s - 1.12, 178, 0)}
    return clip


# A boxer's guard, which these clips start and end in: half turned to the right, the left foot ahead.
GUARD_PLANTS = {"left": [Plant(-1, 5, 10, 22, -5)], "right": [Plant(-1, 5, -13, -22, -48)]}
GUARD = {
    "x": -1, "y": 87, "yaw": -38, "pitch": 6, "trunk_yaw": 10, "trunk_pitch": 10, "head_yaw": 26, "head_pitch": 2,
    "left_arm": 34, "left_arm_out": 12, "left_elbow": 118, "left_arm_turn": 8,
    "right_arm": 30, "right_arm_out": 18, "right_elbow": 124, "right_arm_turn": 12,
    "right_foot": -26, "left_knee_out": 8, "right_knee_out": 8,
}  # fmt: skip


def guard():
    """Bounces in the guard, covers the head with both arms, leans back out of reach."""
    cover = lambda rest, up: [(0, rest), (0.62, rest), (0.82, up), (1.05, up), (1.35, rest)]
    return Clip(2.3, {
        **GUARD,
        "y": [(0, 87), (0.16, 89), (0.32, 86), (0.48, 89), (0.64, 86.5), (0.85, 82), (1.05, 82), (1.35, 87), (1.7, 88), (2.1, 87)],
        "z": [(0, 0), (0.65, 0), (0.9, -4), (1.3, 0), (1.45, 0), (1.72, -9), (2.1, 0)],
        "trunk_pitch": [(0, 10), (0.6, 10), (0.85, 24), (1.05, 24), (1.4, 8), (1.72, -8), (2.1, 10)],
        "trunk_yaw": [(0, 10), (1.4, 10), (1.72, 0), (2.1, 10)],
        "head_pitch": [(0, 2), (0.6, 2), (0.85, 18), (1.05, 18), (1.4, 0), (1.72, 6), (2.1, 2)],
        "left_arm": cover(34, 62), "left_arm_out": cover(12, -8), "left_elbow": cover(118, 136),
        "right_arm": cover(30, 60), "right_arm_out": cover(18, -6), "right_elbow": cover(124, 138),
    }, GUARD_PLANTS, {"left": [], "right": []}, smooth_s=0.025)  # fmt: skip


def punch():
    """Boxing: jab, cross, jab, duck."""
    jabs = lambda rest, out, *times: [(0, rest), *(k for t in times for k in ((t - 0.22, rest), (t, out), (t + 0.05, out), (t + 0.3, rest)))]
    return Clip(2.6, {
        **GUARD,
        "yaw": [(0, -38), (0.35, -38), (0.55, -44), (0.85, -38), (1.12, -8), (1.17, -8), (1.45, -38)],
        "trunk_yaw": [(0, 10), (0.3, 10), (0.52, -4), (0.9, 10), (1.12, 34), (1.17, 34), (1.45, 10), (1.62, -4), (1.9, 10)],
        "x": [(0, -1), (0.5, 1), (0.8, -1), (1.12, 2), (1.5, -1), (1.9, -1), (2.15, 7), (2.5, -1)],
        "z": [(0, 0), (0.5, 5), (0.85, -1), (1.12, 8), (1.45, 0), (1.63, 5), (1.9, 0), (2.15, -3), (2.5, 0)],
        "y": [(0, 87), (0.25, 88), (0.5, 86), (0.8, 88), (1.12, 86), (1.4, 88), (1.62, 86), (1.85, 87), (2.14, 70), (2.5, 87)],
        "pitch": [(0, 6), (1.85, 6), (2.14, 18), (2.5, 6)],
        "trunk_pitch": [(0, 10), (1.85, 10), (2.14, 26), (2.5, 10)],
        "trunk_roll": [(0, 0), (1.85, 0), (2.14, -10), (2.5, 0)],
        "head_yaw": [(0, 26), (0.9, 26), (1.12, -18), (1.4, 26)],
        "head_pitch": [(0, 2), (1.85, 2), (2.14, -24), (2.5, 2)],
        "left_arm": jabs(34, 88, 0.52, 1.62), "left_arm_out": jabs(12, 40, 0.52, 1.62),
        "left_elbow": jabs(118, 12, 0.52, 1.62), "left_arm_turn": jabs(8, 40, 0.52, 1.62),
        "right_arm": jabs(30, 90, 1.12), "right_arm_out": jabs(18, 30, 1.12),
        "right_elbow": jabs(124, 10, 1.12), "right_arm_turn": jabs(12, 40, 1.12),
        "right_foot": [(0, -26), (0.85, -26), (1.12, -38), (1.5, -26), (1.85, -26), (2.14, -34), (2.45, -26)],
    }, GUARD_PLANTS, {"left": [], "right": []}, smooth_s=0.025)  # fmt: skip


CLIPS = {
    "walk": walk, "jog": jog, "run": run, "sprint": sprint, "idle": idle, "turn": turn, "wave": wave,
    "kick": kick, "jump": jump, "lift": lift, "punch": punch, "guard": guard, "cartwheel": cartwheel,
}  # fmt: skip

if __name__ == "__main__":
    for wanted in sys.argv[1:] or CLIPS:
        CLIPS[wanted]().write(wanted)
