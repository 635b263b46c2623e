"""The same rendered images of a Charuco board, calibrated by us, by OpenCV and by aniposelib: corners, lenses, poses, seconds.

    pip install numpy scipy opencv-contrib-python-headless aniposelib
    python3 tests/readers/boards.py DIR

Renders four cameras and forty moments to DIR if they are missing, runs ours on them (`cargo test --release -p
farfield-calibration --test side_by_side_boards`), then the others, and prints a table. Not in CI: it takes minutes. Exits with 1
if ours finds fewer corners than OpenCV, or is worse than the better of the others by more than half in corners, focal length or place.
"""

import contextlib
import io
import json
import os
import pathlib
import subprocess
import sys
import time

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

CAMERAS = ["east", "middle", "north", "west"]
SIZE_PX = (1280, 720)
MATRIX = np.array([[900.0, 0, 652.0], [0, 903.0, 349.0], [0, 0, 1]])
LENS = np.array([-0.12, 0.05, 0.0008, -0.0005, 0.0])
SQUARES = (8, 6)
SQUARE_M, MARKER_M = 0.08, 0.06
MOMENTS = 40
# Pixels of the drawn board per square; rendering: rays per pixel along each side, blur, noise in levels.
DRAWN_PX, RAYS, BLUR_PX, NOISE = 120, 3, 0.6, 2.0


def charuco():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    return cv2.aruco.CharucoBoard(SQUARES, SQUARE_M, MARKER_M, dictionary)


def cameras():
    """World to camera: on an arc around the middle, between 1.5 m high and low, at 2.2 to 2.8 m."""
    poses = []
    for i, angle in enumerate(np.radians([-36, -11, 14, 40])):
        away = 2.2 + 0.2 * i
        at = np.array([away * np.sin(angle), 0.35 * (-1) ** i, -away * np.cos(angle)])
        ahead = -at / np.linalg.norm(at)
        right = np.cross([0, 1, 0], ahead)
        right /= np.linalg.norm(right)
        turn = np.array([right, np.cross(ahead, right), ahead])
        poses.append((turn, -turn @ at))
    return poses


def boards():
    """World from board, one per moment: tilted in all directions, moved around the middle."""
    poses = []
    for i in range(MOMENTS):
        turn = 2.4 * i
        tilt = np.array([np.cos(turn), np.sin(turn), 0.25 * np.cos(1.7 * turn)]) * 0.45
        rotation = Rotation.from_rotvec(tilt).as_matrix()
        middle = np.array([0.62 * np.cos(1.3 * turn), 0.3 * np.sin(1.9 * turn), 0.35 * np.sin(0.9 * turn)])
        size = np.array([SQUARES[0], SQUARES[1], 0]) * SQUARE_M
        poses.append((rotation, middle - rotation @ (size / 2)))
    return poses


def corners_m():
    across, down = SQUARES[0] - 1, SQUARES[1] - 1
    grid = [[SQUARE_M * (i + 1), SQUARE_M * (j + 1), 0] for j in range(down) for i in range(across)]
    return np.array(grid)


def projected(camera, board, points_m):
    """Distorted pixels of points of the board; (0, 0) is the centre of the first pixel."""
    (turn, shift), (board_turn, board_shift) = camera, board
    rotation, place = turn @ board_turn, turn @ board_shift + shift
    px, _ = cv2.projectPoints(points_m, cv2.Rodrigues(rotation)[0], place, MATRIX, LENS)
    return px.reshape(-1, 2)


