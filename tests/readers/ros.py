"""Decodes our ROS 2 messages with rosbags and compares them with their input.

    pip install rosbags numpy
    cargo run -p farfield-streams --example ros_messages > MESSAGES
    python tests/readers/ros.py MESSAGES

Joints must come out of the transforms within a micrometre; names and hashes of types must be those of Humble and Jazzy. Exits
with 1 if they do not.
"""

import json
import sys

import numpy as np
from rosbags.typesys import Stores, get_typestore

from expected import Worst
from streams import rotation


def check(sent, store, worst):
    types = get_typestore(store)
    for key, name in (("tf", "tf2_msgs/msg/TFMessage"), ("markers", "visualization_msgs/msg/MarkerArray")):
        wire, rihs = sent[f"{key}_type"]
        package, kind = name.split("/msg/")
        worst.take("types of another name or hash", int(wire != f"{package}::msg::dds_::{kind}_" or rihs != types.hash_rihs01(name)))
        message = types.deserialize_cdr(bytes.fromhex(sent[key]), name)
        worst.take("messages that are encoded otherwise", int(bytes(types.serialize_cdr(message, name)) != bytes.fromhex(sent[key])))
        (check_transforms if key == "tf" else check_markers)(sent, message, worst)


def check_transforms(sent, message, worst):
    world = {"map": (np.eye(3), np.zeros(3))}
    for transform in message.transforms:
        stamp, t, q = transform.header.stamp, transform.transform.translation, transform.transform.rotation
        worst.take("other stamps", int((stamp.sec, stamp.nanosec) != (sent["secs"], sent["nanos"])))
        above, origin = world[transform.header.frame_id]
        world[transform.child_frame_id] = (above @ rotation(q.x, q.y, q.z, q.w), origin + above @ np.array([t.x, t.y, t.z]))
        person, joint = transform.child_frame_id.removeprefix("person_").split("/")
        if joint in sent["joints"]:
            expected = sent["joints_m"][int(person) - 1][sent["joints"].index(joint)]
            worst.take("joints of transforms mm", 1000 * np.linalg.norm(world[transform.child_frame_id][1] - expected))


def check_markers(sent, message, worst):
    lines, names = message.markers[::2], message.markers[1::2]
    for person, (line, name) in enumerate(zip(lines, names, strict=True)):
        worst.take("names that differ", int(name.text != sent["names"][person]))
        ends = np.array([[p.x, p.y, p.z] for p in line.points])
        joints = np.array(sent["joints_m"][person])
        apart = np.linalg.norm(ends[:, None] - joints[None], axis=2).min(axis=1)
        worst.take("ends of lines mm", 1000 * apart.max())
        worst.take("lines missing", 2 * (len(joints) - 1) - len(ends))


def main():
    sent = json.load(open(sys.argv[1]))
    nothing = ("types of another name or hash", "messages that are encoded otherwise", "other stamps", "names that differ", "lines missing")
    worst = Worst({"joints of transforms mm": 1e-3, "ends of lines mm": 1e-3} | dict.fromkeys(nothing, 0))
    for store in (Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY):
        check(sent, store, worst)
    failed = worst.failures()
    if failed:
        sys.exit("not kept: " + ", ".join(failed))


if __name__ == "__main__":
    main()
