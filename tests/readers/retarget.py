"""Retargets exports in Blender onto a rig with Mixamo's names, and measures the result. Too large for every run of CI.

    farfield export RUN --names mixamo --format bvh,glb --out MIXAMO
    pip install bpy
    python tests/readers/retarget.py RUN MIXAMO

Nothing is mapped by hand: bones are matched by their names only. The rig is made here as Blender imports a character of Mixamo:
centimetres with y up in an object that is rotated and scaled, Mixamo's hierarchy (two more spine bones, fingers), bones along their
own y with rolls of their own, other proportions. Each matched bone gets a Copy Rotation constraint in world space from a bone that
is added below ours with the rig's rest rotation, as retargeting add-ons do. The hips also get Copy Location, of our armature scaled
by the ratio of the leg lengths, so that the middles of the hip joints coincide.

Measured twice: as above, and with standing feet held at ours by inverse kinematics (Blender's IK on the legs with keyed influence:
legs of other proportions cannot have both our angles and our feet).

Bounds: rotations against those of poses.jsonl 2 degrees for each bone, directions of limbs 2 degrees. With held feet, standing feet
slide at most 5 % more than ours, scaled, which may cost the legs of these frames 3 degrees. Exits with 1 if one is exceeded.
"""

import pathlib
import sys

import bpy
import numpy as np
from mathutils import Matrix, Vector

from expected import Worst, angle_between_deg, poses, world_rotations

DEG, SLIDES = 2.0, 1.05
HELD_DEG = 3.0
STEP = 3
FADE = 8  # Frames over which feet are released.
PREFIX = "mixamorig:"
# Mixamo's bones in terms of poses.jsonl, for comparison; the last three turn with their parents.
OURS = {"Hips": "pelvis", "Spine": "spine", "Neck": "neck", "Head": "neck"}
for _side, _our in (("Left", "left_"), ("Right", "right_")):
    for _name, _bone in (("Shoulder", "scapula"), ("Arm", "shoulder"), ("ForeArm", "elbow"), ("Hand", "elbow"), ("UpLeg", "hip"), ("Leg", "knee"), ("Foot", "ankle"), ("ToeBase", "ankle")):
        OURS[_side + _name] = _our + _bone
# Limbs whose direction in a T-pose is the same in every rig: first and last of our joints.
LIMBS = {"Arm": ("shoulder", "elbow"), "ForeArm": ("elbow", "wrist"), "UpLeg": ("hip", "knee"), "Leg": ("knee", "ankle")}
# Blender's z-up world from ours: importers turn y up so that a person facing +z then faces -y.
BLENDER = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])

# Bone: parent, head and tail, centimetres, y up, facing +z, the left side; and the approximate direction of its z axis, its roll.
RIG = {
    "Hips": (None, (0, 104, 1), (0, 114, 1), (0, 0, 1)),
    "Spine": ("Hips", (0, 114, 0), (0, 125, -1), (0, 0, 1)),
    "Spine1": ("Spine", (0, 125, -1), (0, 138, -1), (0, 0, 1)),
    "Spine2": ("Spine1", (0, 138, -1), (0, 153, 0), (0, 0, 1)),
    "Neck": ("Spine2", (0, 153, 0), (0, 163, 2), (0, 0, 1)),
    "Head": ("Neck", (0, 163, 2), (0, 184, 3), (0, 0, 1)),
    "LeftShoulder": ("Spine2", (6, 148, 1), (18, 147, -1), (0, 0, -1)),
    "LeftArm": ("LeftShoulder", (18, 147, -1), (46, 147, -1), (0, -1, 0)),
    "LeftForeArm": ("LeftArm", (46, 147, -1), (74, 147, -1), (0, -1, 0)),
    "LeftHand": ("LeftForeArm", (74, 147, -1), (83, 147, -1), (0, 0, 1)),
    "LeftHandIndex1": ("LeftHand", (83, 147, 2), (87, 147, 2), (0, 0, 1)),
    "LeftUpLeg": ("Hips", (9, 99, 1), (9, 55, 1), (0, 0, -1)),
    "LeftLeg": ("LeftUpLeg", (9, 55, 1), (9, 9, 1), (0, 0, -1)),
    "LeftFoot": ("LeftLeg", (9, 9, 1), (10, 2, 13), (0, 1, 0)),
    "LeftToeBase": ("LeftFoot", (10, 2, 13), (10, 1, 20), (0, 1, 0)),
}


