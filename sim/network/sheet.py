"""Draws crops with their keypoints, or what a network says of them, on one picture to look at.

    python sheet.py CROPS sheet.png [--model farfield_hrnet.onnx] [--first 0]
"""

import argparse
from pathlib import Path

import numpy as np
import torch

from data import HIDDEN, OUTSIDE, Shards, normalised, peaks
from network import Shape

COLUMNS, ROWS = 12, 5
LIMBS = (
    (5, 7), (7, 9), (6, 8), (8, 10), (5, 6), (11, 12), (5, 11), (6, 12),
    (11, 13), (13, 15), (12, 14), (14, 16), (0, 1), (0, 2), (1, 3), (2, 4),
)  # fmt: skip
# Left is blue, right is red, the middle is white.
LEFT, RIGHT, MIDDLE, FAINT = (40, 120, 255), (255, 60, 40), (255, 255, 255), (150, 150, 150)


def draw(pixels: np.ndarray, keypoints: np.ndarray) -> np.ndarray:
    """One crop with its keypoints; hidden ones are hollow."""
    from PIL import Image, ImageDraw

    image = Image.fromarray(pixels)
    canvas = ImageDraw.Draw(image)
    for a, b in LIMBS:
        if min(keypoints[a, 2], keypoints[b, 2]) > OUTSIDE:
            color = MIDDLE if a % 2 != b % 2 else LEFT if a % 2 else RIGHT
            canvas.line([tuple(keypoints[a, :2]), tuple(keypoints[b, :2])], fill=color)
    for k, (x, y, state) in enumerate(keypoints):
        if state > OUTSIDE:
            color = MIDDLE if k == 0 else LEFT if k % 2 else RIGHT
            fill = None if state == HIDDEN else color
            canvas.ellipse([x - 2, y - 2, x + 2, y + 2], fill=fill, outline=color)
    return np.array(image)


def main() -> None:
    from PIL import Image

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("crops", type=Path)
    parser.add_argument("sheet", type=Path)
    parser.add_argument("--model", type=Path, help="draw what this network finds")
    parser.add_argument("--first", type=int, default=0)
    args = parser.parse_args()
    shards = Shards(args.crops, Shape())
    count = COLUMNS * ROWS
    crops = next(c for i, c in enumerate(shards.in_order(count)) if i == args.first // count)
    keypoints = crops.keypoints
    if args.model:
        from measure import OnnxNetwork

        found, height = peaks(OnnxNetwork(args.model)(normalised(torch.from_numpy(crops.pixels))))
        state = (height > 0.15).int() + (height > 0.4).int()
        keypoints = torch.cat([found, state[:, :, None]], 2).numpy()
    drawn = [draw(p, k) for p, k in zip(crops.pixels, keypoints, strict=True)]
    rows = [np.concatenate(drawn[r : r + COLUMNS], 1) for r in range(0, len(drawn), COLUMNS)]
    Image.fromarray(np.concatenate([r for r in rows if r.shape == rows[0].shape], 0)).save(args.sheet)


if __name__ == "__main__":
    main()
