"""Expected content of exports, computed from poses.jsonl in a second way: angles to rotations, with numpy only.

World: metres, z up; bodies at rest: x forward, y left, z up. See docs/exports.md.
"""

import json
import pathlib

import numpy as np

# Bone: parent, first joint, angles of the rotation as (name, axis, sign), in our axes (x, y, z).
LEG = (("hip_flexion", "y", -1), ("hip_adduction", "x", 1), ("hip_rotation", "z", 1))
FOOT = (("ankle_angle", "y", -1), ("subtalar_angle", "x", 1), ("foot_rotation", "z", 1))
SCAPULA = (("scapula_elevation", "x", -1), ("scapula_protraction", "z", 1), ("scapula_tilt", "y", 1))
ARM = (("arm_flex", "y", -1), ("arm_add", "x", 1), ("arm_rot", "z", 1))
BONES = {
    "spine": (("lumbar_extension", "y", -1), ("lumbar_bending", "x", 1), ("lumbar_rotation", "z", 1)),
    "neck": (("neck_flexion", "y", 1), ("neck_bending", "x", 1), ("neck_rotation", "z", 1)),
    "scapula": SCAPULA,
    "shoulder": ARM,
    "elbow": (("elbow_flex", "y", -1),),
    "hip": LEG,
    "knee": (("knee_angle", "y", 1),),
    "ankle": FOOT,
}
# Bones whose rest is raised by a quarter turn in a T-pose.
RAISED = ("shoulder", "elbow")
Y_UP = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])


def about(axis, angle):
    """A rotation about a coordinate axis, radians."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    r = np.eye(3)
    r[i, i] = r[j, j] = c
    r[i, j], r[j, i] = -s, s
    return r


def local_rotations(angles):
    """Per bone (by our names): its rotation relative to its parent and to the T-pose, in body axes."""
    # The pelvis is reported in OpenSim's axes (forward, up, right) in a ground with y up.
    opensim = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    turned = about("z", angles["pelvis_tilt"]) @ about("x", angles["pelvis_list"]) @ about("y", angles["pelvis_rotation"])
    rotations = {"pelvis": Y_UP.T @ turned @ opensim.T}
    for part, turns in BONES.items():
        for side in [""] if part in ("spine", "neck") else ["left", "right"]:
            r = np.eye(3)
            for name, axis, sign in turns:
                # About x and z the left side is the mirror of the right.
                mirrored = side == "left" and axis in "xz"
                r = r @ about(axis, angles[name + {"": "", "left": "_l", "right": "_r"}[side]] * (-sign if mirrored else sign))
            if part in RAISED:
                up = about("x", np.pi / 2 if side == "left" else -np.pi / 2)
                # world_from_bone = world_from_link rest^-1; the elbow's parent is raised as well.
                r = up @ r @ up.T if part == "elbow" else r @ up.T
            rotations[f"{side}_{part}" if side else part] = r
    return rotations


def angle_between_deg(a, b):
    """Angle between two rotations, degrees; exact also for small angles."""
    return np.degrees(2 * np.arcsin(min(1.0, np.linalg.norm(a - b) / (2 * np.sqrt(2)))))


def poses(run):
    """Lines of poses.jsonl by person, and the rate of the run."""
    run = pathlib.Path(run)
    by_person = {}
    for line in (run / "poses.jsonl").read_text().splitlines():
        pose = json.loads(line)
        by_person.setdefault(pose["person"], []).append(pose)
    summary = json.loads((run / "summary.json").read_text())
    return by_person, summary["rate_hz"], summary["ticks"]["first"]


class Worst:
    """The largest difference per name, and whether all are within their bounds."""

    def __init__(self, bounds):
        self.bounds, self.found, self.counts = bounds, {}, {}

    def take(self, what, value):
        self.found[what] = max(self.found.get(what, 0.0), float(value))
        self.counts[what] = self.counts.get(what, 0) + 1

    def failures(self):
        failed = []
        for what, bound in self.bounds.items():
            found = self.found.get(what)
            print(f"{what:40} {found if found is not None else 'nothing':<24} bound {bound}  ({self.counts.get(what, 0)} compared)")
            # Not "greater": NaN must fail too.
            if found is None or not found <= bound:
                failed.append(what)
        return failed


PARENTS = {"spine": "pelvis", "neck": "spine"}
for _side in ("left_", "right_"):
    for _bone, _parent in (("scapula", "spine"), ("shoulder", "scapula"), ("elbow", "shoulder"), ("hip", "pelvis"), ("knee", "hip"), ("ankle", "knee")):
        PARENTS[_side + _bone] = _parent if _parent in ("spine", "pelvis") else _side + _parent


def world_rotations(angles):
    """Per bone: its rotation in the world relative to the T-pose."""
    local = local_rotations(angles)
    world = {"pelvis": local["pelvis"]}
    for bone, parent in PARENTS.items():
        world[bone] = world[parent] @ local[bone]
    return world
