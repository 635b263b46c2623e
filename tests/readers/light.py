"""Reads exports with other people's readers and compares them with poses.jsonl.

    pip install bvhio ezc3d c3d pygltflib pyarrow numpy mcap mcap-protobuf-support foxglove-schemas-protobuf jsonschema
    python tests/readers/light.py RUN MEASURED SETTLED [VALIDATOR [CALIBRATION]]

RUN is the run's folder; MEASURED and SETTLED contain its exports in all formats with `lengths=measured` and `lengths=settled`,
at the run's rate. VALIDATOR is the folder of npm's gltf-validator; without it, or without Node, that check is skipped with a
message. CALIBRATION is the calibration of the run's cameras, if it is not in the run's folder as of a demo (exports then need
`--venue`); with `-` the cameras in MCAP are not compared, with a message. Bounds: joints 1 mm, rotations 0.01 degrees. Exits with
1 if one is exceeded.
"""

import json
import pathlib
import shutil
import subprocess
import sys
import tomllib
import warnings

import numpy as np

from expected import Y_UP, Worst, angle_between_deg, local_rotations, poses

MM, DEG = 1.0, 0.01
STEP = 7  # Every so many ticks are compared: bvhio is slow.


def check_bvh(folder, mode, by_person, first, worst):
    import bvhio

    for person, lines in by_person.items():
        root = bvhio.readAsHierarchy(str(folder / f"poses_{person}.bvh"))
        joints = {joint.Name: joint for joint, _, _ in root.layout()}
        parent_of = {child.Name: joint.Name for joint in joints.values() for child in joint.Children}
        # It aligns the axes of every joint with the bone: relative to the rest in the world the rotation is ours again.
        root.loadRestPose()
        at_rest = {name: world_rotation(joint) for name, joint in joints.items()}
        for line in lines[::STEP]:
            root.loadPose(line["tick"] - first)
            for name, at in line["joints"].items():
                if name in joints and mode == "measured":
                    p = joints[name].PositionWorld
                    worst.take("bvhio joints mm", 10 * np.linalg.norm(np.array([p.x, p.y, p.z]) - 100 * Y_UP @ at))
            for name, rotation in local_rotations(line["angles"]).items():
                world = world_rotation(joints[name]) @ at_rest[name].T
                parent = parent_of.get(name)
                above = world_rotation(joints[parent]) @ at_rest[parent].T if parent else np.eye(3)
                found = above.T @ world
                worst.take(f"bvhio rotations deg, {mode}", angle_between_deg(found, Y_UP @ rotation @ Y_UP.T))


def world_rotation(joint):
    q = joint.RotationWorld
    return quaternion(q.x, q.y, q.z, q.w)


def quaternion(x, y, z, w):
    n = np.sqrt(x * x + y * y + z * z + w * w)
    x, y, z, w = x / n, y / n, z / n, w / n
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def accessor(gltf, index):
    a = gltf.accessors[index]
    view = gltf.bufferViews[a.bufferView]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[a.type]
    data = gltf.get_data_from_buffer_uri(gltf.buffers[0].uri) if gltf.buffers[0].uri else gltf.binary_blob()
    values = np.frombuffer(data, "<f4", a.count * width, (view.byteOffset or 0) + (a.byteOffset or 0))
    return values.reshape(a.count, width).astype(float)