def make_rig():
    data = bpy.data.armatures.new("character")
    rig = bpy.data.objects.new("character", data)
    bpy.context.collection.objects.link(rig)
    # As the FBX importer leaves it.
    rig.matrix_world = Matrix.Rotation(np.pi / 2, 4, "X") @ Matrix.Scale(0.01, 4)
    with edited(rig):
        for name, (parent, head, tail, z_axis) in RIG.items():
            for side in ("Left", "Right") if name.startswith("Left") else ("",):
                mirror = Vector((-1, 1, 1)) if side == "Right" else Vector((1, 1, 1))
                bone = data.edit_bones.new(PREFIX + name.replace("Left", side))
                bone.head, bone.tail = Vector(head) * mirror, Vector(tail) * mirror
                bone.align_roll(Vector(z_axis))
                bone.parent = data.edit_bones.get(PREFIX + parent.replace("Left", side)) if parent else None
    return rig


class edited:
    """An armature in edit mode."""

    def __init__(self, armature):
        self.armature = armature

    def __enter__(self):
        bpy.context.view_layer.objects.active = self.armature
        bpy.ops.object.mode_set(mode="EDIT")

    def __exit__(self, *_):
        bpy.ops.object.mode_set(mode="OBJECT")
        bpy.context.view_layer.update()


def world_rest(armature, bone):
    return (armature.matrix_world @ bone.matrix_local).normalized()


def retarget(source, rig):
    """Binds the rig to our armature by names; returns those bones, and the scale and lift of ours."""
    matched = sorted(set(source.data.bones.keys()) & set(rig.data.bones.keys()))
    (ours, our_ankle, _), (theirs, ankle, hips) = leg(source), leg(rig)
    ratio = theirs / ours
    source.matrix_world = Matrix.Translation((0, 0, ankle - ratio * our_ankle)) @ Matrix.Scale(ratio, 4) @ source.matrix_world
    bpy.context.view_layer.update()
    to_ours = source.matrix_world.normalized().inverted()
    rests = {name: (to_ours @ world_rest(rig, rig.data.bones[name])).to_3x3() for name in matched}
    with edited(source):
        for name in matched:
            bone = source.data.edit_bones[name]
            helper = source.data.edit_bones.new(f"helper {name}")
            helper.head, helper.tail = bone.head, bone.head + Vector((0, bone.length, 0))
            # Hips begin elsewhere in every rig: the middles of the hip joints correspond.
            off = source.matrix_world.inverted().to_3x3() @ hips if name == PREFIX + "Hips" else Vector()
            helper.matrix = Matrix.Translation(bone.head + off) @ rests[name].to_4x4()
            helper.parent = bone
    for name in matched:
        bind(rig, name, "COPY_ROTATION", source)
    bind(rig, PREFIX + "Hips", "COPY_LOCATION", source)
    return matched, ratio


def leg(armature):
    """Thigh and shank, the height of the ankles above the lower end of the toes at rest, and the hips' head from the middle of the hip joints."""
    at = {name.removeprefix(PREFIX): armature.matrix_world @ bone.head_local for name, bone in armature.data.bones.items()}
    end = min((armature.matrix_world @ armature.data.bones[PREFIX + side + "ToeBase"].head_local).z for side in ("Left", "Right"))
    length = (at["LeftLeg"] - at["LeftUpLeg"]).length + (at["LeftFoot"] - at["LeftLeg"]).length
    return length, at["LeftFoot"].z - end, at["Hips"] - (at["LeftUpLeg"] + at["RightUpLeg"]) / 2


def bind(rig, name, kind, source):
    constraint = rig.pose.bones[name].constraints.new(kind)
    constraint.target, constraint.subtarget = source, f"helper {name}"
    constraint.target_space = constraint.owner_space = "WORLD"


def slides(heads, rate_hz, ratio):
    """Horizontal speed per frame and foot, m/s of our size: of the ankle or the toe, whichever is slower. `heads`: frames x 2 x 2 x 3."""
    speed = np.linalg.norm(np.diff(heads[..., :2], axis=0), axis=-1) * rate_hz / ratio
    return np.concatenate([speed[:1], speed]).min(axis=-1)


def standing(heads, rate_hz, ratio):
    """In which frames each of our feet stands: it is near its lowest position, and hardly moves."""
    low = heads[:, :, 0, 2] / ratio
    return (low < np.percentile(low, 10, axis=0) + 0.05) & (slides(heads, rate_hz, ratio) < 0.25)


def show(line, frame_of):
    frame = frame_of(line)
    bpy.context.scene.frame_set(int(frame), subframe=frame - int(frame))


def feet(armature):
    heads = [[armature.matrix_world @ armature.pose.bones[PREFIX + side + bone].head for bone in ("Foot", "ToeBase")] for side in ("Left", "Right")]
    return np.array(heads)


