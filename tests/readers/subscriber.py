"""Runs a lock-step venue with examples/subscriber.py as a subscriber, and compares its output with poses.jsonl.

    pip install eclipse-zenoh
    python tests/readers/subscriber.py FARFIELD VENUE

FARFIELD is the program, VENUE a venue file whose sources need only files, such as that of `farfield demo --maps`. The nodes use a
port of the loopback. Every confirmed person must be in the output, at every tick from the confirmation on, with the pelvis of
poses.jsonl. Exits with 1 if not, if a node fails, or after three minutes.
"""

import json
import pathlib
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tomllib

TICKS = 60
PATIENCE_S = 180
LAST_ROWS_S = 20  # Seconds from the end of the run to the last row.
ROUNDING_M = 0.6e-5  # poses.jsonl has five decimals.
SUBSCRIBER = pathlib.Path(__file__).parents[2] / "examples/subscriber.py"


def free_port():
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return found.getsockname()[1]


def lines_of(stream):
    """The lines so far, read in the background."""
    lines = []
    threading.Thread(target=lambda: lines.extend(stream), daemon=True).start()
    return lines


def wait_until(holds, what, deadline, started):
    """Polls `holds`. A process that fails, or the time limit, ends the test."""
    while not holds():
        for process in started:
            if process.poll():
                sys.exit(f"{' '.join(process.args[:4])} ended with {process.returncode}, before {what}")
        if time.monotonic() > deadline:
            sys.exit(f"{PATIENCE_S} s are over, before {what}")
        time.sleep(0.05)


def run(farfield, venue, out):
    """The output of the subscriber."""
    names = tomllib.loads(pathlib.Path(venue).read_text())
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    deadline, started, log = time.monotonic() + PATIENCE_S, [], []

    def start(*words, **how):
        # A node ends when its standard input does: it has a pipe that stays open.
        started.append(subprocess.Popen([str(word) for word in words], stdin=subprocess.PIPE, text=True, **how))
        return started[-1]

    try:
        fusion = start(farfield, "fusion", venue, "--listen", endpoint, "--ticks", f"0..{TICKS}", "--out", out, stderr=subprocess.PIPE)
        log = lines_of(fusion.stderr)
        wait_until(lambda: any("listens on" in line for line in log), "fusion listened", deadline, started)
        # Its first line means that it has subscribed: the edges, and with them the first tick, start after it.
        subscriber = start(sys.executable, SUBSCRIBER, names["name"], endpoint, stdout=subprocess.PIPE)
        lines = lines_of(subscriber.stdout)
        wait_until(lambda: lines, "the subscriber listened", deadline, started)
        edges = [start(farfield, "edge", venue, "--viewpoint", one["name"], "--connect", endpoint) for one in names["viewpoint"]]
        wait_until(lambda: all(node.poll() == 0 for node in [fusion, *edges]), "all nodes were done", deadline, started)
        # Rows may still be in flight: those of the last tick must arrive.
        last = {(line["tick"], line["person"]) for line in written_poses(out) if line["tick"] == TICKS - 1}
        patience = time.monotonic() + LAST_ROWS_S
        while time.monotonic() < patience and not last <= {(int(row["tick"]), int(row["person"])) for row in rows_of(lines)}:
            time.sleep(0.05)
        subscriber.terminate()
        subscriber.wait(20)
    except SystemExit:
        sys.stderr.writelines(list(log))
        raise
    finally:
        for process in started:
            if process.poll() is None:
                process.kill()
    return rows_of(lines)


def rows_of(lines):
    """The rows after the first line, by its names; without a row that is not complete yet."""
    head, *rows = [line.split() for line in list(lines) if line.endswith("\n")]
    return [dict(zip(head, row, strict=True)) for row in rows]


def written_poses(out):
    return [json.loads(line) for line in (out / "poses.jsonl").read_text().splitlines()]


def compare(printed, out):
    written = {(line["tick"], line["person"]): line for line in written_poses(out)}
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
    # Not "greater": NaN must fail too.
    return everybody and last == TICKS - 1 and not missing and not more and not states and off_m <= ROUNDING_M


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    with tempfile.TemporaryDirectory() as scratch:
        out = pathlib.Path(scratch) / "run"
        is_same = compare(run(sys.argv[1], sys.argv[2], out), out)
    sys.exit(0 if is_same else "what the subscriber printed is not what fusion wrote")
