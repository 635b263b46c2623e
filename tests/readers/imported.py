"""Writes the keypoints of a venue as OpenPose in a Pose2Sim project, as COCO results and as AlphaPose, imports and runs each
with one command, and compares the poses with those of the venue.

    python tests/readers/imported.py FARFIELD VENUE DIR

FARFIELD is the program, VENUE a venue file whose cameras are files of COCO's 17 keypoints, DIR a folder that does not exist.
The reference is that venue without its field and without peaks of unknown people, which no format contains. Bound: joints 1 mm,
and the same people in the same ticks. Exits with 1 if it is exceeded.
"""

import json
import pathlib
import shutil
import subprocess
import sys
import tomllib

MM = 1.0
# Index in OpenPose's BODY_25 of each of COCO's 17 keypoints.
BODY_25 = [0, 16, 15, 18, 17, 5, 2, 6, 3, 7, 4, 12, 9, 13, 10, 14, 11]


def keypoints_of(venue, folder):
    """Per camera, the people of each frame: [(tick, [[x, y, score] or None, ...])]."""
    cameras = {}
    for viewpoint in venue["viewpoint"]:
        for camera in viewpoint["camera"]:
            lines = (folder / camera["source"]["path"]).read_text().splitlines()
            frames = [json.loads(line) for line in lines if line]
            cameras[camera["name"]] = [(it["tick"], [person["keypoints"] for person in it["persons"]]) for it in frames]
    return cameras


def flat(person, places=range(17), count=17):
    numbers = [0.0] * (3 * count)
    for seen, at in zip(person, places):
        if seen is not None:
            numbers[3 * at : 3 * at + 3] = seen
    return numbers


def by_hand(cameras, venue, out):
    lines = [f"name = {json.dumps(venue['name'])}", f"rate_hz = {float(venue['rate_hz'])}", 'calibration = "calibration.toml"']
    if "first_tick" in venue:
        lines.append(f"first_tick = {venue['first_tick']}")
    for name, frames in cameras.items():
        lines += ["[[viewpoint]]", f"name = {json.dumps(name)}", "[[viewpoint.camera]]", f"name = {json.dumps(name)}"]
        lines.append(f'source = {{ kind = "keypoints", path = "{name}.jsonl" }}')
        written = [json.dumps({"tick": tick, "persons": [{"keypoints": it} for it in people]}) for tick, people in frames]
        (out / f"{name}.jsonl").write_text("\n".join(written) + "\n")
    (out / "venue.toml").write_text("\n".join(lines) + "\n")


def openpose(cameras, rate_hz, out):
    """A Pose2Sim project: a file per frame; the rate is in its Config.toml."""
    (out / "Config.toml").write_text(f"[project]\nframe_rate = {rate_hz}\n")
    for name, frames in cameras.items():
        folder = out / "pose" / f"{name}_json"
        folder.mkdir(parents=True)
        for tick, people in frames:
            written = [{"person_id": [-1], "pose_keypoints_2d": flat(it, BODY_25, 25)} for it in people]
            path = folder / f"{name}_{tick:012}_keypoints.json"
            path.write_text(json.dumps({"version": 1.3, "people": written}))
    return []


def coco_results(cameras, rate_hz, out):
    for name, frames in cameras.items():
        written = [
            {"image_id": tick, "category_id": 1, "keypoints": flat(it), "score": 1.0} for tick, people in frames for it in people
        ]
        (out / f"{name}.json").write_text(json.dumps(written))
    return ["--rate", str(rate_hz)]


def alphapose(cameras, rate_hz, out):
    for name, frames in cameras.items():
        (out / name).mkdir()
        written = [
            {"image_id": f"{tick}.jpg", "category_id": 1, "keypoints": flat(it), "score": 2.5, "box": [0, 0, 1, 1], "idx": 1}
            for tick, people in frames
            for it in people
        ]
        (out / name / "alphapose-results.json").write_text(json.dumps(written))
    return ["--rate", str(rate_hz)]


def solved(farfield, venue, out):
    subprocess.run([farfield, "run", venue, "--out", out], check=True, capture_output=True, stdin=subprocess.DEVNULL)
    lines = [json.loads(line) for line in (out / "poses.jsonl").read_text().splitlines()]
    return {(it["tick"], it["person"]): it["joints"] for it in lines if "person" in it}


def furthest_mm(ours, theirs):
    apart = [
        abs(a - b)
        for key in ours.keys() & theirs.keys()
        for name, at in ours[key].items()
        for a, b in zip(at, theirs[key][name])
    ]
    return 1000 * max(apart, default=float("inf"))


def main(farfield, venue_path, out):
    venue_path, out = pathlib.Path(venue_path), pathlib.Path(out)
    out.mkdir(parents=True)
    venue = tomllib.loads(venue_path.read_text())
    cameras = keypoints_of(venue, venue_path.parent)
    calibration = venue_path.parent / venue["calibration"]
    (out / "hand").mkdir()
    shutil.copy(calibration, out / "hand" / "calibration.toml")
    by_hand(cameras, venue, out / "hand")
    ours = solved(farfield, out / "hand" / "venue.toml", out / "hand" / "out")
    n_bodies = sum(len(people) for frames in cameras.values() for _, people in frames)
    print(f"by hand: {len(cameras)} cameras, {n_bodies} bodies, {len(ours)} poses of {len({p for _, p in ours})} people")
    failed = [] if ours else ["by hand"]
    for write in (openpose, coco_results, alphapose):
        folder = out / write.__name__
        folder.mkdir()
        shutil.copy(calibration, folder / "Calib_venue.toml")
        rate = write(cameras, venue["rate_hz"], folder)
        result = subprocess.run([farfield, "import", folder, *rate], capture_output=True, text=True)
        if result.returncode:
            print(f"{write.__name__}: {result.stderr.strip()}")
            failed.append(write.__name__)
            continue
        theirs = solved(farfield, folder / "farfield" / "venue.toml", folder / "out")
        missing, worst_mm = len(ours.keys() ^ theirs.keys()), furthest_mm(ours, theirs)
        print(f"{write.__name__:14} {missing} poses missing or more, joints {worst_mm:.4f} mm apart (bound {MM})")
        if missing or not worst_mm <= MM:
            failed.append(write.__name__)
    return failed


if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit(__doc__)
    wrong = main(*sys.argv[1:])
    sys.exit(f"not the same: {', '.join(wrong)}" if wrong else 0)