def hold_feet(rig, source, lines, frame_of, stands):
    """Keys inverse kinematics of the legs that holds the rig's feet at ours while these stand."""
    for i, side in enumerate(("Left", "Right")):
        ik = rig.pose.bones[PREFIX + side + "Leg"].constraints.new("IK")
        ik.target, ik.subtarget, ik.chain_count, ik.use_stretch = source, PREFIX + side + "Foot", 2, False
        # Full influence from a frame before to a frame after, fading over more frames, so that nothing jumps.
        away = [min((abs(k - j) for j in np.flatnonzero(stands[:, i])), default=FADE) for k in range(len(lines))]
        for line, frames in zip(lines, away):
            ik.influence = float(np.clip((1 + FADE - frames) / FADE, 0, 1))
            ik.keyframe_insert("influence", frame=frame_of(line))


def compare(what, rig, rest, line, worst):
    """Collects the differences of the rig's bones from those of the pose."""
    turned = world_rotations(line["angles"])
    for name, rest_rotation in rest.items():
        bone = rig.pose.bones[name]
        found = np.array((rig.matrix_world @ bone.matrix).to_3x3().normalized()) @ rest_rotation.T
        short = name.removeprefix(PREFIX)
        worst.take(f"{what} rotations deg", angle_between_deg(found, BLENDER @ turned[OURS[short]] @ BLENDER.T))
        limb, side = short.removeprefix("Left").removeprefix("Right"), "left_" if short.startswith("Left") else "right_"
        if limb in LIMBS:
            of, to = (BLENDER @ line["joints"][side + joint] for joint in LIMBS[limb])
            along = np.array((rig.matrix_world.to_3x3() @ (bone.tail - bone.head)).normalized())
            cosine = np.clip(along @ (to - of) / np.linalg.norm(to - of), -1, 1)
            worst.take(f"{what} directions of limbs deg", np.degrees(np.arccos(cosine)))


def check(kind, source, lines, frame_of, rate_hz, worst):
    rig = make_rig()
    matched, ratio = retarget(source, rig)
    worst.take(f"{kind}: bones without a partner", len({PREFIX + name for name in OURS} - set(matched)))
    rest = {name: np.array(world_rest(rig, rig.data.bones[name]).to_3x3()) for name in matched}
    ours, free, held = [], [], []
    for line in lines:
        show(line, frame_of)
        ours.append(feet(source))
        free.append(feet(rig))
        if line["tick"] % STEP == 0:
            compare(f"{kind}:", rig, rest, line, worst)
    stands = standing(np.array(ours), rate_hz, ratio)
    hold_feet(rig, source, lines, frame_of, stands)
    for line, any_stands in zip(lines, stands.any(axis=1)):
        show(line, frame_of)
        held.append(feet(rig))
        if any_stands:
            compare(f"{kind}, feet held:", rig, rest, line, worst)
    means = [100 * float(slides(np.array(heads), rate_hz, ratio)[stands].mean()) for heads in (ours, free, held)]
    worst.take(f"{kind}, feet held: sliding against ours", means[2] / means[0])
    print(f"{kind}, person {lines[0]['person']}: scaled by {ratio:.3f}; feet stand in {stands.sum()} frames and slide "
          "{:.2f} cm/s in ours, {:.2f} in the rig, {:.2f} with feet held".format(*means))
    bpy.data.objects.remove(rig)


def main(run, mixamo):
    mixamo = pathlib.Path(mixamo)
    by_person, rate_hz, first = poses(run)
    bounds = {}
    for kind in ("BVH", "glTF"):
        bounds |= {f"{kind}: bones without a partner": 0, f"{kind}, feet held: sliding against ours": SLIDES}
        bounds |= {f"{kind}{how}: {what} deg": most for how, most in (("", DEG), (", feet held", HELD_DEG)) for what in ("rotations", "directions of limbs")}
    worst = Worst(bounds)
    for person, lines in by_person.items():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.import_anim.bvh(filepath=str(mixamo / f"poses_{person}.bvh"), axis_forward="-Z", axis_up="Y", global_scale=0.01, frame_start=1)
        source = next(o for o in bpy.data.objects if o.type == "ARMATURE")
        check("BVH", source, lines, lambda line: 1 + line["tick"] - first, rate_hz, worst)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(rate_hz)
    bpy.ops.import_scene.gltf(filepath=str(mixamo / "poses.glb"))
    sources = {o.name: o for o in bpy.data.objects if o.type == "ARMATURE"}
    for person, lines in by_person.items():
        check("glTF", sources[f"person_{person}"], lines, lambda line: (line["tick"] - first) / rate_hz * bpy.context.scene.render.fps, rate_hz, worst)
    return worst.failures()


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    failed = main(*sys.argv[1:])
    sys.exit(f"out of bounds: {', '.join(failed)}" if failed else 0)
