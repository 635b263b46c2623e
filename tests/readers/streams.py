"""Receives the live streams with other people's clients and compares them with the streamed motion.

    pip install qtm-rt motioncapture python-osc websockets pypsn foxglove-schemas-protobuf eclipse-zenoh rosbags pylsl numpy
    cargo run -p farfield-streams --example synthetic -- --truth TRUTH --seconds 90 qtm vmc websocket foxglove zenoh ros2 psn lsl
    python tests/readers/streams.py TRUTH [--seconds 5] [--only NAME,...] [--node-modules DIR]

It starts nothing: the streams must run at their default addresses. DIR contains npm's qualisys-rt, @foxglove/ws-protocol and ws;
without it, or without Node, their clients are skipped with a message. While the clients receive, one after another, two more are
connected and read nothing. Bounds: for positions the resolution of each format; 1 mm for joints after the client's own forward
kinematics, 0.01 degrees for rotations; at most every twentieth tick lost, as streams skip ticks on a busy machine (none on an idle
one). Prints per client: frames, ticks a second, ticks lost, and delay of a tick (P50, P99). Exits with 1 if a bound is exceeded.
"""

import argparse
import asyncio
import base64
import json
import os
import shutil
import socket
import struct
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as tree

import numpy as np

from expected import Worst, angle_between_deg, local_rotations

HOST = "127.0.0.1"
# A float of millimetres below 16 m has steps of 0.001, one of metres of a micrometre; JSON has micrometres. The truth is in floats
# of metres itself.
BOUNDS = {"mm": 0.002, "FK mm": 1.0, "deg": 0.01, "m/s": 0.001, "angle rad": 1e-6}
UNITY = np.array([[0.0, -1, 0], [0, 0, 1], [1, 0, 0]])  # Left-handed, y up, z forward; PosiStageNet too.

# Segments of Qualisys' skeletons and bones of Unity's humanoid: first joint, parent.
SIDED = (("Shoulder", "scapula"), ("Arm", "shoulder"), ("ForeArm", "elbow"), ("Hand", "wrist"), ("UpLeg", "hip"), ("Leg", "knee"), ("Foot", "ankle"))
SEGMENT_JOINTS = {"Hips": "pelvis", "Spine": "spine", "Neck": "neck", "Head": "head"}
SEGMENT_JOINTS |= {f"{s.capitalize()}{segment}": f"{s}_{joint}" for s in ("left", "right") for segment, joint in SIDED}
UNITY_CHAINS = (
    "Hips Spine Neck Head",
    *(f"Spine {s}Shoulder {s}UpperArm {s}LowerArm {s}Hand" for s in ("Left", "Right")),
    *(f"Hips {s}UpperLeg {s}LowerLeg {s}Foot {s}Toes" for s in ("Left", "Right")),
)
UNITY_PARENTS = {child: parent for chain in map(str.split, UNITY_CHAINS) for parent, child in zip(chain, chain[1:])}
UNITY_SEGMENTS = {"UpperArm": "Arm", "LowerArm": "ForeArm", "UpperLeg": "UpLeg", "LowerLeg": "Leg"}


class Truth:
    def __init__(self, path):
        read = json.load(open(path))
        self.start_s, self.rate_hz, self.names, self.angle_names = read["start_s"], read["rate_hz"], read["joints"], read["angles"]
        self.joints_m = np.array([[person["joints_m"] for person in tick] for tick in read["ticks"]])
        self.angles = [[dict(zip(self.angle_names, person["angles"])) for person in tick] for tick in read["ticks"]]
        self.people = self.joints_m.shape[1]
        self.cameras = read["cameras"]
        self.rotations = {}

    def at(self, tick):
        """Joints of all persons, metres."""
        return self.joints_m[tick % len(self.joints_m)]

    def joint(self, tick, person, name):
        return self.at(tick)[person][self.names.index(name)]

    def local(self, tick, person):
        """Rotations of the bones relative to their parents and the T-pose, by their first joints."""
        key = (tick % len(self.joints_m), person)
        if key not in self.rotations:
            self.rotations[key] = local_rotations(self.angles[key[0]][person])
        return self.rotations[key]


