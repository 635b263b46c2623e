"""Reads the messages of the nodes with docs/protocol.md only: its golden bytes, and a whole recording.

    pip install numpy blake3
    python tests/readers/protocol.py RUN
    python tests/readers/protocol.py page            # updates the page's examples after a new version

RUN is the folder of a recorded run in lock-step (`farfield demo --maps --record`). Exits with 1 if

- a golden file of any version is not read to its last byte, or not written again identically, or a patch gives other maps;
- a message that exceeds a bound is read;
- an example of the page is not a golden file, or is not read as the page describes it;
- a message of the recording is not read, or its poses are not those of poses.jsonl, or a decision names a missing set.
"""

import collections
import json
import math
import pathlib
import re
import sys

import blake3

import patch_codec
import wire
from mcap_file import Recording

ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGE, GOLDEN = ROOT / "docs/protocol.md", ROOT / "proto/golden"
# Half of the last decimal of poses.jsonl, plus single precision; angles are rounded inward.
POSITION, SIGMA, ANGLE = 0.6e-5, 0.6e-4, 1.1e-6
EVERY_NTH_PATCH = 60
EXAMPLE = re.compile(r"```text (\w+)\.hex\n(.*?)```", re.DOTALL)
SUBSCRIBER = re.compile(r"(?<=```python\n)\"\"\"Prints where .*?(?=```)", re.DOTALL)


def explained(name, data):
    """A message in the form of the page: its bytes in order with their meaning."""
    lines = []

    def seen(at, end, path, kind, value):
        shown = value.hex(" ") if isinstance(value, bytes) else json.dumps(value) if isinstance(value, str) and kind == "text" else value
        lines.append((data[at:end].hex(" "), path or "", kind, shown))

    wire.decode(name, data, seen)
    return [f"{bytes_:24} {path + ': ' if path else ''}{kind} {value}".rstrip() for bytes_, path, kind, value in lines]


def check_golden():
    for version in wire.VERSIONS:
        folder = GOLDEN / f"v{version}"
        files = sorted(folder.glob("*.hex"))
        assert {file.stem for file in files} == set(wire.MESSAGES), f"{folder}: other messages than this knows"
        for file in files:
            data = bytes.fromhex(file.read_text())
            again = wire.encode(file.stem, wire.decode(file.stem, data), version)
            assert again == data, f"{file}: written again it is {again.hex()}"
            for end in range(len(data)):
                try:
                    wire.decode(file.stem, data[:end])
                except (ValueError, UnicodeDecodeError):
                    continue
                raise AssertionError(f"{file}: its first {end} bytes are read as a whole message")
        for level in range(7):
            file = folder / f"patch_level_{level}.txt"
            data, expected = file.read_text().split()
            maps, found = patch_codec.decode(bytes.fromhex(data), 48, 64, 4)
            digest = blake3.blake3(maps.astype("u1").tobytes()).hexdigest()
            assert (digest, found) == (expected, level), f"{file}: other maps"
    print(f"golden files of versions {list(wire.VERSIONS)}: {len(wire.MESSAGES)} messages and 7 patches each are read, and the messages written again")