def check_gltf(path, mode, by_person, rate_hz, first, worst):
    import pygltflib

    gltf = pygltflib.GLTF2().load(str(path))
    tracks = {}
    for channel in gltf.animations[0].channels:
        sampler = gltf.animations[0].samplers[channel.sampler]
        tracks[channel.target.node, channel.target.path] = (accessor(gltf, sampler.input)[:, 0], accessor(gltf, sampler.output))
    for (_, path_), (_, values) in tracks.items():
        if path_ == "rotation" and len(values) > 1:
            turned_over = np.sum(values[1:] * values[:-1], axis=1).min()
            worst.take("glTF sign flips", 0 if turned_over >= 0 else 1)
    for node in gltf.nodes:
        if not (node.name or "").startswith("person_"):
            continue
        lines = by_person[node.extras["person"]]
        for line in lines[::STEP]:
            place(gltf, tracks, node.children[0], np.eye(3), np.zeros(3), line, (line["tick"] - first) / rate_hz, mode, worst)
    for skin in gltf.skins:
        inverse = accessor(gltf, skin.inverseBindMatrices).reshape(-1, 4, 4)
        rest = {}
        for index in skin.joints:
            parent = next((i for i in skin.joints if index in (gltf.nodes[i].children or [])), None)
            rest[index] = rest.get(parent, np.zeros(3)) + np.array(gltf.nodes[index].translation)
        for index, matrix in zip(skin.joints, inverse):
            worst.take("glTF inverse bind matrices mm", 1000 * np.abs(matrix[3, :3] + rest[index]).max())


def place(gltf, tracks, index, world, at, line, time, mode, worst):
    node = gltf.nodes[index]
    here = np.array(node.translation)
    local = np.eye(3)
    for path, kind in (("translation", 0), ("rotation", 1)):
        if (index, path) in tracks:
            times, values = tracks[index, path]
            key = int(np.abs(times - time).argmin())
            worst.take("glTF times s", abs(times[key] - time))
            if kind == 0:
                here = values[key]
            else:
                local = quaternion(*values[key])
    at = at + world @ here
    rotation = local_rotations(line["angles"]).get(node.name)
    if rotation is not None:
        worst.take(f"glTF rotations deg, {mode}", angle_between_deg(local, Y_UP @ rotation @ Y_UP.T))
    if node.name in line["joints"] and mode == "measured":
        worst.take("glTF joints mm", 1000 * np.linalg.norm(at - Y_UP @ line["joints"][node.name]))
    for child in node.children or []:
        place(gltf, tracks, child, world @ local, at, line, time, mode, worst)


def check_c3d(folder, by_person, first, worst):
    import c3d
    import ezc3d

    for person, lines in by_person.items():
        path = folder / f"poses_{person}.c3d"
        file = ezc3d.c3d(str(path))
        labels = file["parameters"]["POINT"]["LABELS"]["value"]
        data = file["data"]["points"]
        for line in lines:
            for name, at in named_points(line):
                if name not in labels:
                    continue  # No keypoint determines its position.
                point = data[:3, labels.index(name), line["tick"] - first]
                if line["sigma_m"].get(name.removeprefix("keypoint_"), 0) > 0.1:
                    continue  # Its position is unknown, and the file says so.
                worst.take("ezc3d points mm", np.linalg.norm(point - 1000 * np.array(at)))
        with open(path, "rb") as opened, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            reader = c3d.Reader(opened)
            labels = [label.strip() for label in reader.point_labels]
            by_frame = {line["tick"] - first + 1: line for line in lines}
            for number, points, _ in reader.read_frames():
                for name, at in named_points(by_frame[number]) if number in by_frame else []:
                    if name not in labels:
                        continue
                    point = points[labels.index(name)]
                    if point[3] >= 0:
                        worst.take("c3d points mm", np.linalg.norm(point[:3] - 1000 * np.array(at)))


def named_points(line):
    yield from line["joints"].items()
    for name, at in line["keypoints"].items():
        yield (f"keypoint_{name}" if name in line["joints"] else name), at