class Received:
    """Arrival of each tick, and its content."""

    def __init__(self, truth):
        self.truth, self.ticks, self.delays_ms, self.kept = truth, [], [], []

    def take(self, tick, content=None):
        self.ticks.append(tick)
        self.delays_ms.append(1000 * (time.time() - self.truth.start_s - tick / self.truth.rate_hz))
        # Every seventh is compared, afterwards: a client's own parser may be slow.
        if content is not None and tick % 7 == 0:
            self.kept.append((tick, content))

    def line(self, name, worst):
        ticks = sorted(set(self.ticks))
        span = ticks[-1] - ticks[0] + 1 if ticks else 0
        lost = span - len(ticks)
        p50, p99 = np.percentile(self.delays_ms, [50, 99]) if self.delays_ms else (np.nan, np.nan)
        rate = len(ticks) * self.truth.rate_hz / span if span else 0.0
        print(f"| {name} | {len(self.ticks)} | {rate:.1f} | {lost} | {p50:.2f} | {p99:.2f} |", flush=True)
        worst.bounds |= {f"{name}: share of ticks lost": 0.25, f"{name}: nothing received": 0}
        worst.take(f"{name}: share of ticks lost", lost / span if span else 1.0)
        worst.take(f"{name}: nothing received", 0 if len(ticks) > 30 else 1)


