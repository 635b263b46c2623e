"""Shards of rendered crops, as `lab training-crops` writes them.

A shard is a file `crops_*.bin` of records: the crop's pixels [height, width, 3] as bytes (RGB), then
17 keypoints (x, y in input pixels, centre of the first pixel at 0; state) as little-endian floats.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from network import KEYPOINTS, Shape

# States of a keypoint.
OUTSIDE, HIDDEN, VISIBLE = 0, 1, 2
# Of ImageNet, as the networks of the field are given their pixels; also what lies outside a picture.
MEAN = (0.485, 0.456, 0.406)
STD = (0.229, 0.224, 0.225)
# Input pixel = CELL_PX x cell + CELL_OFFSET_PX.
CELL_PX = 4
CELL_OFFSET_PX = 1.5
SIGMA_CELLS = 2.0
# COCO's order with left and right exchanged.
MIRRORED = (0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15)


@dataclass
class Crops:
    """Crops [n, h, w, 3] as bytes and their keypoints [n, 17, 3]."""

    pixels: np.ndarray
    keypoints: np.ndarray


def record(shape: Shape) -> np.dtype:
    """One crop of a shard."""
    return np.dtype(
        [
            ("pixels", "u1", (shape.height_px, shape.width_px, 3)),
            ("keypoints", "<f4", (KEYPOINTS, 3)),
        ]
    )


class Shards:
    """All shards of a folder; new ones are taken in as they appear."""

    def __init__(self, folder: Path, shape: Shape, seed: int = 0) -> None:
        self.folder = folder
        self.record = record(shape)
        self.random = np.random.default_rng(seed)
        self.files: dict[Path, np.memmap] = {}
        self.left: list[tuple[Path, int]] = []
        self.refresh()

    def refresh(self) -> None:
        """Looks for shards that are whole (others are written under another name)."""
        for path in sorted(self.folder.glob("crops_*.bin")):
            if path not in self.files:
                self.files[path] = np.memmap(path, dtype=self.record, mode="r")

    def __len__(self) -> int:
        return sum(len(file) for file in self.files.values())

    def draw(self, count: int) -> Crops:
        """The next `count` crops: each crop comes once before any comes again."""
        while len(self.left) < count:
            self.refresh()
            order = [(path, i) for path, file in self.files.items() for i in range(len(file))]
            self.random.shuffle(order)
            self.left = order + self.left
        chosen = [self.left.pop() for _ in range(count)]
        records = np.stack([self.files[path][i] for path, i in chosen])
        return Crops(records["pixels"], records["keypoints"])

    def in_order(self, count: int):
        """All crops in batches of at most `count`, as they lie in the files."""
        for file in self.files.values():
            for start in range(0, len(file), count):
                records = file[start : start + count]
                yield Crops(np.array(records["pixels"]), np.array(records["keypoints"]))


def normalised(pixels: Tensor) -> Tensor:
    """Bytes [n, h, w, 3] as the network's input [n, 3, h, w]."""
    x = pixels.permute(0, 3, 1, 2).float() / 255.0
    return (x - torch.tensor(MEAN).view(1, 3, 1, 1)) / torch.tensor(STD).view(1, 3, 1, 1)


def augmented(crops: Crops, random: np.random.Generator) -> tuple[Tensor, Tensor]:
    """Inputs and keypoints, half of them mirrored, each with its own contrast and colour cast.

    What is unknown (outside a picture) is 0 after normalisation, and stays it.
    """
    x = normalised(torch.from_numpy(crops.pixels))
    keypoints = torch.from_numpy(crops.keypoints.copy())
    n, _, _, width = x.shape
    is_mirrored = torch.from_numpy(random.random(n) < 0.5)
    x[is_mirrored] = x[is_mirrored].flip(3)
    mirrored = keypoints[is_mirrored][:, list(MIRRORED)]
    mirrored[:, :, 0] = width - 1 - mirrored[:, :, 0]
    keypoints[is_mirrored] = mirrored
    gain = random.uniform(0.7, 1.35, (n, 1, 1, 1)) * random.uniform(0.85, 1.15, (n, 3, 1, 1))
    offset = random.normal(0.0, 0.2, (n, 1, 1, 1)) + random.normal(0.0, 0.1, (n, 3, 1, 1))
    is_known = (x.abs().amax(1, keepdim=True) > 0.02).float()
    x = (x * torch.from_numpy(gain).float() + torch.from_numpy(offset).float()) * is_known
    return x, keypoints