def check_csv(folder, by_person, worst):
    from pyarrow import csv

    for person, lines in by_person.items():
        table = csv.read_csv(folder / f"poses_{person}.csv").to_pydict()
        row_of = {round(tick): row for row, tick in enumerate(table["tick"])}
        for line in lines:
            row = row_of[line["tick"]]
            for name, at in named_points(line):
                found = [table[f"{name}_{axis}_m"][row] for axis in "xyz"]
                worst.take("CSV points mm", 1000 * np.linalg.norm(np.array(found) - at))
            for name, value in line["angles"].items():
                if not name.startswith("pelvis_t") or name == "pelvis_tilt":
                    if name in line["unobserved"]:
                        worst.take("CSV unobserved angles with a number", 0 if table[f"{name}_deg"][row] is None else 1)
                        continue
                    apart = np.radians(table[f"{name}_deg"][row]) - value
                    worst.take("CSV angles deg", abs(np.degrees(np.angle(np.exp(1j * apart)))))
    table = csv.read_csv(folder / "poses_tidy.csv").to_pydict()
    n_expected = sum(len(line["joints"]) + len(line["keypoints"]) + 40 for lines in by_person.values() for line in lines)
    worst.take("CSV tidy rows missing", abs(n_expected - len(table["item"])))
    n_unobserved = sum(len(line["unobserved"]) for lines in by_person.values() for line in lines)
    n_found = sum(kind == "angle" and not observed for kind, observed in zip(table["kind"], table["observed"]))
    worst.take("CSV tidy angles marked wrongly", abs(n_unobserved - n_found))


def check_parquet(folder, by_person, worst):
    from pyarrow import parquet

    table = parquet.read_table(folder / "poses.parquet").to_pydict()
    row_of = {key: row for row, key in enumerate(zip(table["person"], map(round, table["tick"])))}
    worst.take("Parquet rows missing", abs(sum(map(len, by_person.values())) - len(row_of)))
    for person, lines in by_person.items():
        for line in lines:
            row = row_of[person, line["tick"]]
            for name, at in named_points(line):
                found = [table[f"{name}_{axis}_m"][row] for axis in "xyz"]
                worst.take("Parquet points mm", 1000 * np.linalg.norm(np.array(found) - at))
            known = {name for name in line["angles"] if table[f"{name}_{unit(name)}"][row] is not None}
            worst.take("Parquet angles marked wrongly", len(known ^ (set(line["angles"]) - set(line["unobserved"]))))


def unit(angle):
    return "m" if angle in ("pelvis_tx", "pelvis_ty", "pelvis_tz") else "deg"


def check_mcap(run, calibration, path, by_person, rate_hz, first, worst):
    """By mcap and mcap-protobuf-support, which decode with the schemas in the file; and against the schemas that Foxglove publishes."""
    import jsonschema
    from mcap.reader import make_reader
    from mcap_protobuf.decoder import DecoderFactory

    lines_at = {}
    for person, lines in by_person.items():
        for line in lines:
            lines_at.setdefault(line["tick"], {})[person] = line
    cameras, counts, validators, last = {}, {}, {}, 0
    with open(path, "rb") as opened:
        reader, decoder = make_reader(opened), DecoderFactory()
        for schema, channel, message in reader.iter_messages():
            worst.take("MCAP messages out of order", int(message.log_time < last))
            last, tick = message.log_time, first + round(message.log_time * 1e-9 * rate_hz)
            worst.take("MCAP times s", abs(message.log_time * 1e-9 - (tick - first) / rate_hz))
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if channel.message_encoding == "json":
                validator = validators.setdefault(schema.id, jsonschema.Draft202012Validator(json.loads(schema.data)))
                angles_message = json.loads(message.data)
                worst.take("MCAP angles against their schema", sum(1 for _ in validator.iter_errors(angles_message)))
                check_mcap_angles(angles_message, lines_at[tick][int(channel.topic.split("_")[1].split("/")[0])], worst)
                continue
            worst.take("MCAP messages that are not Foxglove's", published(schema, message.data))
            decoded = decoder.decoder_for(channel.message_encoding, schema)(message.data)
            if channel.topic == "/people":
                check_mcap_people(decoded, lines_at.get(tick, {}), worst)
            elif channel.topic == "/tf":
                check_mcap_frames(decoded, lines_at.get(tick, {}), worst)
            elif channel.topic == "/tf_static":
                cameras |= {transform.child_frame_id: [transform] for transform in decoded.transforms}
            else:
                cameras[decoded.frame_id].append(decoded)
        summary = reader.get_summary()
        worst.take("MCAP messages that its index lacks", abs(summary.statistics.message_count - sum(counts.values())))
    n_angles = sum(count for topic, count in counts.items() if topic.endswith("/angles"))
    worst.take("MCAP poses missing", abs(n_angles - sum(map(len, by_person.values()))) + abs(counts["/tf"] - len(lines_at)))
    check_mcap_cameras(calibration, cameras, worst)