def rotation(x, y, z, w):
    """Of a unit quaternion; the formula is the same in left-handed axes."""
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def about(axis, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    r = np.eye(3)
    r[i, i] = r[j, j] = c
    r[i, j], r[j, i] = -s, s
    return r


def compare(worst, bound, name, value):
    what = f"{name} {bound}"
    worst.bounds[what] = BOUNDS[bound]
    worst.take(what, value)


def segments_of(xml):
    """Names and parents of the segments of each skeleton, by id, from the parameters."""

    def walk(element, parent, into):
        for segment in element.findall("Segment"):
            into[int(segment.get("ID"))] = (segment.get("Name"), parent)
            walk(segment, int(segment.get("ID")), into)

    skeletons = []
    for skeleton in tree.fromstring(xml).iter("Skeleton"):
        skeletons.append({})
        walk(skeleton.find("Segments"), None, skeletons[-1])
    return skeletons


def qtm(truth, seconds, worst):
    """qtm-rt: labelled markers, angles of bodies, and skeletons both ways."""
    import qtm_rt

    async def receive(components, count):
        connection = await qtm_rt.connect(HOST, version="1.25")
        xml = await connection.get_parameters(["general", "3d", "6d", "skeleton"])
        received = Received(truth)
        await connection.stream_frames(components=components, on_packet=lambda packet: received.take(packet.framenumber, packet))
        await asyncio.sleep(count)
        await connection.stream_frames_stop()
        connection.disconnect()
        return xml, received

    xml, received = asyncio.run(receive(["3d", "6deuler", "skeleton"], seconds))
    received.line("QTM, qtm-rt 3D 6DEuler Skeleton", worst)
    skeletons = segments_of(xml)
    labels = [name.text for name in tree.fromstring(xml).findall("The_3D/Label/Name")]
    expected = [joint for _ in range(truth.people) for joint in truth.names]
    worst.bounds["QTM labels that are not the joints"] = 0
    worst.take("QTM labels that are not the joints", sum(not label.endswith(joint) for label, joint in zip(labels, expected)) + abs(len(labels) - len(expected)))
    for tick, packet in received.kept:
        markers = np.array(packet.get_3d_markers()[1]).reshape(truth.people, -1, 3)
        compare(worst, "mm", "QTM 3D", np.abs(markers - 1000 * truth.at(tick)).max())
        for person, (at, euler) in enumerate(packet.get_6d_euler()[1]):
            turned = about("x", euler.a1) @ about("y", euler.a2) @ about("z", euler.a3)
            compare(worst, "mm", "QTM 6DEuler", np.abs(np.array(at) - 1000 * truth.joint(tick, person, "pelvis")).max())
            compare(worst, "deg", "QTM 6DEuler", angle_between_deg(turned, truth.local(tick, person)["pelvis"]))
        for person, skeleton in enumerate(packet.get_skeletons()[1]):
            world = {}
            for number, at, turn in skeleton:
                name, parent = skeletons[person][number]
                local = rotation(turn.x, turn.y, turn.z, turn.w)
                above, origin = world[parent] if parent else (np.eye(3), np.zeros(3))
                world[number] = (above @ local, origin + above @ np.array(at))
                joint = SEGMENT_JOINTS.get(name)
                if joint:
                    compare(worst, "FK mm", "QTM Skeleton", np.linalg.norm(world[number][1] - 1000 * truth.joint(tick, person, joint)))
                    if joint in truth.local(tick, person):
                        compare(worst, "deg", "QTM Skeleton", angle_between_deg(local, truth.local(tick, person)[joint]))
    _, received = asyncio.run(receive(["skeleton:global"], seconds))
    received.line("QTM, qtm-rt Skeleton:global", worst)
    for tick, packet in received.kept:
        for person, skeleton in enumerate(packet.get_skeletons()[1]):
            for number, at, _ in skeleton:
                joint = SEGMENT_JOINTS.get(skeletons[person][number][0])
                if joint:
                    compare(worst, "mm", "QTM Skeleton:global", np.abs(np.array(at) - 1000 * truth.joint(tick, person, joint)).max())


def motioncapture(truth, seconds, worst):
    """libmotioncapture with Qualisys' C++ library: bodies, one frame per request, without the tick."""
    import motioncapture

    connection = motioncapture.connect("qualisys", {"hostname": HOST})
    path = truth.joints_m[:, :, truth.names.index("pelvis")]
    end, frames = time.time() + min(seconds, 3), 0
    while time.time() < end:
        connection.waitForNextFrame()
        for name, body in connection.rigidBodies.items():
            if not name.startswith("person_"):
                continue
            person = int(name.removeprefix("person_")) - 1
            tick = int(np.argmin(np.linalg.norm(path[:, person] - body.position, axis=1)))
            turned = rotation(body.rotation.x, body.rotation.y, body.rotation.z, body.rotation.w)
            compare(worst, "mm", "QTM, motioncapture 6DEuler", 1000 * np.abs(path[tick, person] - body.position).max())
            compare(worst, "deg", "QTM, motioncapture 6DEuler", angle_between_deg(turned, truth.local(tick, person)["pelvis"]))
        frames += 1
    print(f"| QTM, motioncapture 6DEuler | {frames} | asked for | - | - | - |", flush=True)


NODE = """
const api = new (require('qualisys-rt').Api)();
api.on('frame', frame => console.log(JSON.stringify([Date.now() / 1000, frame.frame, frame.components['3d'].markers.map(m => [m.x, m.y, m.z])])));
api.connect(22223, '127.0.0.1').then(() => api.getParameters('3D')).then(() => api.streamFrames(OPTIONS))
  .then(() => setTimeout(() => process.exit(), SECONDS * 1000));
"""


def node(truth, seconds, worst, modules):
    """npm's qualisys-rt, version 1.19 of the protocol, over TCP and UDP."""
    if not modules or not shutil.which("node"):
        print("left out: npm's qualisys-rt, no --node-modules or no Node")
        return
    for transport, more in (("TCP", ""), ("UDP", ", udpPort: 45454")):
        script = NODE.replace("SECONDS", str(seconds)).replace("OPTIONS", "{frequency: 'AllFrames', components: ['3D']" + more + "}")
        ran = subprocess.run(["node", "-e", script], env={**os.environ, "NODE_PATH": modules}, capture_output=True, text=True, timeout=seconds + 20)
        received = Received(truth)
        for line in ran.stdout.splitlines():
            arrived, tick, markers = json.loads(line)
            received.ticks.append(tick)
            received.delays_ms.append(1000 * (arrived - truth.start_s - tick / truth.rate_hz))
            found = np.array(markers).reshape(truth.people, -1, 3)
            compare(worst, "mm", f"QTM, qualisys-rt 3D {transport}", np.abs(found - 1000 * truth.at(tick)).max())
        received.line(f"QTM, qualisys-rt 3D {transport}", worst)


def websocket(truth, seconds, worst):
    import websockets

    async def receive():
        received, end = Received(truth), time.time() + seconds
        async with websockets.connect(f"ws://{HOST}:8765") as connection:
            while time.time() < end:
                message = json.loads(await connection.recv())
                received.take(message["tick"], message)
        return received

    async def a_page_of_another_machine():
        try:
            async with websockets.connect(f"ws://{HOST}:8765", origin="http://example.org"):
                return 1
        except websockets.exceptions.InvalidStatus as refused:
            return 0 if refused.response.status_code == 403 else 1

    received = asyncio.run(receive())
    received.line("WebSocket, websockets", worst)
    worst.bounds["WebSocket pages of other machines let in"] = 0
    worst.take("WebSocket pages of other machines let in", asyncio.run(a_page_of_another_machine()))
    for tick, message in received.kept:
        for person, pose in enumerate(message["persons"]):
            joints = np.array([pose["joints_m"][name] for name in truth.names])
            compare(worst, "mm", "WebSocket", 1000 * np.abs(joints - truth.at(tick)[person]).max())
            angles = truth.angles[tick % len(truth.angles)][person]
            compare(worst, "angle rad", "WebSocket", max(abs(pose["angles"][name] - angles[name]) for name in angles))


FOXGLOVE = """
const { FoxgloveClient } = require('@foxglove/ws-protocol'), { WebSocket } = require('ws');
const client = new FoxgloveClient({ ws: new WebSocket('ws://127.0.0.1:8766', [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
const topics = new Map();
client.on('error', error => { throw error; });
client.on('advertise', channels => channels.forEach(channel => topics.set(client.subscribe(channel.id), channel)));
client.on('message', event => {
  const channel = topics.get(event.subscriptionId);
  console.log(JSON.stringify([Date.now() / 1000, channel.topic, channel.schemaName, String(event.timestamp), Buffer.from(event.data.buffer, event.data.byteOffset, event.data.byteLength).toString('base64')]));
});
setTimeout(() => process.exit(), SECONDS * 1000);
"""


def foxglove(truth, seconds, worst, modules):
    """Foxglove's own client (npm), and one of Python over websockets; decoded by the classes that Foxglove publishes."""
    if modules and shutil.which("node"):
        script = FOXGLOVE.replace("SECONDS", str(seconds))
        ran = subprocess.run(["node", "-e", script], env={**os.environ, "NODE_PATH": modules}, capture_output=True, text=True, timeout=seconds + 20, check=True)
        messages = [(at, topic, schema, int(stamp), base64.b64decode(data)) for at, topic, schema, stamp, data in map(json.loads, ran.stdout.splitlines())]
        foxglove_messages("Foxglove, @foxglove/ws-protocol", truth, messages, worst)
    else:
        print("left out: npm's @foxglove/ws-protocol, no --node-modules or no Node")
    foxglove_messages("Foxglove, websockets", truth, asyncio.run(foxglove_by_hand(seconds)), worst)


async def foxglove_by_hand(seconds):
    import websockets

    messages, channels, end = [], {}, time.time() + seconds
    async with websockets.connect(f"ws://{HOST}:8766", subprotocols=["foxglove.sdk.v1"]) as connection:
        while time.time() < end:
            message = await connection.recv()
            if isinstance(message, str):
                advertised = json.loads(message)
                new = {channel["id"]: (channel["topic"], channel["schemaName"]) for channel in advertised.get("channels", [])}
                channels |= new
                if new:
                    # The client's number of a subscription is that of the channel.
                    await connection.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": id, "channelId": id} for id in new]}))
                continue
            kind, subscription, stamp = struct.unpack_from("<BIQ", message)
            assert kind == 1
            messages.append((time.time(), *channels[subscription], stamp, message[13:]))
    return messages


def foxglove_message(schema, data):
    import importlib

    name = schema.removeprefix("foxglove.")
    return getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name).FromString(data)


