"""Shards of rendered pictures, as `lab training-frames` writes them.

A shard is a file `frames_*.bin` of records: pixels [192, 320, 3] as bytes (RGB), then 16 boxes (left,
top, right, bottom in pixels, 0 at the outer edge of the first one; share of the body that is seen, -1
for unused ones) as little-endian floats.
"""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

WIDTH_PX, HEIGHT_PX, MOST = 320, 192, 16
RECORD = np.dtype([("pixels", "u1", (HEIGHT_PX, WIDTH_PX, 3)), ("boxes", "<f4", (MOST, 5))])
# Of ImageNet, as the pose network has them.
MEAN = (0.485, 0.456, 0.406)
STD = (0.229, 0.224, 0.225)


class Frames:
    """All shards of a folder; new ones are taken in as they appear."""

    def __init__(self, folder: Path, seed: int = 0) -> None:
        self.folder, self.random = folder, np.random.default_rng(seed)
        self.files: dict[Path, np.memmap] = {}
        self.left: list[tuple[Path, int]] = []
        self.refresh()

    def refresh(self) -> None:
        """Looks for shards that are whole (others are written under another name)."""
        for path in sorted(self.folder.glob("frames_*.bin")):
            if path not in self.files:
                self.files[path] = np.memmap(path, dtype=RECORD, mode="r")

    def __len__(self) -> int:
        return sum(len(file) for file in self.files.values())

    def draw(self, count: int) -> np.ndarray:
        """The next `count` records: each comes once before any comes again."""
        while len(self.left) < count:
            self.refresh()
            if not len(self):
                raise SystemExit(f"{self.folder}: no frames_*.bin with a record, expected what `lab training-frames` writes")
            order = [(path, i) for path, file in self.files.items() for i in range(len(file))]
            self.random.shuffle(order)
            self.left = order + self.left
        return np.stack([self.files[path][i] for path, i in (self.left.pop() for _ in range(count))])

    def in_order(self, count: int):
        """All records in batches of at most `count`, as they lie in the files."""
        for file in self.files.values():
            for start in range(0, len(file), count):
                yield np.array(file[start : start + count])


def inputs(records: np.ndarray) -> tuple[Tensor, Tensor]:
    """Network inputs [n, 3, h, w] and boxes [n, 16, 5]."""
    pixels = torch.from_numpy(np.ascontiguousarray(records["pixels"])).permute(0, 3, 1, 2).float()
    mean, std = (torch.tensor(v).view(1, 3, 1, 1) for v in (MEAN, STD))
    return (pixels / 255 - mean) / std, torch.from_numpy(records["boxes"].copy())


def augmented(records: np.ndarray, random: np.random.Generator) -> tuple[Tensor, Tensor]:
    """As [`inputs`], half of them mirrored, each with its own contrast and colour cast."""
    x, boxes = inputs(records)
    n = len(x)
    is_mirrored = torch.from_numpy(random.random(n) < 0.5)
    x[is_mirrored] = x[is_mirrored].flip(3)
    left, right = boxes[:, :, 0].clone(), boxes[:, :, 2].clone()
    boxes[:, :, 0] = torch.where(is_mirrored[:, None], WIDTH_PX - right, left)
    boxes[:, :, 2] = torch.where(is_mirrored[:, None], WIDTH_PX - left, right)
    gain = random.uniform(0.7, 1.35, (n, 1, 1, 1)) * random.uniform(0.85, 1.15, (n, 3, 1, 1))
    offset = random.normal(0.0, 0.2, (n, 1, 1, 1)) + random.normal(0.0, 0.1, (n, 3, 1, 1))
    return x * torch.from_numpy(gain).float() + torch.from_numpy(offset).float(), boxes


def shrunk(x: Tensor, boxes: Tensor) -> tuple[Tensor, Tensor]:
    """Inputs and boxes of copies of half the size."""
    small = torch.nn.functional.avg_pool2d(x, 2)
    return small, boxes * torch.tensor([0.5, 0.5, 0.5, 0.5, 1.0])
