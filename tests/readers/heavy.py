"""Opens exports in OpenSim and Blender, which are too large for every run of CI.

    pip install opensim numpy;  python tests/readers/heavy.py opensim RUN SETTLED
    pip install bpy;            python tests/readers/heavy.py blender RUN MEASURED

RUN is the run's folder with its TRC and MOT files; SETTLED and MEASURED contain its exports in all formats with
`lengths=settled` and `lengths=measured`, at the run's rate. Bounds: joints 1 mm, rotations 0.01 degrees. The two need different
versions of numpy, so use an environment for each. Exits with 1 if a bound is exceeded.
"""

import json
import pathlib
import struct
import sys

import numpy as np

from expected import PARENTS, Worst, Y_UP, angle_between_deg, poses, world_rotations

MM, DEG = 1.0, 0.01
BACKWARDS_DEG = 10.0  # A straight limb is found a little beyond.
STEP = 7


def rest_offsets_m(glb):
    """Per person and bone: its origin relative to its parent, in body axes, from the nodes of a binary glTF file."""
    data = pathlib.Path(glb).read_bytes()
    nodes = json.loads(data[20 : 20 + struct.unpack("<I", data[12:16])[0]])["nodes"]
    people = {}

    def visit(node, offsets):
        offsets[node["name"]] = Y_UP.T @ node["translation"]
        for child in node.get("children", []):
            visit(nodes[child], offsets)
        return offsets

    for node in nodes:
        if node["name"].startswith("person_"):
            people[node["extras"]["person"]] = visit(nodes[node["children"][0]], {})
    return people


def settled_joints_m(line, offsets):
    """Joints of a pose in the world, of a body with these offsets."""
    world = world_rotations(line["angles"])
    joints = {"pelvis": np.array(line["joints"]["pelvis"])}
    for bone, parent in PARENTS.items():
        joints[bone] = joints[parent] + world[parent] @ offsets[bone]
    return joints


def check_opensim(run, settled):
    import opensim

    opensim.Logger.setLevelString("Error")
    run, settled = pathlib.Path(run), pathlib.Path(settled)
    by_person, rate_hz, first = poses(run)
    offsets = rest_offsets_m(settled / "poses.glb")
    worst = Worst({"OpenSim joints mm": MM, "OpenSim reads of TRC mm": 0.05, "OpenSim knees, elbows backwards deg": BACKWARDS_DEG})
    for person, lines in by_person.items():
        model = opensim.Model(str(settled / f"model_{person}.osim"))
        state = model.initSystem()
        assert model.getCoordinateSet().getSize() == 40, model.getCoordinateSet().getSize()
        motion = opensim.TimeSeriesTable(str(run / f"angles_{person}.mot"))
        in_degrees = motion.getTableMetaDataString("inDegrees") == "yes"
        markers = opensim.TimeSeriesTableVec3(str(run / f"poses_{person}.trc"))
        unknown = [name for name in motion.getColumnLabels() if not model.getCoordinateSet().contains(name)]
        unknown += [name for name in markers.getColumnLabels() if not model.getMarkerSet().contains(name)]
        assert not unknown, f"not in the model: {unknown}"
        times = np.array(motion.getIndependentColumn())
        marker_times = np.array(markers.getIndependentColumn())
        apart = []
        for line in lines[::STEP]:
            time = (line["tick"] - first) / rate_hz
            row = motion.getRowAtIndex(int(np.abs(times - time).argmin()))
            values = dict(line["angles"])
            for k, name in enumerate(motion.getColumnLabels()):
                is_length = name in ("pelvis_tx", "pelvis_ty", "pelvis_tz")
                values[name] = np.radians(row[k]) if in_degrees and not is_length else row[k]
            for name, value in values.items():
                model.getCoordinateSet().get(name).setValue(state, value, False)
            model.realizePosition(state)
            at = {m.getName(): m.getLocationInGround(state).to_numpy() for m in model.getMarkerSet()}
            for name, joint in settled_joints_m(line, offsets[person]).items():
                worst.take("OpenSim joints mm", 1000 * np.linalg.norm(at[name] - Y_UP @ joint))
            row = markers.getRowAtIndex(int(np.abs(marker_times - time).argmin()))
            for k, name in enumerate(markers.getColumnLabels()):
                found = row[k].to_numpy()
                if not np.isnan(found).any():
                    apart.append(1000 * np.linalg.norm(at[name] - found))
                    if name in line["joints"]:
                        worst.take("OpenSim reads of TRC mm", 1000 * np.linalg.norm(Y_UP @ line["joints"][name] - found))
        print(f"person {person}: model moved by MOT against TRC: median {np.median(apart):.2f} mm, largest {max(apart):.2f} mm")
    for person in by_person:
        inverse_kinematics(opensim, run, settled, person, by_person, rate_hz, first, worst)
    return worst.failures()


