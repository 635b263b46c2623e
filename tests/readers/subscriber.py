"""Runs a lock-step venue with examples/subscriber.py listening, and compares what it printed with poses.jsonl.

    pip install eclipse-zenoh
    python tests/readers/subscriber.py FARFIELD VENUE

FARFIELD is the program, VENUE a venue file whose sources need nothing but files, such as the one that `farfield demo --maps`
leaves. The nodes talk over a port of the loopback. Everybody who was confirmed must be there, at every tick from the
confirmation on, with the pelvis where poses.jsonl has it. Exits with 1 where that is not so.
"""

import json
import pathlib
import socket
import subprocess
import sys
import tempfile
import threading
import tomllib

TICKS = 60
ROUNDING_M = 0.6e-5  # poses.jsonl has five decimals.
SUBSCRIBER = pathlib.Path(__file__).parents[2] / "examples/subscriber.py"


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def run(farfield, venue, out):
    """What the subscriber printed."""
    names = tomllib.loads(pathlib.Path(venue).read_text())
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    started = []

    def start(*words, **how):
        # A node leaves when its standard input ends: it has a pipe that nobody closes.
        started.append(subprocess.Popen([str(word) for word in words], stdin=subprocess.PIPE, **how))
        return started[-1]

    try:
        fusion = start(farfield, "fusion", venue, "--listen", endpoint, "--ticks", f"0..{TICKS}", "--out", out, stderr=subprocess.PIPE, text=True)
        for line in fusion.stderr:
            if "listens on" in line:
                break
        # Its first line says that it listens: the edges, and with them the first tick, come after.
        subscriber = start(sys.executable, SUBSCRIBER, names["name"], endpoint, stdout=subprocess.PIPE, text=True)
        head = subscriber.stdout.readline().split()
        printed = []
        reader = threading.Thread(target=lambda: printed.extend(line.split() for line in subscriber.stdout))
        reader.start()
        for viewpoint in names["viewpoint"]:
            start(farfield, "edge", venue, "--viewpoint", viewpoint["name"], "--connect", endpoint)
        fusion.stderr.read()
        if fusion.wait(120) != 0:
            sys.exit(f"fusion ended with {fusion.returncode}")
        subscriber.terminate()
        reader.join(20)
    finally:
        for process in started:
            if process.poll() is None:
                process.kill()
    return [dict(zip(head, values, strict=True)) for values in printed]


def compare(printed, out):
    lines = [json.loads(line) for line in (out / "poses.jsonl").read_text().splitlines()]
    written = {(line["tick"], line["person"]): line for line in lines}
    found = {(int(row["tick"]), int(row["person"])): row for row in printed}
    confirmed = {person: min(tick for tick, one in found if one == person) for _, person in found}
    due = {key for key in written if key[0] >= confirmed.get(key[1], TICKS)}
    missing, more = sorted(due - set(found)), sorted(set(found) - set(written))
    off_m = max(
        (abs(float(found[key][f"{axis}_m"]) - at) for key in due & set(found) for axis, at in zip("xyz", written[key]["joints"]["pelvis"])),
        default=float("nan"),
    )
    states = sum(found[key]["state"] != written[key]["state"] or int(found[key]["views"]) != written[key]["views"] for key in due & set(found))
    last = max((tick for tick, _ in found), default=None)
    print(f"{len(found)} poses of {len(confirmed)} people, to tick {last}: {len(missing)} missing, {len(more)} too many, "
          f"{states} of another state, pelvis at most {1000 * off_m:.4f} mm off")
    everybody = len(confirmed) == len({person for _, person in written}) > 0
    # Not "greater": a NaN fails too.
    return everybody and last == TICKS - 1 and not missing and not more and not states and off_m <= ROUNDING_M


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as scratch:
        out = pathlib.Path(scratch) / "run"
        is_same = compare(run(sys.argv[1], sys.argv[2], out), out)
    sys.exit(0 if is_same else "what the subscriber printed is not what fusion wrote")
