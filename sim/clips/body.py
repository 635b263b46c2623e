"""A jointed body for keyframing: smooth tracks, feet that stay where they are put, and a BVH writer.

Centimetres and degrees outside, radians inside; x left, y up, z forward; stature 175 cm.
Everything is sampled at FINE_HZ and written at RATE_HZ. Needs numpy, nothing else.
"""

from dataclasses import dataclass

import numpy as np

STATURE_CM = 175.0
RATE_HZ = 60
FINE_HZ = 4 * RATE_HZ

# Bones in file order: name, parent, offset from the parent in statures (x left, y up, z forward).
# The proportions are those of the project's table of joints; knuckles and toe tips are the ends of
# their bones.
BONES = [
    ("hips", None, (0, 0.53, 0)),
    ("spine", "hips", (0, 0.07, 0)),
    ("chest", "spine", (0, 0.10, 0)),
    ("neck", "chest", (0, 0.12, 0)),
    ("head", "neck", (0, 0.10, 0)),
    ("left_eye", "head", (0.019, 0.015, 0.05)),
    ("right_eye", "head", (-0.019, 0.015, 0.05)),
]
for _side, _x in (("left", 1), ("right", -1)):
    BONES += [
        (f"{_side}_collar", "chest", (_x * 0.02, 0.10, 0)),
        (f"{_side}_shoulder", f"{_side}_collar", (_x * 0.09, 0, 0)),
        (f"{_side}_elbow", f"{_side}_shoulder", (0, -0.172, 0)),
        (f"{_side}_wrist", f"{_side}_elbow", (0, -0.157, 0)),
    ]
for _side, _x in (("left", 1), ("right", -1)):
    BONES += [
        (f"{_side}_hip", "hips", (_x * 0.05, 0, 0)),
        (f"{_side}_knee", f"{_side}_hip", (0, -0.245, 0)),
        (f"{_side}_ankle", f"{_side}_knee", (0, -0.246, 0)),
        (f"{_side}_toe", f"{_side}_ankle", (0, -0.035, 0.08)),
    ]
ENDS = {"left_eye": (0, 0, 0.01), "right_eye": (0, 0, 0.01)}
for _side in ("left", "right"):
    ENDS[f"{_side}_wrist"] = (0, -0.05, 0)
    ENDS[f"{_side}_toe"] = (0, 0, 0.04)
OFFSET_CM = {name: STATURE_CM * np.array(offset, float) for name, _, offset in BONES}
PARENT = {name: parent for name, parent, _ in BONES}
THIGH_CM, SHANK_CM = 0.245 * STATURE_CM, 0.246 * STATURE_CM
UPPER_ARM_CM, FOREARM_CM = 0.172 * STATURE_CM, 0.157 * STATURE_CM
# From the ankle of a flat foot to what touches the floor; from the ball to the tip of the toes.
HEEL = STATURE_CM * np.array([0, -0.035, -0.03])
BALL = STATURE_CM * np.array([0, -0.035, 0.08])
TOES = STATURE_CM * np.array([0, 0, 0.04])
# Of a hand flat on the floor.
WRIST_CM = 7.0
FLAT_ANKLE_CM = 0.039 * STATURE_CM
# How far the toes bend against the foot before the foot rolls over their tips.
TOE_BEND_RAD = np.radians(38)
# A leg is never quite straight: least knee flexion about 5 degrees.
REACH_CM = 0.9985 * (THIGH_CM + SHANK_CM)


def rot_x(a):
    """Rotations about x (n, 3, 3) of n angles."""
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.stack([i, o, o, o, c, -s, o, s, c], -1).reshape(*np.shape(a), 3, 3)


def rot_y(a):
    """Rotations about y."""
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.stack([c, o, s, o, i, o, -s, o, c], -1).reshape(*np.shape(a), 3, 3)


def rot_z(a):
    """Rotations about z."""
    c, s, o, i = np.cos(a), np.sin(a), np.zeros_like(a), np.ones_like(a)
    return np.stack([c, -s, o, s, c, o, o, o, i], -1).reshape(*np.shape(a), 3, 3)


def transposed(r):
    """The inverse of rotations."""
    return np.swapaxes(r, -1, -2)


def applied(r, v):
    """Rotations times vectors, row by row."""
    return np.einsum("...ij,...j->...i", r, np.broadcast_to(v, (*r.shape[:-2], 3)))


def to_vector(r):
    """Rotation vectors of rotations of less than half a turn."""
    axis = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], -1)
    sine = np.linalg.norm(axis, axis=-1)
    angle = np.arctan2(sine, np.trace(r, axis1=1, axis2=2) - 1)
    return axis * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 0.5)[:, None]