def foxglove_camera(client, truth, message, seen, worst):
    """Positions and lenses of the cameras."""
    places = dict(truth.cameras)
    for transform in getattr(message, "transforms", ()):
        name = transform.child_frame_id.removeprefix("camera_")
        t = transform.translation
        seen[f"{name} in space"] += 1
        compare(worst, "mm", client, 1000 * np.linalg.norm(np.array([t.x, t.y, t.z]) - places[name]))
    if hasattr(message, "K"):
        seen[message.frame_id.removeprefix("camera_")] += 1
        worst.bounds[f"{client}: cameras that see otherwise"] = 0
        worst.take(f"{client}: cameras that see otherwise", int((message.width, message.height, list(message.K)) != (1280, 720, [900, 0, 640, 0, 900, 360, 0, 0, 1])))


def foxglove_messages(client, truth, messages, worst):
    received, ticks = Received(truth), {}
    for arrived, topic, schema, stamp, data in messages:
        if topic == "/person_1/angles":
            tick = json.loads(data)["tick"]
            ticks[stamp] = tick
            received.ticks.append(tick)
            received.delays_ms.append(1000 * (arrived - truth.start_s - tick / truth.rate_hz))
    received.line(client, worst)
    topics = {topic for _, topic, *_ in messages}
    expected = {"/people", "/tf", *(f"/person_{i + 1}/angles" for i in range(truth.people))}
    worst.bounds[f"{client}: topics missing"] = 0
    worst.take(f"{client}: topics missing", len(expected - topics))
    # Checks without data cannot fail.
    seen = dict.fromkeys(["people", "frames", "angles", *(name for name, _ in truth.cameras), *(f"{name} in space" for name, _ in truth.cameras)], 0)
    for _, topic, schema, stamp, data in messages:
        if "camera" in topic or topic == "/tf_static":
            foxglove_camera(client, truth, foxglove_message(schema, data), seen, worst)
            continue
        tick = ticks.get(stamp)
        if tick is None or tick % 7:
            continue
        if topic.endswith("/angles"):
            person = int(topic.split("_")[1].split("/")[0]) - 1
            angles = truth.angles[tick % len(truth.angles)][person]
            seen["angles"] += 1
            for name, value in json.loads(data)["angles_deg"].items():
                compare(worst, "deg", client, abs(np.degrees(np.angle(np.exp(1j * (np.radians(value) - angles[name]))))))
            continue
        message = foxglove_message(schema, data)
        for entity in getattr(message, "entities", ()):
            seen["people"] += 1
            joints = np.array([[p.x, p.y, p.z] for p in entity.lines[0].points])
            compare(worst, "mm", client, 1000 * np.abs(joints - truth.at(tick)[int(entity.id.split("_")[1]) - 1]).max())
        for transform in getattr(message, "transforms", ()):
            seen["frames"] += 1
            person, t, q = int(transform.child_frame_id.split("_")[1]) - 1, transform.translation, transform.rotation
            compare(worst, "mm", client, 1000 * np.linalg.norm(np.array([t.x, t.y, t.z]) - truth.joint(tick, person, "pelvis")))
            compare(worst, "deg", client, angle_between_deg(rotation(q.x, q.y, q.z, q.w), truth.local(tick, person)["pelvis"]))
    worst.bounds[f"{client}: kinds of messages that never came"] = 0
    worst.take(f"{client}: kinds of messages that never came", sum(n == 0 for n in seen.values()))