def inverse_kinematics(opensim, run, settled, person, by_person, rate_hz, first, worst):
    """Prints the differences between OpenSim's angles for our markers and ours; only requires that knees and elbows bend forwards."""
    lines = by_person[person]
    lines = lines[len(lines) // 2 :][:60]
    tool = opensim.InverseKinematicsTool()
    model = opensim.Model(str(settled / f"model_{person}.osim"))
    model.initSystem()
    tool.setModel(model)
    tool.setMarkerDataFileName(str(run / f"poses_{person}.trc"))
    for name in opensim.TimeSeriesTableVec3(str(run / f"poses_{person}.trc")).getColumnLabels():
        task = opensim.IKMarkerTask()
        task.setName(name)
        task.setApply(True)
        task.setWeight(1.0)
        tool.getIKTaskSet().cloneAndAppend(task)
    tool.setStartTime((lines[0]["tick"] - first) / rate_hz)
    tool.setEndTime((lines[-1]["tick"] - first) / rate_hz)
    out = settled / f"inverse_kinematics_{person}.mot"
    tool.setOutputMotionFileName(str(out))
    tool.setResultsDir(str(settled))
    tool.run()
    found = opensim.TimeSeriesTable(str(out))
    times = np.array(found.getIndependentColumn())
    print(f"inverse kinematics of person {person}, {len(lines)} ticks: median and largest difference from ours")
    for name in lines[0]["angles"]:
        column = found.getDependentColumn(name).to_numpy()
        ours = np.array([line["angles"][name] for line in lines])
        theirs = np.array([column[np.abs(times - (line["tick"] - first) / rate_hz).argmin()] for line in lines])
        if name in ("pelvis_tx", "pelvis_ty", "pelvis_tz"):
            apart, unit = 1000 * np.abs(theirs - ours), "mm"
        else:
            apart, unit = np.abs((theirs - np.degrees(ours) + 180) % 360 - 180), "deg"
        if name.startswith(("knee_angle", "elbow_flex")):
            worst.take("OpenSim knees, elbows backwards deg", max(0, -theirs.min()))
        n_guessed = sum(name in line["unobserved"] for line in lines)
        guessed = f" (flagged as not observed in {n_guessed} ticks)" if n_guessed else ""
        print(f"  {name:26} {np.median(apart):8.2f} {apart.max():8.2f} {unit}{guessed}")


def check_blender(run, measured):
    import bpy

    run, measured = pathlib.Path(run), pathlib.Path(measured)
    by_person, rate_hz, first = poses(run)
    worst = Worst({f"Blender, {kind} {what}": bound for kind in ("BVH", "glTF") for what, bound in (("joints mm", MM), ("rotations deg", DEG))})
    # Blender's z-up world from ours: importers turn y up so that a person facing +z then faces -y.
    blender = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])

    def compare(kind, armature, lines, frame_of):
        rest = {b.name: np.array((armature.matrix_world @ b.matrix_local).to_3x3().normalized()) for b in armature.data.bones}
        for line in lines[::STEP]:
            frame = frame_of(line)
            bpy.context.scene.frame_set(int(frame), subframe=frame - int(frame))
            turned = world_rotations(line["angles"])
            for bone in armature.pose.bones:
                # Bones of a second armature are named spine.001.
                name = bone.name.split(".")[0]
                world = armature.matrix_world @ bone.matrix
                if name in line["joints"]:
                    at = np.array(world.translation)
                    worst.take(f"Blender, {kind} joints mm", 1000 * np.linalg.norm(at - blender @ line["joints"][name]))
                if name in turned:
                    found = np.array(world.to_3x3().normalized()) @ rest[bone.name].T
                    worst.take(f"Blender, {kind} rotations deg", angle_between_deg(found, blender @ turned[name] @ blender.T))

    for person, lines in by_person.items():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.ops.import_anim.bvh(filepath=str(measured / f"poses_{person}.bvh"), axis_forward="-Z", axis_up="Y", global_scale=0.01, frame_start=1)
        armature = next(o for o in bpy.data.objects if o.type == "ARMATURE")
        compare("BVH", armature, lines, lambda line: 1 + line["tick"] - first)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = round(rate_hz)
    bpy.ops.import_scene.gltf(filepath=str(measured / "poses.glb"))
    armatures = {o.name: o for o in bpy.data.objects if o.type == "ARMATURE"}
    for person, lines in by_person.items():
        compare("glTF", armatures[f"person_{person}"], lines, lambda line: (line["tick"] - first) / rate_hz * bpy.context.scene.render.fps)
    return worst.failures()


if __name__ == "__main__":
    checks = {"opensim": check_opensim, "blender": check_blender}
    if len(sys.argv) != 4 or sys.argv[1] not in checks:
        sys.exit(__doc__)
    failed = checks[sys.argv[1]](*sys.argv[2:])
    sys.exit(f"out of bounds: {', '.join(failed)}" if failed else 0)
