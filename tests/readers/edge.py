"""Edges in Python that play a recording: fusion makes the same poses from them as from the recorded edges, byte for byte.

    pip install eclipse-zenoh
    python tests/readers/edge.py FARFIELD RUN

FARFIELD is the program, RUN the folder of a recorded run in lock-step. Written from docs/protocol.md: statuses at the start,
boxes in, patches and sightings out. All data come from the recording, also venue and calibration. Exits with 1 if poses.jsonl
differs, if fusion or an edge fails, or after three minutes.
"""

import collections
import json
import pathlib
import queue
import subprocess
import sys
import tempfile
import threading
import time

import zenoh

import wire
from mcap_file import Recording
from subscriber import free_port

VERSION = wire.VERSIONS.stop - 1
PATIENCE_S = 180
QOS = {"congestion_control": zenoh.CongestionControl.BLOCK, "priority": zenoh.Priority.REAL_TIME, "express": True}


class PlayedEdge:
    """The edge of one viewpoint."""

    def __init__(self, session, facts, index, sets):
        self.name, self.index, self.sets, self.facts = facts["viewpoints"].split()[index], index, sets, facts
        venue = facts["venue"]
        declare = lambda kind: session.declare_publisher(f"{venue}/{kind}/{self.name}", reliability=zenoh.Reliability.RELIABLE, **QOS)
        self.publishers = {"patch_set": declare("patch"), "sighting_set": declare("sighting"), "status": declare("status")}
        self.messages = queue.SimpleQueue()
        self.subscriber = session.declare_subscriber(f"{venue}/box/{self.name}", lambda sample: self.messages.put(sample.payload.to_bytes()))
        self.token = session.liveliness().declare_token(f"{venue}/alive/{self.name}")
        self.tick, self.spoken, self.is_done = None, VERSION, False

    def hear(self, status):
        """A status of fusion: answers use the newest version that both support."""
        reads = status.attachment.to_bytes()[0] if status.attachment else status.payload.to_bytes()[0]
        self.spoken = min(VERSION, reads)

    def say_status(self):
        has_listeners = all(self.publishers[kind].matching_status.matching for kind in ("patch_set", "sighting_set"))
        status = {
            "node": self.name, "process": self.index + 1, "viewpoint": self.index, "release": "", "ready": has_listeners,
            "venue_hash": self.facts["venue_hash"], "calibration_hash": self.facts["calibration_hash"], "network_hash": "", "backend": "",
            "ticks": None, "tick": self.tick, "unreadable": 0, "failure": None, "stages": [], "live": None,
            "health": {"system_clock": None, "certificate_ends_s": None, "follows": None, "links": [], "notices": []},
            "agreement": [],
            "needed_nth_tick": 0,
        }
        self.publishers["status"].put(wire.encode("status", status, self.spoken), attachment=bytes([VERSION]))

    def run(self):
        """Sends ten statuses a second until the first boxes, then the sets of each requested tick."""
        while True:
            try:
                boxes = wire.decode("box_set", self.messages.get(timeout=0.1 if self.tick is None else 1.0))
            except queue.Empty:
                self.say_status()
                continue
            if boxes["order"] == "end":
                break
            # All parts of a set arrive; one answer is due.
            if boxes["part"] + 1 < boxes["parts"]:
                continue
            self.tick = boxes["tick"]
            for name, message in self.sets[self.tick]:
                message["session"] = boxes["session"]
                self.publishers[name].put(wire.encode(name, message, self.spoken))
        self.say_status()
        self.is_done = True


def sets_of(recording):
    """Per viewpoint and tick: the sets as they were sent."""
    found = collections.defaultdict(lambda: collections.defaultdict(list))
    for topic, _, _, _, _, data in recording.messages:
        name = wire.BY_KEY.get(topic.split("/")[1])
        if name in ("patch_set", "sighting_set"):
            message = wire.decode(name, data)
            found[message["viewpoint"]][message["tick"]].append((name, message))
    return found


def play(farfield, recording, folder):
    """The poses.jsonl that fusion makes from the recording."""
    facts = recording.facts["farfield"]
    for name, (_, data) in recording.files.items():
        (folder / name).write_bytes(data)
    sets = sets_of(recording)
    ticks = sorted(sets[0])
    endpoint, out = f"tcp/127.0.0.1:{free_port()}", folder / "run"
    fusion = subprocess.Popen(
        [farfield, "fusion", str(folder / "venue.toml"), "--listen", endpoint, "--ticks", f"{ticks[0]}..{ticks[-1] + 1}", "--out", str(out)],
        stdin=subprocess.PIPE,
    )
    config = zenoh.Config()
    for key, value in {"mode": "client", "connect/endpoints": [endpoint], "connect/timeout_ms": 20_000, "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    try:
        with zenoh.open(config) as session:
            edges = [PlayedEdge(session, facts, index, sets[index]) for index in range(len(facts["viewpoints"].split()))]
            hear = lambda status: [edge.hear(status) for edge in edges]
            statuses = session.declare_subscriber(f"{facts['venue']}/status/fusion", hear)
            threads = [threading.Thread(target=edge.run, daemon=True) for edge in edges]
            for thread in threads:
                thread.start()
            deadline = time.monotonic() + PATIENCE_S
            while any(thread.is_alive() for thread in threads) and not fusion.poll() and time.monotonic() < deadline:
                time.sleep(0.05)
            for edge in edges:
                edge.token.undeclare()
            statuses.undeclare()
            if unfinished := [edge.name for edge in edges if not edge.is_done]:
                sys.exit(f"fusion ended with {fusion.poll()} (None: it runs), these edges were not done: {unfinished}")
            if fusion.wait(60) != 0:
                sys.exit(f"fusion ended with {fusion.returncode}")
    finally:
        if fusion.poll() is None:
            fusion.kill()
    return (out / "poses.jsonl").read_bytes(), len(ticks)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    recorded_run = pathlib.Path(sys.argv[2])
    with tempfile.TemporaryDirectory() as scratch:
        poses, n_ticks = play(sys.argv[1], Recording((recorded_run / "recording.mcap").read_bytes()), pathlib.Path(scratch))
    is_same = poses == (recorded_run / "poses.jsonl").read_bytes() and len(poses) > 0
    print(f"{n_ticks} ticks, played by edges in Python: {len(poses.splitlines())} poses, {'the same' if is_same else 'others'} as in the run, byte for byte")
    sys.exit(0 if is_same else 1)