def shrunk(x: Tensor, keypoints: Tensor, height_px: int, width_px: int) -> tuple[Tensor, Tensor]:
    """Inputs and keypoints of smaller crops of the same scenes."""
    small = torch.nn.functional.interpolate(x, size=(height_px, width_px), mode="area")
    ratio = torch.tensor([width_px / x.shape[3], height_px / x.shape[2], 1.0])
    half = torch.tensor([0.5, 0.5, 0.0])
    return small, (keypoints + half) * ratio - half


def targets(
    keypoints: Tensor, height_px: int, width_px: int, hidden_weight: float
) -> tuple[Tensor, Tensor]:
    """Gaussian maps [n, 17, h/4, w/4] and the weight of each map [n, 17, 1, 1]."""
    state = keypoints[:, :, 2]
    cells = (keypoints[:, :, :2] - CELL_OFFSET_PX) / CELL_PX
    column = torch.arange(width_px // CELL_PX).view(1, 1, -1)
    row = torch.arange(height_px // CELL_PX).view(1, 1, -1)
    along_x = torch.exp(-((column - cells[:, :, :1]) ** 2) / (2 * SIGMA_CELLS**2))
    along_y = torch.exp(-((row - cells[:, :, 1:2]) ** 2) / (2 * SIGMA_CELLS**2))
    maps = along_y[:, :, :, None] * along_x[:, :, None, :]
    maps = maps * (state > OUTSIDE)[:, :, None, None]
    weight = torch.where(state == HIDDEN, hidden_weight, 1.0)
    return maps, weight[:, :, None, None]


def sides(keypoints: Tensor, height_px: int) -> tuple[Tensor, Tensor]:
    """What `Network.with_sides` should say [n, 8, 2], and where it is known [n, 8, 1]."""
    left, right = keypoints[:, 1::2], keypoints[:, 2::2]
    is_known = torch.minimum(left[:, :, 2:], right[:, :, 2:]) > OUTSIDE
    return (left[:, :, :2] - right[:, :, :2]) / (0.1 * height_px), is_known.float()


def peaks(maps: Tensor) -> tuple[Tensor, Tensor]:
    """Position of the highest peak of each map in input pixels [n, 17, 2], and its height [n, 17].

    The cell is refined by the parabola through the logarithms of its neighbours, which is exact for
    a Gaussian.
    """
    n, k, rows, columns = maps.shape
    height, index = maps.reshape(n, k, -1).max(2)
    row, column = index // columns, index % columns
    logs = maps.clamp_min(1e-3).log()
    padded = torch.nn.functional.pad(logs, (1, 1, 1, 1), mode="replicate")

    def at(dy: int, dx: int) -> Tensor:
        flat = (row + 1 + dy) * (columns + 2) + column + 1 + dx
        return padded.reshape(n, k, -1).gather(2, flat[:, :, None])[:, :, 0]

    def shift(before: Tensor, after: Tensor) -> Tensor:
        bend = before - 2 * at(0, 0) + after
        return torch.where(bend < -1e-6, (before - after) / (2 * bend), 0.0).clamp(-0.5, 0.5)

    x = column + shift(at(0, -1), at(0, 1))
    y = row + shift(at(-1, 0), at(1, 0))
    return torch.stack([x, y], 2) * CELL_PX + CELL_OFFSET_PX, height