def check_refused():
    """Messages of the golden files, each with one fault: they are written, but must not be read again."""
    def opened(name, *places):
        """The message, and the part of it at the end of `places`."""
        message = part = wire.decode(name, bytes.fromhex((GOLDEN / f"v{wire.VERSIONS.stop - 1}/{name}.hex").read_text()))
        for place in places:
            part = part[place]
        return message, part

    wrong = [
        ("pose_set", ("persons", 0, "joints_m", 0), 1, math.nan), ("pose_set", ("persons", 0, "angles"), 0, math.inf),
        ("pose_set", ("persons", 0), "sigma_m", [0.5] * 65), ("sighting_set", ("sightings", 0, 1), "score", -math.inf),
        ("decision", ("horizons_ticks",), 0, math.nan), ("decision", (), "horizons_ticks", [1.0] * 257),
        ("status", ("agreement", 0, "agreement"), "late_ticks", math.nan), ("status", (), "node", "n" * 65),
        ("status", (), "failure", "f" * 8193), ("status", ("health",), "notices", ["n"] * 17), ("status", ("health",), "notices", ["n" * 513]),
        ("box_set", (), "detection_cameras", list(range(65))), ("chunk", (), "bytes", bytes(65_537)),
        ("thumbnail", (), "jpeg", bytes(24_577)), ("signed_list", (), "list", bytes(wire.MOST_BYTES)), ("filled", (), "stored", [{"kind": "patches", "bytes": b""}] * 4097),
    ]
    for name, places, field, value in wrong:
        message, part = opened(name, *places)
        part[field] = value
        try:
            wire.decode(name, wire.encode(name, message, wire.VERSIONS.stop - 1))
        except ValueError:
            continue
        raise AssertionError(f"{name}: {field} is read as {str(value)[:40]}")
    for data in (b"", b"\0\0", b"\3\0", b"\2\1\0\0\0"):
        try:
            wire.decode("chunk", data)
        except ValueError:
            continue
        raise AssertionError(f"a chunk is read from {data.hex(' ')}")
    print(f"{len(wrong) + 4} messages that break a bound are refused")


def page_as_it_should_be():
    """The page with the newest version's golden files as examples, cut as before; and their names."""
    names = []

    def example(found):
        name, shown = found[1], found[2].splitlines()
        names.append(name)
        lines = explained(name, bytes.fromhex((GOLDEN / f"v{wire.VERSIONS.stop - 1}/{name}.hex").read_text()))
        if shown[-1] == "...":
            lines = lines[: len(shown) - 1] + ["..."]
        return "```text {}.hex\n{}\n```".format(name, "\n".join(lines))

    text = EXAMPLE.sub(example, PAGE.read_text())
    return SUBSCRIBER.sub(lambda _: (ROOT / "examples/subscriber.py").read_text(), text), names


def check_page():
    expected, names = page_as_it_should_be()
    for shown, right in zip(PAGE.read_text().splitlines(), expected.splitlines()):
        assert shown == right, f"docs/protocol.md: {shown!r} should be {right!r}"
    assert PAGE.read_text() == expected, "docs/protocol.md is cut off"
    assert set(names) == set(wire.MESSAGES) - {"handout_request_list"}, "docs/protocol.md shows other messages"
    assert SUBSCRIBER.search(expected), "docs/protocol.md does not show examples/subscriber.py"
    print(f"docs/protocol.md: {len(names)} examples are the golden files, and the subscriber is the one in examples/")


def check_pose(pose, line):
    """Whether a person of the wire is that line of poses.jsonl; numbers are in the line's order of names.

    The line leaves out keypoints that have no place on the body; the wire has the pelvis there."""
    near = lambda found, expected, most: len(found) == len(expected) and all(abs(f - e) <= most for f, e in zip(found, expected))
    near_points = lambda found, named: len(found) == len(named) and all(near(f, e, POSITION) for f, e in zip(found, named.values()))
    on_body = iter(pose["keypoints_m"])
    unobserved = [name for i, name in enumerate(line["angles"]) if pose["unobserved"] >> i & 1]
    return {
        "state": pose["state"] == line["state"],
        "joints": near_points(pose["joints_m"], line["joints"]),
        "keypoints": all(any(near(f, e, POSITION) for f in on_body) for e in line["keypoints"].values()),
        "sigma_m": near(pose["sigma_m"], list(line.get("sigma_m", {}).values()), SIGMA),
        "angles": near(pose["angles"], list(line["angles"].values()), ANGLE),
        "unobserved": unobserved == line["unobserved"],
        "views": pose["views"] == line["views"],
    }