def from_vector(v):
    """Rotations of rotation vectors."""
    angle = np.linalg.norm(v, axis=-1)[:, None, None]
    k = np.zeros((len(v), 3, 3))
    k[:, 2, 1], k[:, 0, 2], k[:, 1, 0] = v.T
    k[:, 1, 2], k[:, 2, 0], k[:, 0, 1] = -v.T
    small = np.maximum(angle, 1e-9)
    return np.eye(3) + np.sin(angle) / small * k + (1 - np.cos(angle)) / small**2 * (k @ k)


def between(a, b, share):
    """From rotations a (share 0) to b (share 1) along the shortest turn."""
    return a @ from_vector(to_vector(transposed(a) @ b) * share[:, None])


def pchip(t, times, values):
    """Monotone cubic through keys: no key is overshot, and two equal keys hold still."""
    times, values = np.asarray(times, float), np.asarray(values, float)
    if len(times) == 1:
        return np.full_like(t, values[0])
    h, d = np.diff(times), np.diff(values) / np.diff(times)
    slope = np.zeros_like(values)
    both = d[:-1] * d[1:] > 0
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    safe = np.where(both, d[:-1], 1), np.where(both, d[1:], 1)
    slope[1:-1] = np.where(both, (w1 + w2) / (w1 / safe[0] + w2 / safe[1]), 0)
    i = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(h) - 1)
    x = np.clip((t - times[i]) / h[i], 0, 1)
    y0, y1, m0, m1 = values[i], values[i + 1], slope[i] * h[i], slope[i + 1] * h[i]
    return y0 + x * (m0 + x * (3 * (y1 - y0) - 2 * m0 - m1 + x * (2 * (y0 - y1) + m0 + m1)))


def smoothed(values, sigma_s):
    """Gaussian smoothing in time (first axis), the ends held."""
    if sigma_s <= 0:
        return values
    half = int(4 * sigma_s * FINE_HZ) + 1
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / (sigma_s * FINE_HZ)) ** 2)
    padded = np.concatenate([np.repeat(values[:1], half), values, np.repeat(values[-1:], half)])
    return np.convolve(padded, kernel / kernel.sum(), "valid")


@dataclass
class Plant:
    """A foot on the floor from start to end (seconds): where its ankle is while it is flat (cm),
    and where it points (degrees, positive to the left)."""

    start: float
    end: float
    x: float
    z: float
    yaw: float = 0.0


@dataclass
class Hand:
    """A hand on the floor from start to end (seconds): where its wrist is (cm)."""

    start: float
    end: float
    x: float
    z: float


@dataclass
class Swing:
    """How a foot travels between two plants: its height above the straight way (cm), early in the
    swing (towards 0) or late (towards 1); and the speed, forwards as well as up or down, with which it
    leaves and hits the floor (cm/s): 0 is put down gently, a sprinter's foot has no time for that."""

    lift: float = 8.0
    at: float = 0.4
    hit: float = 0.0


class Foot:
    """The path of one foot: ankle (n, 3) in cm, rotation (n, 3, 3), bend of the toes (rad)."""

    def __init__(self, t, plants, pitch_deg, swings):
        self.pitch = np.radians(pitch_deg)
        self.ankle = np.zeros((len(t), 3))
        self.yaw = np.zeros(len(t))
        self.planted = np.zeros(len(t), bool)
        grip = np.zeros(len(t))
        for plant in plants:
            on = (t >= plant.start - 1e-9) & (t <= plant.end + 1e-9)
            self.planted |= on
            self.ankle[on] = self.on_floor(plant)[on]
            self.yaw[on] = np.radians(plant.yaw)
            grip = np.maximum(grip, np.clip(1.15 - np.maximum(plant.start - t, t - plant.end) / 0.12, 0, 1))
        for before, after, swing in zip(plants, plants[1:], swings):
            self.swing(t, before, after, swing)
        self.rotation = rot_y(self.yaw) @ rot_x(-self.pitch)
        self.toe_bend = np.minimum(np.maximum(-self.pitch, 0), TOE_BEND_RAD) * smoothed(grip, 0.02)

    def on_floor(self, plant):
        """Where the ankle is while the foot rolls over heel (toes up), ball and toes (toes down)."""
        tip = np.maximum(-self.pitch - TOE_BEND_RAD, 0)
        rolled = BALL + TOES - applied(rot_x(tip), TOES) - applied(rot_x(-self.pitch), BALL)
        local = np.where((self.pitch > 0)[:, None], HEEL - applied(rot_x(-self.pitch), HEEL), rolled)
        flat = np.array([plant.x, FLAT_ANKLE_CM, plant.z])
        return flat + applied(rot_y(np.full(len(local), np.radians(plant.yaw))), local)

    def swing(self, t, before, after, swing):
        """The way between two plants; it leaves and lands with the speed that the rolling foot has."""
        span = after.start - before.end
        inside = np.flatnonzero((t > before.end) & (t < after.start))
        s = ((t[inside] - before.end) / span)[:, None]
        ends = []
        for plant, at in ((before, before.end), (after, after.start)):
            path, i = self.on_floor(plant), int(round((at - t[0]) * FINE_HZ))
            i = min(max(i, 1), len(t) - 2)
            ends.append((path[i], (path[i + 1] - path[i - 1]) * FINE_HZ / 2 * span))
        (p0, v0), (p1, v1) = ends
        ahead = (p1 - p0) * np.array([1, 0, 1])
        hit = swing.hit * span * ahead / max(np.linalg.norm(ahead), 1e-6)
        if swing.hit > 0:
            # Hermite of third order: at once away, and down at the last moment.
            up = np.array([0, np.linalg.norm(hit), 0])
            way = p0 + (v0 + hit + up) * (s - 2 * s**2 + s**3) + (v1 + hit - up) * (s**3 - s**2)
            way = way + (p1 - p0) * (3 * s**2 - 2 * s**3)
        else:
            # Of fifth order, without acceleration at both ends.
            way = p0 + v0 * (s - 6 * s**3 + 8 * s**4 - 3 * s**5) + v1 * (-4 * s**3 + 7 * s**4 - 3 * s**5)
            way = way + (p1 - p0) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        # A bump that starts and ends without speed or acceleration, highest at `at`.
        a = 6.0 * swing.at
        b = 6.0 - a
        bump = (s / swing.at) ** a * ((1 - s) / (1 - swing.at)) ** b
        self.ankle[inside] = way + bump * np.array([0, swing.lift, 0])
        turn = np.radians(after.yaw - before.yaw)
        self.yaw[inside] = np.radians(before.yaw) + turn * (10 * s**3 - 15 * s**4 + 6 * s**5)[:, 0]


