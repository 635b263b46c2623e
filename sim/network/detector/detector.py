"""A small detector of people: one pass over the whole picture, three grids of boxes out.

The layout is YOLOX's raw one: grids at strides 8, 16 and 32, per cell x and y (strides from the
cell's corner), log of width and height (strides), how sure, and the class, of which there is one.
It begins as the pose network does, with that network's weights: what a body looks like it knows already.
"""

import sys
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from network import Network, Shape, convolution  # noqa: E402

STRIDES = (8, 16, 32)
# Stages of the pose network that are kept.
STAGES = 2
# Channels of the grids before the last convolution.
HEAD = 48
# x, y, log width, log height, how sure.
VALUES = 5


class Detector(nn.Module):
    """The first stages of the pose network, and one head for all three grids."""

    def __init__(self, pose: Network | None = None) -> None:
        super().__init__()
        pose = pose or Network(Shape())
        self.stem, self.start = pose.stem, pose.start
        self.stages, self.exchanges = pose.stages[:STAGES], pose.exchanges[:STAGES]
        # The finest branch ends here.
        self.exchanges[-1].paths[0] = nn.ModuleList()
        self.sides = nn.ModuleList(nn.Conv2d(width, HEAD, 1) for width in pose.shape.widths[1:])
        self.before = nn.ModuleList(
            nn.Sequential(*convolution(HEAD, HEAD, 3), nn.ReLU(inplace=True)) for _ in STRIDES
        )
        self.heads = nn.ModuleList(nn.Conv2d(HEAD, VALUES, 1) for _ in STRIDES)
        for module in (*self.sides.modules(), *self.before.modules()):
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
        for head in self.heads:
            nn.init.normal_(head.weight, std=0.01)
            # A cell is hardly ever a person; a person is about 2 strides wide and 4 tall.
            head.bias.data = torch.tensor([0.5, 0.5, 0.7, 1.4, -4.6])

    def grids(self, x: Tensor) -> list[Tensor]:
        """The raw grids [n, 5, h/stride, w/stride], before the sigmoid of the last value."""
        levels = self.start([self.stem(x)])
        for stage, exchange in zip(self.stages, self.exchanges, strict=True):
            bodies = [body(x) for body, x in zip(stage, levels, strict=True)]
            levels = [
                exchange.target(j, paths, bodies) for j, paths in enumerate(exchange.paths) if len(paths)
            ]
        levels = [side(level) for side, level in zip(self.sides, levels, strict=True)]
        for finer in (1, 0):
            levels[finer] = levels[finer] + interpolate(levels[finer + 1], scale_factor=2, mode="nearest")
        return [head(before(x)) for head, before, x in zip(self.heads, self.before, levels, strict=True)]

    def flat(self, x: Tensor) -> Tensor:
        """All cells [n, cells, 5], before the sigmoid."""
        return torch.cat([grid.flatten(2).transpose(1, 2) for grid in self.grids(x)], 1)

    def forward(self, x: Tensor) -> Tensor:
        """What is exported: all cells [n, cells, 6], how sure (0 to 1) and the class (always 1) last."""
        cells = self.flat(x)
        sure = cells[:, :, 4:].sigmoid()
        return torch.cat([cells[:, :, :4], sure, sure * 0 + 1], 2)


def cells_of(height_px: int, width_px: int) -> tuple[Tensor, Tensor]:
    """Corner of each cell in input pixels [cells, 2], and its stride [cells]."""
    corners, strides = [], []
    for stride in STRIDES:
        rows, columns = height_px // stride, width_px // stride
        row, column = torch.meshgrid(torch.arange(rows), torch.arange(columns), indexing="ij")
        corners.append(torch.stack([column.flatten(), row.flatten()], 1) * float(stride))
        strides.append(torch.full((rows * columns,), float(stride)))
    return torch.cat(corners), torch.cat(strides)


def boxes_of(cells: Tensor, corners: Tensor, strides: Tensor) -> Tensor:
    """Left, top, right, bottom in input pixels, 0 at the outer edge of the first one [n, cells, 4]."""
    middle = cells[:, :, :2] * strides[:, None] + corners
    half = cells[:, :, 2:4].clamp(-6, 6).exp() * strides[:, None] / 2
    return torch.cat([middle - half, middle + half], 2)