def check_recording(run):
    recording = Recording((run / "recording.mcap").read_bytes())
    facts = recording.facts["farfield"]
    venue, viewpoints = facts["venue"], facts["viewpoints"].split()
    assert recording.profile == "farfield" and {"venue.toml", "calibration.toml"} <= set(recording.files)
    lines = [json.loads(line) for line in (run / "poses.jsonl").read_text().splitlines()]
    written = {(line["tick"], line["person"]): line for line in lines}
    counts, sets, used, compared, as_json = collections.Counter(), set(), [], 0, {}
    sequences, maps = collections.Counter(), collections.Counter()
    for topic, encoding, log, publish, sequence, data in recording.messages:
        assert topic.startswith(f"{venue}/"), topic
        assert sequence == sequences[topic], f"{topic}: message {sequence} where {sequences[topic]} should be"
        sequences[topic] += 1
        key = topic.split("/")[1:]
        if encoding == "json":
            if key == ["pose", "json"]:
                poses = json.loads(data)
                as_json[poses["tick"]] = poses["persons"]
            continue
        assert encoding == "farfield-wire" and data[0] == int(facts["wire"]), topic
        name = wire.BY_KEY[key[0] if key[0] != "fill" else key[2]]
        message = wire.decode(name, data)
        assert wire.encode(name, message, data[0]) == data, f"{topic}: written again it is something else"
        counts[name] += 1
        if name in ("patch_set", "sighting_set"):
            assert viewpoints[message["viewpoint"]] == key[1], topic
            sets.add((name, message["tick"], message["viewpoint"], message["part"]))
        for patch in message["persons"] if name == "patch_set" else ():
            counts["patch"] += 1
            if counts["patch"] % EVERY_NTH_PATCH == 0:
                size = patch["size"]
                sides = [int(n) for n in size.split("x")] if isinstance(size, str) else size[1].values()
                maps[patch_codec.decode(patch["maps"], *sides)[1]] += 1
        if name == "decision":
            used += [("patch_set", message["tick"], one["viewpoint"], one["part"]) for one in message["patches"]]
            used += [("sighting_set", message["tick"], one["viewpoint"], one["part"]) for one in message["sightings"]]
        for pose in message["persons"] if name == "pose_set" else ():
            same = check_pose(pose, written[message["tick"], pose["person"]])
            assert all(same.values()), f"tick {message['tick']}, person {pose['person']}: not the same: {[k for k, v in same.items() if not v]}"
            compared += 1
    missing = [one for one in used if one not in sets]
    assert used and not missing, f"sets that were used and are not there: {missing[:3]}"
    of_json = [written[tick, pose["person"]] == pose for tick, persons in as_json.items() for pose in persons]
    assert len(of_json) == compared and all(of_json), "the poses as JSON are not those of poses.jsonl"
    first = {}
    for tick, person in sorted(written):
        first.setdefault(person, tick)
    people = {person for _, person in written}
    assert compared and compared >= len(written) // 2 and maps, f"only {compared} poses and {sum(maps.values())} patches were compared"
    assert set(counts) >= {"patch_set", "sighting_set", "box_set", "pose_set", "decision", "identity_events", "status"}, counts
    print(f"recording: {dict(counts)} in {recording.chunks} chunks; {compared} poses of {len(people)} people are those of poses.jsonl "
          f"({len(written) - compared} lines are of before their confirmation); maps decoded, by level: {dict(maps)}; {len(used)} used sets are there")


if __name__ == "__main__":
    if sys.argv[1:] == ["page"]:
        PAGE.write_text(page_as_it_should_be()[0])
    elif len(sys.argv) != 2:
        sys.exit(__doc__)
    else:
        try:
            check_golden()
            check_refused()
            check_page()
            check_recording(pathlib.Path(sys.argv[1]))
        except (AssertionError, ValueError) as wrong:
            sys.exit(f"{type(wrong).__name__}: {wrong}")