def published(schema, data):
    """Whether Foxglove's own classes fail on these bytes or find unknown fields in them."""
    import importlib

    from google.protobuf import unknown_fields

    name = schema.name.removeprefix("foxglove.")
    message = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name).FromString(data)

    def has_unknown(message):
        inner = [value for field, value in message.ListFields() if field.message_type]
        inner = [one for value in inner for one in (value if hasattr(value, "append") else [value])]
        return len(unknown_fields.UnknownFieldSet(message)) > 0 or any(map(has_unknown, inner))

    return int(not message.ListFields() or has_unknown(message) or message.SerializeToString() != data)


def check_mcap_people(update, lines, worst):
    worst.take("MCAP people wrong", int({entity.id for entity in update.entities} != {f"person_{person}" for person in lines}))
    for entity in update.entities:
        joints = np.array(list(lines[int(entity.id.removeprefix("person_"))]["joints"].values()))
        line = entity.lines[0]
        found = np.array([[p.x, p.y, p.z] for p in line.points])
        worst.take("MCAP joints mm", 1000 * np.abs(found - joints).max())
        worst.take("MCAP limbs missing", abs(len(line.indices) - 2 * (len(joints) - 1)))
        worst.take("MCAP labels wrong", int(entity.texts[0].text != entity.id or entity.frame_id != "world"))


def check_mcap_frames(message, lines, worst):
    for transform in message.transforms:
        line = lines[int(transform.child_frame_id.removeprefix("person_"))]
        at, q = transform.translation, transform.rotation
        worst.take("MCAP joints mm", 1000 * np.linalg.norm(np.array([at.x, at.y, at.z]) - line["joints"]["pelvis"]))
        worst.take("MCAP rotations deg", angle_between_deg(quaternion(q.x, q.y, q.z, q.w), local_rotations(line["angles"])["pelvis"]))


def check_mcap_angles(angles_message, line, worst):
    known = {name for name in line["angles"] if name not in line["unobserved"] and unit(name) == "deg"}
    worst.take("MCAP angles marked wrongly", len(known ^ set(angles_message["angles_deg"])) + int(angles_message["tick"] != line["tick"]))
    for name in known & set(angles_message["angles_deg"]):
        apart = np.radians(angles_message["angles_deg"][name]) - line["angles"][name]
        worst.take("MCAP angles deg", abs(np.degrees(np.angle(np.exp(1j * apart)))))


def check_mcap_cameras(calibration, cameras, worst):
    """The axis of each camera, its position and its lens, from the calibration in a second way."""
    if calibration is None:
        print("MCAP cameras: not checked, as was asked")
        return
    read = {f"camera_{c['name']}": c for c in tomllib.loads(calibration.read_text()).values() if isinstance(c, dict) and "matrix" in c}
    worst.take("MCAP cameras missing", len(set(read) ^ set(cameras)))
    for name, (transform, info) in cameras.items():
        expected, q, at = read[name], transform.rotation, transform.translation
        vector = np.array(expected["rotation"])
        angle = np.linalg.norm(vector)
        axis = vector / angle
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        camera_from_world = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        worst.take("MCAP rotations deg", angle_between_deg(quaternion(q.x, q.y, q.z, q.w), camera_from_world.T))
        place = -camera_from_world.T @ np.array(expected["translation"])
        worst.take("MCAP joints mm", 1000 * np.linalg.norm(np.array([at.x, at.y, at.z]) - place))
        lens = np.abs(np.array(info.K).reshape(3, 3) - expected["matrix"]).max() + np.abs(np.array(info.D)[:5] - expected["distortions"][:5]).max()
        worst.take("MCAP lenses", lens + abs(info.width - expected["size"][0]) + abs(info.height - expected["size"][1]))