def zenoh(truth, seconds, worst):
    """eclipse-zenoh, a client of the stream's peer; and a stranger whose messages no client may receive."""
    import zenoh as library

    received, config = Received(truth), library.Config()
    for key, value in {"mode": '"client"', "connect/endpoints": f'["tcp/{HOST}:7448"]', "scouting/multicast/enabled": "false"}.items():
        config.insert_json5(key, value)
    others, single = [], Received(truth)
    deleted, named, wrong = [], set(), []

    def take_one(sample):
        key = str(sample.key_expr)
        if sample.kind == library.SampleKind.DELETE:
            deleted.append(key)
            return
        message = json.loads(sample.payload.to_bytes())
        person = message["person"]
        if key == "farfield/synthetic/person/1":
            single.take(message["tick"], message)
        elif key.startswith("farfield/synthetic/name/"):
            named.add((key, person["name"]))
        wrong.append(message["format"] != "farfield-pose" or ("/person/" in key and key.rsplit("/", 1)[1] != str(person["id"])))

    def take(sample):
        others.append(str(sample.key_expr) != "farfield/synthetic/poses" or str(sample.encoding) != "application/json")
        if not others[-1]:
            message = json.loads(sample.payload.to_bytes())
            received.take(message["tick"], message)

    with library.open(config) as session, library.open(config) as stranger:
        session.declare_subscriber("farfield/*/poses", take)
        session.declare_subscriber("farfield/synthetic/person/*", take_one)
        session.declare_subscriber("farfield/synthetic/name/*", take_one)
        time.sleep(seconds / 2)
        for key in ["farfield/synthetic/poses", "farfield/stranger/poses"]:
            stranger.put(key, "{}")
        time.sleep(seconds / 2)
    received.line("Zenoh, eclipse-zenoh", worst)
    single.line("Zenoh, eclipse-zenoh, one person", worst)
    for tick, message in single.kept:
        joints = np.array([message["person"]["joints_m"][name] for name in truth.names])
        compare(worst, "mm", "Zenoh, one person", 1000 * np.abs(joints - truth.at(tick)[0]).max())
    worst.bounds |= {"Zenoh, one person: wrong keys": 0, "Zenoh, one person: deleted while there": 0}
    worst.take("Zenoh, one person: wrong keys", sum(wrong) + (len(named) != 1))
    worst.take("Zenoh, one person: deleted while there", len(deleted))
    worst.bounds["Zenoh: samples of another key or encoding"] = 0
    worst.take("Zenoh: samples of another key or encoding", sum(others))
    for tick, message in received.kept:
        for person, pose in enumerate(message["persons"]):
            joints = np.array([pose["joints_m"][name] for name in truth.names])
            compare(worst, "mm", "Zenoh", 1000 * np.abs(joints - truth.at(tick)[person]).max())


