"""From raw files to a calibration, like a user: seconds, whether the sheet passes, and the errors of the cameras.

    pip install numpy opencv-python-headless
    python3 tests/readers/raw_files.py FARFIELD DIR [--pictures N]

Draws to DIR, if they are missing, a video of a ball of N images (5400: three minutes) and twenty images of a chessboard for each of
four cameras of 1920 x 1200 with the same distorted lens. Then runs `farfield calibrate all` on them with the positions of the cameras
only. Needs ffmpeg. Not in CI: it takes minutes. Exits with 1 if the sheet does not pass, or a camera is more than 10 mm or 0.1
degrees off.
"""

import argparse
import pathlib
import shutil
import subprocess
import sys
import time
import tomllib

import cv2
import numpy as np

SIZE_PX = (1920, 1200)
MATRIX = np.array([[1500.0, 0, 959.5], [0, 1500.0, 599.5], [0, 0, 1]])
LENS = np.array([-0.08, 0.02, 0.0, 0.0, 0.0])
CAMERAS_M = {"north": (0.0, 9.0, 3.2), "east": (12.0, 0.5, 3.0), "south": (-1.0, -9.5, 3.4), "west": (-12.0, -0.8, 2.8)}
TARGET_M = np.array([0.0, 0.0, 1.0])
RATE_HZ = 30
BALL_M, BALL_BGR = 0.11, (20, 120, 240)
SQUARES, SQUARE_M, BOARDS = (9, 6), 0.08, 20
# Pixels of the drawn board per square; noise in levels.
DRAWN_PX, NOISE = 100, 2.0
MOST_MM, MOST_DEGREES = 10.0, 0.1


def pose(camera_m):
    """Rotation and translation from world to camera: it faces the target, upright."""
    ahead = TARGET_M - camera_m
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0, 0, 1])
    right /= np.linalg.norm(right)
    turn = np.array([right, np.cross(ahead, right), ahead])
    return turn, -turn @ np.array(camera_m)


def ball_m(seconds):
    """Carried through the whole field, up and down."""
    s = np.sin(np.outer([0.35, 1.3, 0.27, 1.1, 0.21], [seconds]).ravel() + [0, 0, 1, 0, 0])
    return np.array([5.5 * s[0] + 0.8 * s[1], 3.4 * s[2] + 0.5 * s[3], 1.2 + 0.8 * s[4]])


def film(path, camera_m, pictures, rng):
    turn, move = pose(camera_m)
    wall = cv2.GaussianBlur(rng.integers(60, 170, (*SIZE_PX[::-1], 3), dtype=np.uint8), (0, 0), 6)
    wall = cv2.normalize(wall, None, 70, 150, cv2.NORM_MINMAX)
    raw = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", "{}x{}".format(*SIZE_PX), "-r", str(RATE_HZ), "-i", "-"]
    made = ["-c:v", "libx264", "-preset", "ultrafast", "-crf", "20", "-pix_fmt", "yuv420p", path]
    writer = subprocess.Popen(["ffmpeg", "-y", "-loglevel", "error", *raw, *made], stdin=subprocess.PIPE)
    for number in range(pictures):
        at = ball_m(number / RATE_HZ)
        px = cv2.projectPoints(at.reshape(1, 3), cv2.Rodrigues(turn)[0], move, MATRIX, LENS)[0].ravel()
        radius_px = MATRIX[0, 0] * BALL_M / (turn @ at + move)[2]
        picture = wall.copy()
        middle, radius = [round(256 * x) for x in px], round(256 * radius_px)
        cv2.circle(picture, middle, radius, BALL_BGR, -1, cv2.LINE_AA, 8)
        writer.stdin.write(picture.tobytes())
    writer.stdin.close()
    if writer.wait():
        sys.exit("ffmpeg failed")


def chessboard():
    columns, rows = SQUARES
    board = np.full(((rows + 2) * DRAWN_PX, (columns + 2) * DRAWN_PX), 255, np.uint8)
    for row in range(rows):
        for column in range(row % 2, columns, 2):
            y, x = (row + 1) * DRAWN_PX, (column + 1) * DRAWN_PX
            board[y : y + DRAWN_PX, x : x + DRAWN_PX] = 20
    return board