def picture(camera, board, texture, rng):
    (turn, shift), (board_turn, board_shift) = camera, board
    rotation, place = turn @ board_turn, turn @ board_shift + shift
    edge_m = np.array([[0, 0, 0], [SQUARES[0], 0, 0], [SQUARES[0], SQUARES[1], 0], [0, SQUARES[1], 0]]) * SQUARE_M
    outline = projected(camera, board, edge_m)
    low = np.clip(np.floor(outline.min(axis=0)).astype(int) - 12, 0, SIZE_PX)
    high = np.clip(np.ceil(outline.max(axis=0)).astype(int) + 12, 0, SIZE_PX)
    level = np.full((SIZE_PX[1], SIZE_PX[0]), 120.0)
    # Rays through parts of each pixel, intersected with the plane of the board.
    parts = (np.arange(RAYS) + 0.5) / RAYS - 0.5
    x, y = ((np.arange(low[k], high[k])[:, None] + parts).ravel() for k in range(2))
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2)
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
    rays = cv2.undistortPoints(grid, MATRIX, LENS, criteria=criteria).reshape(-1, 2)
    plane = np.column_stack([rotation[:, 0], rotation[:, 1], place])
    on_board = np.linalg.solve(plane, np.column_stack([rays, np.ones(len(rays))]).T)
    at = on_board[:2] / on_board[2] / SQUARE_M * DRAWN_PX - 0.5
    shape = (len(y), len(x))
    drawn = cv2.remap(
        texture, at[0].reshape(shape).astype(np.float32), at[1].reshape(shape).astype(np.float32), cv2.INTER_LINEAR, borderValue=120
    )
    drawn = drawn.reshape(len(y) // RAYS, RAYS, len(x) // RAYS, RAYS).mean(axis=(1, 3))
    level[low[1] : high[1], low[0] : high[0]] = drawn
    level = cv2.GaussianBlur(level, (0, 0), BLUR_PX) + rng.normal(0, NOISE, level.shape)
    return np.clip(np.round(level), 0, 255).astype(np.uint8)


def render(folder):
    done = folder / "rendered"
    if done.exists():
        return
    texture = charuco().generateImage((SQUARES[0] * DRAWN_PX, SQUARES[1] * DRAWN_PX)).astype(np.float32)
    texture = 30 + 190 / 255 * texture
    rng = np.random.default_rng(5)
    for name, camera in zip(CAMERAS, cameras()):
        (folder / name).mkdir(parents=True, exist_ok=True)
        for moment, board in enumerate(boards()):
            cv2.imwrite(str(folder / name / f"{moment:03}.png"), picture(camera, board, texture, rng))
    done.write_text("")


def pictures(folder, name):
    return [str(folder / name / f"{moment:03}.png") for moment in range(MOMENTS)]


def by_us(folder):
    """A separate process, measured from images to poses like all others here."""
    command = "cargo test --offline --release -p farfield-calibration --test side_by_side_boards -- --nocapture"
    where = pathlib.Path(__file__).resolve().parents[2]
    subprocess.run(command.split(), cwd=where, env=os.environ | {"FARFIELD_BOARDS": str(folder.resolve())}, check=True)
    ours = json.loads((folder / "ours.json").read_text())
    found = {"seconds": ours["seconds"], "rms_px": ours["rms_px"], "corners": {}, "focal_px": ours["focal_px"], "poses": []}
    for name, views in ours["corners"].items():
        for moment, view in views.items():
            found["corners"][name, int(moment)] = {int(number): px for number, px in view}
    for turn, shift in ours["poses"]:
        found["poses"].append((Rotation.from_rotvec(turn).as_matrix(), np.array(shift)))
    return found


def by_opencv(folder):
    """Corners and lenses; then poses of the cameras by stereo calibration with the first."""
    board = charuco()
    detector = cv2.aruco.CharucoDetector(board)
    objects = board.getChessboardCorners()
    began = time.time()
    found = {"corners": {}, "focal_px": [], "rms_px": [], "poses": [(np.eye(3), np.zeros(3))]}
    views, lenses = [], []
    for name in CAMERAS:
        seen = {}
        for moment, path in enumerate(pictures(folder, name)):
            corners, ids, _, _ = detector.detectBoard(cv2.imread(path, cv2.IMREAD_GRAYSCALE))
            if ids is not None and len(ids) > 0:
                seen[moment] = {int(i): corner.ravel() for i, corner in zip(ids.ravel(), corners)}
                found["corners"][name, moment] = seen[moment]
        used = [view for view in seen.values() if len(view) >= 8]
        points = [np.float32([objects[i] for i in view]) for view in used]
        px = [np.float32(list(view.values())) for view in used]
        rms, matrix, lens, _, _ = cv2.calibrateCamera(points, px, SIZE_PX, None, None)
        found["focal_px"].append(float(matrix[0, 0]))
        found["rms_px"].append(float(rms))
        views.append(seen)
        lenses.append((matrix, lens))
    for index in range(1, len(CAMERAS)):
        points, first, other = [], [], []
        for moment in sorted(views[0].keys() & views[index].keys()):
            both = sorted(views[0][moment].keys() & views[index][moment].keys())
            if len(both) >= 8:
                points.append(np.float32([objects[i] for i in both]))
                first.append(np.float32([views[0][moment][i] for i in both]))
                other.append(np.float32([views[index][moment][i] for i in both]))
        flags = cv2.CALIB_FIX_INTRINSIC
        stereo = cv2.stereoCalibrate(points, first, other, *lenses[0], *lenses[index], SIZE_PX, flags=flags)
        found["poses"].append((np.array(stereo[5]), np.array(stereo[6]).ravel()))
    found["seconds"] = time.time() - began
    return found


def by_aniposelib(folder):
    from aniposelib.boards import CharucoBoard
    from aniposelib.cameras import CameraGroup

    board = CharucoBoard(*SQUARES, SQUARE_M, MARKER_M, marker_bits=4, dict_size=50)
    group = CameraGroup.from_names(CAMERAS)
    for camera in group.cameras:
        camera.set_size(SIZE_PX)
    began = time.time()
    rows = [board.detect_images(pictures(folder, name)) for name in CAMERAS]
    found = {"corners": {}, "focal_px": [], "poses": []}
    for name, seen in zip(CAMERAS, rows):
        for row in seen:
            view = {int(i): np.ravel(corner) for i, corner in zip(np.ravel(row["ids"]), row["corners"])}
            if view:
                found["corners"][name, row["framenum"]] = view
    with contextlib.redirect_stdout(io.StringIO()):
        error = group.calibrate_rows([[row for row in seen if len(np.ravel(row["ids"]))] for seen in rows], board, verbose=False)
    found["seconds"] = time.time() - began
    found["rms_px"] = [float(error)]
    for camera in group.cameras:
        found["focal_px"].append(float(camera.get_camera_matrix()[0, 0]))
        found["poses"].append((cv2.Rodrigues(camera.get_rotation())[0], np.ravel(camera.get_translation())))
    return found


def aligned(poses, truth):
    """Worst camera after the best rotation, translation and scale of all: metres, degrees."""
    center = lambda pose: -pose[0].T @ pose[1]
    here, there = (np.array([center(pose) for pose in all_]) for all_ in (poses, truth))
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    # The rotation uses orientations too, since four centres lie nearly on one arc.
    turns = [t[0].T @ p[0] for p, t in zip(poses, truth)]
    turn = Rotation.from_matrix(turns).mean().as_matrix()
    scale = (b * (a @ turn.T)).sum() / (a * a).sum()
    places_m = np.linalg.norm(b - scale * a @ turn.T, axis=1)
    degrees = [np.degrees(Rotation.from_matrix(turn.T @ one).magnitude()) for one in turns]
    return places_m.max(), max(degrees)


def scored(found):
    truth = {
        (name, moment): projected(camera, board, corners_m())
        for name, camera in zip(CAMERAS, cameras())
        for moment, board in enumerate(boards())
    }
    off = [np.linalg.norm(np.asarray(px) - truth[view][number]) for view, seen in found["corners"].items() for number, px in seen.items()]
    inside = sum(
        np.all((px > 0) & (px < np.array(SIZE_PX) - 1), axis=1).sum() for px in truth.values()
    )
    place_m, degrees = aligned(found["poses"], cameras())
    return {
        "corners found": len(off) / inside,
        "corner, median px": float(np.median(off)),
        "corner, 95 % px": float(np.percentile(off, 95)),
        "wrong corners (> 2 px)": int((np.array(off) > 2).sum()),
        "worst reprojection px": max(found["rms_px"]),
        "worst fx px": float(np.abs(np.array(found["focal_px"]) - MATRIX[0, 0]).max()),
        "worst place mm": 1000 * place_m,
        "worst turn deg": degrees,
        "seconds": found["seconds"],
    }


def main():
    folder = pathlib.Path(sys.argv[1])
    render(folder)
    table = {name: scored(by(folder)) for name, by in [("ours", by_us), ("OpenCV", by_opencv), ("aniposelib", by_aniposelib)]}
    print(f"{'':24}" + "".join(f"{name:>12}" for name in table))
    for row in table["ours"]:
        print(f"{row:24}" + "".join(f"{score[row]:12.4g}" for score in table.values()))
    ours, others = table["ours"], [table["OpenCV"], table["aniposelib"]]
    worse = [row for row in ("corner, median px", "worst fx px", "worst place mm") if ours[row] > 1.5 * min(it[row] for it in others)]
    if ours["corners found"] < table["OpenCV"]["corners found"]:
        worse.append("corners found")
    if worse:
        sys.exit(f"ours is worse in: {', '.join(worse)}")


if __name__ == "__main__":
    main()