def ros2(truth, seconds, worst):
    """A router of eclipse-zenoh instead of rmw_zenohd; messages decoded by rosbags."""
    import zenoh as library
    from rosbags.typesys import Stores, get_typestore

    types, samples, tokens, config = get_typestore(Stores.ROS2_JAZZY), [], set(), library.Config()
    for key, value in {"mode": '"router"', "listen/endpoints": f'["tcp/{HOST}:7447"]', "scouting/multicast/enabled": "false"}.items():
        config.insert_json5(key, value)
    received = Received(truth)
    with library.open(config) as session:
        session.liveliness().declare_subscriber("@ros2_lv/**", lambda sample: tokens.add(str(sample.key_expr)), history=True)
        session.declare_subscriber("0/**", lambda sample: samples.append((time.time(), str(sample.key_expr), sample.attachment.to_bytes(), sample.payload.to_bytes())))
        # The stream searches for its router every two seconds.
        time.sleep(seconds + 3)
    wanted = {
        f"0/{topic}/{package}::msg::dds_::{kind}_/{types.hash_rihs01(f'{package}/msg/{kind}')}": f"{package}/msg/{kind}"
        for topic, package, kind in (("tf", "tf2_msgs", "TFMessage"), ("farfield/markers", "visualization_msgs", "MarkerArray"))
    }
    sequences = {}
    for arrived, key, attachment, payload in samples:
        sequence, stamp_ns, length = struct.unpack_from("<qqB", attachment)
        worst.take("ROS 2: attachments that are wrong", int(len(attachment) != 33 or length != 16 or abs(stamp_ns * 1e-9 - arrived) > 5))
        if key not in wanted:
            worst.take("ROS 2: samples of another key", int(not key.endswith("/TypeHashNotSupported")))
            continue
        worst.take("ROS 2: sequences that go back", int(sequence <= sequences.get(key, 0)))
        sequences[key] = sequence
        if not key.startswith("0/tf/"):
            continue
        message = types.deserialize_cdr(payload, wanted[key])
        # It has no tick: the tick is found by the pelvis of the first person, whose path is known.
        at = message.transforms[0].transform.translation
        path = truth.joints_m[:, 0, truth.names.index("pelvis")]
        tick = int(np.argmin(np.linalg.norm(path - [at.x, at.y, at.z], axis=1)))
        compare(worst, "mm", "ROS 2 transforms", 1000 * np.linalg.norm(path[tick] - [at.x, at.y, at.z]))
        worst.take("ROS 2: bones missing", abs(len(message.transforms) - 20 * truth.people))
        now = (arrived - truth.start_s) * truth.rate_hz
        ahead = round((now - tick) / len(truth.joints_m)) * len(truth.joints_m)
        received.ticks.append(tick + ahead)
        received.delays_ms.append(1000 * (now - tick - ahead) / truth.rate_hz)
    received.line("ROS 2 by Zenoh, eclipse-zenoh and rosbags", worst)
    expected = {"NN": 1, "MP": 2}
    found = {kind: sum(f"/{kind}/" in token for token in tokens) for kind in expected}
    worst.take("ROS 2: topics that the graph lacks", sum(not any(key.split("/", 1)[1].replace("/", "%", key.count("/") - 3) in token for token in tokens) for key in wanted) + int(found != expected))
    worst.take("ROS 2: topics without messages", len(wanted) - len(sequences))
    worst.bounds |= dict.fromkeys((f"ROS 2: {what}" for what in ("attachments that are wrong", "samples of another key", "sequences that go back", "bones missing", "topics that the graph lacks", "topics without messages")), 0)


def vmc(truth, seconds, worst):
    """python-osc: a port per person."""
    from pythonosc.dispatcher import Dispatcher
    from pythonosc.osc_server import AsyncIOOSCUDPServer

    streams = [Received(truth) for _ in range(truth.people)]

    def handler(received):
        state = {"tick": None, "root": None, "bones": {}}

        def handle(address, *values):
            if address == "/VMC/Ext/T":
                state.update(tick=round(values[0] * truth.rate_hz), bones={})
            elif address == "/VMC/Ext/Root/Pos":
                state["root"] = values[1:]
            elif address == "/VMC/Ext/Bone/Pos":
                state["bones"][values[0]] = values[1:]
                if len(state["bones"]) == 20 and state["tick"] is not None:
                    received.take(state["tick"], (state["root"], state["bones"]))

        return handle

    async def receive():
        transports = []
        for i, received in enumerate(streams):
            dispatcher = Dispatcher()
            dispatcher.set_default_handler(handler(received))
            server = AsyncIOOSCUDPServer((HOST, 39539 + i), dispatcher, asyncio.get_running_loop())
            transports.append((await server.create_serve_endpoint())[0])
        await asyncio.sleep(seconds)
        for transport in transports:
            transport.close()

    asyncio.run(receive())
    for person, received in enumerate(streams):
        if person in (0, truth.people - 1):
            received.line(f"VMC, python-osc, port {39539 + person}", worst)
        for tick, (root, bones) in received.kept:
            vmc_person(truth, tick, person, root, bones, worst)