def check_validator(folders, validator, worst):
    if validator is None or shutil.which("node") is None:
        print("gltf-validator: Node or the package is not there, not checked")
        return
    script = (
        "const v=require(process.argv[1]),fs=require('fs');"
        "v.validateBytes(new Uint8Array(fs.readFileSync(process.argv[2])))"
        ".then(r=>console.log(r.issues.numErrors+r.issues.numWarnings+r.issues.numInfos+r.issues.numHints))"
    )
    for folder in folders:
        for path in sorted(folder.glob("*.gl*")):
            result = subprocess.run(["node", "-e", script, validator, path], capture_output=True, text=True, check=True)
            worst.take("gltf-validator issues", int(result.stdout))


def main(run, measured, settled, validator=None, calibration=None):
    calibration = None if calibration == "-" else pathlib.Path(calibration or pathlib.Path(run) / "venue" / "calibration.toml")
    by_person, rate_hz, first = poses(run)
    bounds = {"bvhio joints mm": MM, "glTF joints mm": MM, "ezc3d points mm": MM, "c3d points mm": MM, "CSV points mm": MM}
    bounds |= {"glTF inverse bind matrices mm": 1e-3, "glTF times s": 1e-4, "glTF sign flips": 0, "CSV angles deg": DEG}
    bounds |= {"CSV tidy rows missing": 0, "Parquet rows missing": 0, "Parquet points mm": MM}
    bounds |= {"CSV unobserved angles with a number": 0, "CSV tidy angles marked wrongly": 0, "Parquet angles marked wrongly": 0}
    bounds |= {"MCAP joints mm": MM, "MCAP rotations deg": DEG, "MCAP angles deg": DEG, "MCAP times s": 1e-6, "MCAP lenses": 1e-6}
    wrong = ("messages out of order", "angles against their schema", "messages that are not Foxglove's", "messages that its index lacks")
    wrong += ("poses missing", "people wrong", "limbs missing", "labels wrong", "angles marked wrongly", "cameras missing")
    bounds |= {f"MCAP {what}": 0 for what in wrong}
    worst = Worst(bounds)
    folders = {"measured": pathlib.Path(measured), "settled": pathlib.Path(settled)}
    for mode, folder in folders.items():
        bounds |= {f"bvhio rotations deg, {mode}": DEG, f"glTF rotations deg, {mode}": DEG}
        check_bvh(folder, mode, by_person, first, worst)
        for name in ("poses.glb", "poses.gltf"):
            check_gltf(folder / name, mode, by_person, rate_hz, first, worst)
        check_c3d(folder, by_person, first, worst)
        check_csv(folder, by_person, worst)
        check_parquet(folder, by_person, worst)
        check_mcap(run, calibration, folder / "poses.mcap", by_person, rate_hz, first, worst)
    check_validator(folders.values(), validator, worst)
    if "gltf-validator issues" in worst.found:
        bounds["gltf-validator issues"] = 0
    if calibration is None:
        del bounds["MCAP lenses"], bounds["MCAP cameras missing"]
    worst.bounds = bounds
    return worst.failures()


if __name__ == "__main__":
    if len(sys.argv) not in (4, 5, 6):
        sys.exit(__doc__)
    failed = main(*sys.argv[1:])
    sys.exit(f"out of bounds: {', '.join(failed)}" if failed else 0)