def two_bones(root, start, target, first, second, twist, bends=1):
    """World rotations of a limb's two bones that take its end to `target`: bones along -y of `root`
    swung the short way, their plane turned by `twist` about the limb, the second bone bent
    backwards (towards -z, a knee) or with `bends` = -1 forwards (an elbow)."""
    way = target - start
    reach = np.linalg.norm(way, axis=-1)
    length = np.clip(reach, abs(first - second) + 0.1, 0.9999 * (first + second))
    local = applied(transposed(root), way / reach[:, None])
    down = np.array([0, -1.0, 0])
    axis = np.cross(down, local)
    sine = np.linalg.norm(axis, axis=-1)
    angle = np.arctan2(sine, local @ down)
    swing = from_vector(axis * (angle / np.maximum(sine, 1e-9))[:, None])
    straight = root @ swing @ rot_y(twist)
    bend = np.pi - np.arccos(np.clip((first**2 + second**2 - length**2) / (2 * first * second), -1, 1))
    lean = np.arccos(np.clip((first**2 + length**2 - second**2) / (2 * first * length), -1, 1))
    upper = straight @ rot_x(-bends * lean)
    return upper, upper @ rot_x(bends * bend)


def euler_zxy(r):
    """Degrees about z, x, y of rotations r = rz rx ry."""
    x = np.arcsin(np.clip(r[:, 2, 1], -1, 1))
    z = np.arctan2(-r[:, 0, 1], r[:, 1, 1])
    y = np.arctan2(-r[:, 2, 0], r[:, 2, 2])
    return np.degrees(np.stack([z, x, y], -1))


def number(value):
    """A number in few characters."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def write_bvh(path, hips_cm, rotations):
    """Writes the hips' positions (n, 3) and the local rotations of the bones by name, n frames at
    RATE_HZ; a bone without rotations keeps still."""
    lines = ["HIERARCHY"]

    def bone(name, depth):
        pad = "  " * depth
        offset = np.zeros(3) if depth == 0 else OFFSET_CM[name]
        lines.append(f"{pad}{'ROOT' if depth == 0 else 'JOINT'} {name}")
        lines.append(f"{pad}{{")
        lines.append(f"{pad}  OFFSET {' '.join(number(v) for v in offset)}")
        place = "6 Xposition Yposition Zposition" if depth == 0 else "3"
        lines.append(f"{pad}  CHANNELS {place} Zrotation Xrotation Yrotation")
        order.append(name)
        children = [child for child, parent, _ in BONES if parent == name]
        for child in children:
            bone(child, depth + 1)
        if name in ENDS:
            end = STATURE_CM * np.array(ENDS[name])
            lines.append(f"{pad}  End Site")
            lines.append(f"{pad}  {{")
            lines.append(f"{pad}    OFFSET {' '.join(number(v) for v in end)}")
            lines.append(f"{pad}  }}")
        lines.append(f"{pad}}}")

    order = []
    bone("hips", 0)
    frames = len(hips_cm)
    angles = [euler_zxy(rotations[n]) if n in rotations else np.zeros((frames, 3)) for n in order]
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {1 / RATE_HZ:.9f}"]
    for row in np.concatenate([hips_cm, *angles], axis=1):
        lines.append(" ".join(number(v) for v in row))
    path.write_text("\n".join(lines) + "\n")