def vmc_person(truth, tick, person, root, bones, worst):
    world = {None: (rotation(*root[3:7]), np.array(root[:3]))}
    for bone, numbers in bones.items():
        local = rotation(*numbers[3:])
        above, origin = world[UNITY_PARENTS.get(bone)]
        world[bone] = (above @ local, origin + above @ np.array(numbers[:3]))
        segment = bone
        for unity, name in UNITY_SEGMENTS.items():
            segment = segment.replace(unity, name)
        joint = SEGMENT_JOINTS.get(segment)
        if joint:
            expected = UNITY @ truth.joint(tick, person, joint)
            compare(worst, "FK mm", "VMC", 1000 * np.linalg.norm(world[bone][1] - expected))
            if joint in truth.local(tick, person):
                turned = UNITY @ truth.local(tick, person)[joint] @ UNITY.T
                compare(worst, "deg", "VMC", angle_between_deg(local, turned))


def psn(truth, seconds, worst):
    """pypsn, by multicast on the loopback."""
    import pypsn

    received, names = Received(truth), {}

    def handle(packet):
        if isinstance(packet, pypsn.psn_data_packet):
            received.take(round(packet.info.timestamp * 1e-6 * truth.rate_hz), packet)
        elif isinstance(packet, pypsn.psn_info_packet):
            names.update({tracker.tracker_id: tracker.tracker_name.decode() for tracker in packet.trackers})

    receiver = pypsn.receiver(handle, ip_addr=HOST, timeout=None)
    receiver.daemon = True
    receiver.start()
    time.sleep(seconds)
    receiver.running = False
    receiver.join(2)
    received.line("PosiStageNet, pypsn", worst)
    worst.bounds["PosiStageNet names missing"] = 0
    worst.take("PosiStageNet names missing", truth.people - len(names))
    pelvis, came = truth.names.index("pelvis"), set(received.ticks)
    for tick, packet in received.kept:
        for tracker in packet.trackers:
            at = UNITY @ truth.at(tick)[tracker.id - 1][pelvis]
            compare(worst, "mm", "PosiStageNet", 1000 * np.abs(np.array(list(tracker.pos)) - at).max())
            if not set(range(tick - 6, tick)) <= came:
                continue  # Over a gap it is measured in another way.
            before = UNITY @ truth.at(tick - 6)[tracker.id - 1][pelvis]
            speed = (at - before) * truth.rate_hz / 6
            compare(worst, "m/s", "PosiStageNet", np.abs(np.array(list(tracker.speed)) - speed).max())


def lsl(truth, seconds, worst):
    """pylsl with its own liblsl: found by its properties, received with stamps; and by an inlet that knows the first version only."""
    import pylsl

    found = pylsl.resolve_bypred("type='MoCap' and starts-with(name, 'farfield-')", timeout=5)
    worst.bounds |= {"LSL streams that were not found": 0, "LSL streams found by what they are not": 0}
    worst.take("LSL streams that were not found", abs(len(found) - 1))
    worst.take("LSL streams found by what they are not", len(pylsl.resolve_bypred("type='EEG' and starts-with(name, 'farfield-')", timeout=1)))
    inlet = pylsl.StreamInlet(found[0], max_buflen=1)
    info = inlet.info(5)
    channel, labels, kinds = info.desc().child("channels").child("channel"), [], []
    while not channel.empty():
        labels.append(channel.child_value("label"))
        kinds.append((channel.child_value("type"), channel.child_value("unit")))
        channel = channel.next_sibling()
    expected = ["tick"]
    for place in range(1, 9):
        expected += [f"p{place}_id", f"p{place}_seen"] + [f"p{place}_{joint}_{axis}" for joint in truth.names for axis in "xyz"]
    worst.bounds |= {"LSL channels that are not the joints": 0, "LSL channels without metres": 0, "LSL rate": 0}
    worst.take("LSL channels that are not the joints", sum(a != b for a, b in zip(labels, expected)) + abs(len(labels) - len(expected)))
    worst.take("LSL channels without metres", sum(kind != (f"Position{label[-1].upper()}", "meters") for label, kind in zip(labels, kinds) if label[-2:] in ("_x", "_y", "_z")))
    worst.take("LSL rate", abs(info.nominal_srate() - truth.rate_hz))
    inlet.open_stream(5)
    received, stamps, end = Received(truth), [], time.time() + seconds
    while time.time() < end:
        sample, stamp = inlet.pull_sample(2)
        # Samples of skipped ticks have no people: they count as lost.
        if sample and sample[1] >= 0:
            received.take(int(sample[0]), sample)
            stamps.append((int(sample[0]), stamp))
    # The outlet's clock, by its time packets, against this one.
    began_s = truth.start_s - (time.time() - pylsl.local_clock())
    off_s = [stamp + inlet.time_correction(5) - began_s - tick / truth.rate_hz for tick, stamp in stamps]
    received.line("LSL, pylsl", worst)
    worst.bounds |= {"LSL stamps off s": 0.25, "LSL stamps that are uneven s": 0.02}
    worst.take("LSL stamps off s", np.abs(off_s).max())
    # Stamps are never ahead of their clock: the first frames may shift them to the least late one.
    worst.take("LSL stamps that are uneven s", np.ptp([stamp - tick / truth.rate_hz for tick, stamp in stamps]))
    for _, sample in received.kept:
        lsl_sample(truth, sample, worst)
    inlet.close_stream()
    # liblsl reads its configuration when it is loaded.
    with tempfile.NamedTemporaryFile("w", suffix=".cfg") as config:
        config.write("[tuning]\nUseProtocolVersion = 100\n")
        config.flush()
        ran = subprocess.run([sys.executable, "-c", LSL_OLD], env={**os.environ, "LSLAPICFG": config.name}, capture_output=True, text=True, timeout=60, check=True)
    samples = [json.loads(line) for line in ran.stdout.splitlines() if line.startswith("[")]
    worst.bounds["LSL samples missing in version 1.00"] = 0
    worst.take("LSL samples missing in version 1.00", 20 - len(samples))
    for sample in samples:
        lsl_sample(truth, sample, worst)