def draw_boards(folder, rng):
    """Tilted in all directions, up to the corners of the image."""
    folder.mkdir(parents=True)
    board, (columns, rows), (width, height) = chessboard(), SQUARES, SIZE_PX
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 1, 2).astype(np.float32)
    straight = cv2.undistortPoints(pixels, MATRIX, LENS, P=MATRIX).reshape(height, width, 2)
    board_from_drawn = np.diag([SQUARE_M / DRAWN_PX, SQUARE_M / DRAWN_PX, 1])
    corner = -SQUARE_M * np.array([columns + 2, rows + 2, 0]) / 2
    ends = DRAWN_PX * np.array([[1, 1], [columns + 1, 1], [1, rows + 1], [columns + 1, rows + 1]])
    made = 0
    while made < BOARDS:
        turn = cv2.Rodrigues(rng.uniform(-0.7, 0.7, 3) * [1, 1, 0.4])[0]
        away = rng.uniform(0.9, 2.2)
        aside = rng.uniform(-0.46, 0.46, 2) * SIZE_PX / MATRIX[0, 0] * away
        at = turn @ corner + [*aside, away]
        drawn = MATRIX @ np.stack([turn[:, 0], turn[:, 1], at], 1) @ board_from_drawn
        seen = drawn @ np.column_stack([ends, np.ones(4)]).T
        seen = seen[:2] / seen[2]
        if (seen < 20).any() or (seen.max(1) > np.array(SIZE_PX) - 20).any():
            continue
        picture = cv2.warpPerspective(board, drawn, SIZE_PX, flags=cv2.INTER_AREA, borderValue=110)
        picture = cv2.remap(picture, straight[..., 0], straight[..., 1], cv2.INTER_LINEAR, borderValue=110)
        picture = cv2.GaussianBlur(picture, (0, 0), 0.7) + rng.normal(0, NOISE, picture.shape)
        cv2.imwrite(str(folder / f"{made:03}.png"), np.clip(picture, 0, 255).astype(np.uint8))
        made += 1


def calibrate(farfield, folder):
    """Seconds, exit code."""
    for left in ["lenses", "seen"]:
        shutil.rmtree(folder / left, ignore_errors=True)
    for left in folder.glob("found.*"):
        left.unlink()
    at = [f"--at={name}={x},{y},{z}" for name, (x, y, z) in CAMERAS_M.items()]
    board = ["--boards", "boards", "--chessboard", "{}x{}".format(SQUARES[0] - 1, SQUARES[1] - 1), "--square-mm", str(1000 * SQUARE_M)]
    colour = "#{:02x}{:02x}{:02x}".format(*BALL_BGR[::-1])
    begun = time.monotonic()
    words = [farfield.resolve(), "calibrate", "all", "recordings", *board, "--colour", colour, *at, "--out", "found.toml"]
    done = subprocess.run(words, cwd=folder)
    return time.monotonic() - begun, done.returncode


def off(camera):
    """Error of a camera of the calibration: millimetres, degrees."""
    true_turn, _ = pose(CAMERAS_M[camera["name"]])
    turn = cv2.Rodrigues(np.array(camera["rotation"]))[0]
    place_m = -turn.T @ camera["translation"]
    apart = np.linalg.norm(cv2.Rodrigues(turn @ true_turn.T)[0])
    return 1000 * np.linalg.norm(place_m - CAMERAS_M[camera["name"]]), np.degrees(apart)


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("farfield", type=pathlib.Path)
    arguments.add_argument("folder", type=pathlib.Path)
    arguments.add_argument("--pictures", type=int, default=5400)
    asked = arguments.parse_args()
    rng = np.random.default_rng(3)
    for name, camera_m in CAMERAS_M.items():
        video = asked.folder / "recordings" / f"{name}.mp4"
        if not video.exists():
            video.parent.mkdir(parents=True, exist_ok=True)
            film(video, camera_m, asked.pictures, rng)
            draw_boards(asked.folder / "boards" / name, rng)
    seconds, code = calibrate(asked.farfield, asked.folder)
    if code:
        sys.exit(f"`farfield calibrate all` ended with {code}")
    found = tomllib.loads((asked.folder / "found.toml").read_text())
    cameras = [camera for camera in found.values() if isinstance(camera, dict) and "rotation" in camera]
    mm, degrees = np.array([off(camera) for camera in cameras]).max(0)
    print(f"{seconds:.0f} s from raw files to a sheet that passes; the worst of {len(cameras)} cameras is {mm:.1f} mm and {degrees:.3f} degrees off")
    if len(cameras) < len(CAMERAS_M) or mm > MOST_MM or degrees > MOST_DEGREES:
        sys.exit(f"asked: {len(CAMERAS_M)} cameras, {MOST_MM} mm, {MOST_DEGREES} degrees")


if __name__ == "__main__":
    main()
