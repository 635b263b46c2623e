"""Cost of open pages for fusion: duration of a tick with none, with one, and with ten of which three never read.

    pip install websockets
    python tests/readers/page_cost.py FARFIELD [--scene FILE] [--rounds N] [--seconds S]

FARFIELD is the program. One live run, in which the three cases take turns, so that other load on the machine affects all alike. The
result is the median of the rounds' medians and 99th percentiles of the status' `fusion` stage (last maps of a tick to its pose), and
their ratio to no page. Bytes are those of a page that reads. Exits with 1 if a page that reads received less than half of the
ticks, or fusion fell behind.
"""

import argparse
import asyncio
import json
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import urllib.request

import websockets

# Seconds of the server's percentiles; older values belong to the case before.
WINDOW_S = 10
# Share of the venue's rate below which fusion fell behind.
LEAST_SHARE = 0.9
CASES = {"none": (0, 0), "one": (1, 0), "ten, three stalled": (7, 3)}

failures = []


def check(what, is_right, found=""):
    print(f"{'ok' if is_right else 'FAILED'}: {what}{f' ({found})' if found != '' else ''}", flush=True)
    if not is_right:
        failures.append(what)


class Run:
    """A live demo from maps, with its page."""

    def __init__(self, program, scene, folder):
        words = [program, "demo", "--page=127.0.0.1:7463", "--out", folder] + (["--scene", scene] if scene else [])
        self.child = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        self.address = None
        for line in self.child.stderr:
            if found := re.search(r"http://(\S+?)/#token", line):
                self.address = found.group(1)
                break
        if self.address is None:
            sys.exit("no page was served")
        # Other output must not fill the pipe.
        threading.Thread(target=lambda: [None for _ in self.child.stderr], daemon=True).start()

    def asked(self, path):
        with urllib.request.urlopen(f"http://{self.address}/api/{path}", timeout=5) as answer:
            return json.load(answer)

    def status(self):
        return self.asked("status")

    def end(self):
        self.child.stdin.close()
        self.child.terminate()
        self.child.wait(timeout=30)


class Reader:
    """A page that reads everything, and counts it."""

    def __init__(self):
        self.bytes, self.ticks = 0, 0

    async def read(self, address):
        async with websockets.connect(f"ws://{address}/ws", max_size=None) as socket:
            async for message in socket:
                self.bytes += len(message)
                self.ticks += isinstance(message, bytes)


async def stalled(address):
    """An open page that reads nothing: no frame is taken from its socket, so no ping is answered."""
    reader, writer = await asyncio.open_connection(*address.split(":"), limit=1024)
    key = "AAAAAAAAAAAAAAAAAAAAAA=="
    head = f"GET /ws HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
    writer.write((head + "Sec-WebSocket-Version: 13\r\n\r\n").encode())
    await reader.readuntil(b"\r\n\r\n")
    writer.transport.pause_reading()
    return writer


async def case(run, reading, stalling, seconds):
    """Fusion's percentiles in one case, and the pages that read."""
    readers = [Reader() for _ in range(reading)]
    tasks = [asyncio.create_task(reader.read(run.address)) for reader in readers]
    closed = [await stalled(run.address) for _ in range(stalling)]
    await asyncio.sleep(WINDOW_S / 2)
    before = [(reader.bytes, reader.ticks) for reader in readers]
    loop = asyncio.get_running_loop()
    began = loop.time()
    # The server drops a stalled page after 30 s, so longer cases would have fewer pages.
    await asyncio.sleep(seconds)
    took = loop.time() - began
    status = await asyncio.to_thread(run.status)
    for task in tasks:
        task.cancel()
    for writer in closed:
        writer.transport.abort()
    await asyncio.gather(*tasks, return_exceptions=True)
    stage = next(it for it in status["latency"]["stages"] if it["stage"] == "fusion")
    rates = [((r.bytes - b) / took, (r.ticks - t) / took) for r, (b, t) in zip(readers, before)]
    return {"p50": stage["p50_us"], "p99": stage["p99_us"], "poses": status["poses_per_s"], "clients": status["page"]["clients"],
            "people": status["people"]["tracked"], "rates": rates}


async def measure(run, rounds, seconds):
    for _ in range(60):
        await asyncio.sleep(1)
        status = await asyncio.to_thread(run.status)
        if status["latency"]["stages"] and status["people"]["tracked"] > 0:
            break
    found = {name: [] for name in CASES}
    for _ in range(rounds):
        for name, (reading, stalling) in CASES.items():
            found[name].append(await case(run, reading, stalling, seconds))
    return found


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("farfield")
    parser.add_argument("--scene")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=WINDOW_S + 1)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = Run(args.farfield, args.scene, folder + "/run")
        try:
            found = asyncio.run(measure(run, args.rounds, args.seconds))
            rate_hz = run.asked("venue")["rate_hz"]
        finally:
            run.end()
    base = {at: statistics.median(it[at] for it in found["none"]) for at in ("p50", "p99")}
    print(f"{'pages':20} {'P50 ms':>8} {'P99 ms':>8} {'to none':>14}   poses/s  people")
    for name, rounds in found.items():
        p50, p99 = (statistics.median(it[at] for it in rounds) for at in ("p50", "p99"))
        poses = min(it["poses"] for it in rounds)
        people = max(it["people"] for it in rounds)
        print(f"{name:20} {p50 / 1e3:8.3f} {p99 / 1e3:8.3f} {p50 / base['p50']:6.3f} {p99 / base['p99']:6.3f}   {poses:7.1f} {people:7}")
        each = ", ".join(f"{it['p99'] / 1e3:.3f}" for it in rounds)
        print(f"{'':20} P99 of each round: {each}")
        reading, stalling = CASES[name]
        check(f"{name}: all pages are counted", all(it["clients"] == reading + stalling for it in rounds))
        if reading:
            rates = [rate for it in rounds for rate in it["rates"]]
            slowest = min(ticks for _, ticks in rates)
            check(f"{name}: who reads gets ticks", slowest > 0.5 * poses, f"{slowest:.1f} a second, {statistics.median(b for b, _ in rates):.0f} bytes/s")
        check(f"{name}: fusion keeps up", poses > LEAST_SHARE * rate_hz, f"{poses:.1f} poses/s of {rate_hz:.0f}")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