LSL_OLD = """
import json, pylsl
assert pylsl.protocol_version() == 100
inlet = pylsl.StreamInlet(pylsl.resolve_bypred("starts-with(name, 'farfield-')", timeout=5)[0], max_buflen=1)
for _ in range(20):
    print(json.dumps(inlet.pull_sample(5)[0]))
"""


def lsl_sample(truth, sample, worst):
    expected = truth.at(int(sample[0]))
    blocks = np.array(sample[1:]).reshape(8, -1)
    worst.bounds["LSL places that are wrong"] = 0
    there = min(truth.people, 8)
    ids = [*range(1, there + 1), *[0] * (8 - there)]
    worst.take("LSL places that are wrong", int((blocks[:, 0] != ids).sum() + (blocks[:, 1] != (np.array(ids) > 0)).sum()))
    joints = blocks[:there, 2:].reshape(there, -1, 3)
    compare(worst, "mm", "LSL", 1000 * np.abs(joints - expected[:there]).max())
    worst.take("LSL places that are wrong", int(np.isfinite(blocks[there:, 2:]).sum()))


def hanging_clients():
    """Two clients that subscribe to everything and read nothing."""
    def connect(port):
        client = socket.socket()
        client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        client.connect((HOST, port))
        return client

    first, second = connect(22223), connect(8765)
    command = b"StreamFrames AllFrames 3D 6D Skeleton\0"
    first.sendall(struct.pack("<II", 8 + len(command), 1) + command)
    key = "dGhlIHNhbXBsZSBub25jZQ=="
    second.sendall(f"GET / HTTP/1.1\r\nHost: {HOST}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
    return first, second


def was_left(client):
    """Whether the stream has closed the connection: first the data sent before, then the end."""
    client.settimeout(3)
    end = time.time() + 3
    try:
        while client.recv(65536):
            if time.time() > end:
                return False
    except TimeoutError:
        return False
    except ConnectionError:
        pass
    return True


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("truth")
    parser.add_argument("--seconds", type=float, default=5)
    parser.add_argument("--only", default="qtm,motioncapture,node,websocket,foxglove,zenoh,ros2,vmc,psn,lsl")
    parser.add_argument("--node-modules")
    given = parser.parse_args()
    truth, worst = Truth(given.truth), Worst({})
    clients = hanging_clients()
    began = time.time()
    print("| client | frames | ticks/s | lost | P50 ms | P99 ms |\n| --- | --- | --- | --- | --- | --- |")
    for name in given.only.split(","):
        more = (given.node_modules,) if name in ("node", "foxglove") else ()
        known = {"qtm": qtm, "motioncapture": motioncapture, "node": node, "websocket": websocket, "foxglove": foxglove, "zenoh": zenoh, "ros2": ros2, "vmc": vmc, "psn": psn, "lsl": lsl}
        known[name](truth, given.seconds, worst, *more)
    # Some seconds until the system's buffers are full, then ten.
    time.sleep(max(0.0, 25 - (time.time() - began)))
    worst.bounds["clients that hang and were not left"] = 0
    worst.take("clients that hang and were not left", sum(not was_left(client) for client in clients))
    failed = worst.failures()
    if failed:
        sys.exit("not kept: " + ", ".join(failed))


if __name__ == "__main__":
    main()
