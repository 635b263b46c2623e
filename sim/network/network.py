"""An HRNet of small width: parallel branches at several resolutions that exchange what they know.

The contract is that of a full HRNet export: crops [n, 3, h, w] in, 17 maps [n, 17, h/4, w/4] out.
Only convolutions, batch normalisation, ReLU, nearest upsampling and sums are used, so that every
runtime of ONNX files runs it fast.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

KEYPOINTS = 17
# Keypoints that there are two of, left and right.
PAIRS = 8


@dataclass(frozen=True)
class Shape:
    """The size of a network. `widths` are the channels at 1/4, 1/8, ... of the input."""

    height_px: int = 224
    width_px: int = 160
    stem: int = 16
    widths: tuple[int, ...] = (16, 32, 64, 96)
    # Residual blocks of each branch, in each stage; a stage ends with an exchange.
    blocks: tuple[int, ...] = (1, 1, 1, 1)
    # Branches of each stage. Two stages have all of them: what the coarsest one has seen of the whole
    # body (which side is left, above all) must reach the finest one before its last block.
    branches: tuple[int, ...] = (2, 3, 4, 4)
    head: int = 32


def convolution(into: int, out: int, size: int, stride: int = 1) -> list[nn.Module]:
    """A convolution that keeps the size (or halves it), with batch normalisation."""
    return [
        nn.Conv2d(into, out, size, stride, size // 2, bias=False),
        nn.BatchNorm2d(out),
    ]


class Residual(nn.Module):
    """Two 3x3 convolutions beside the identity."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.body = nn.Sequential(
            *convolution(width, width, 3), nn.ReLU(inplace=True), *convolution(width, width, 3)
        )
        self.relu = nn.ReLU(inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        return self.relu(self.body(x) + x)


def downward(into: int, out: int, steps: int) -> nn.Sequential:
    """Halves the resolution `steps` times."""
    layers: list[nn.Module] = []
    for step in range(steps):
        is_last = step == steps - 1
        layers += convolution(into, out if is_last else into, 3, stride=2)
        layers += [] if is_last else [nn.ReLU(inplace=True)]
    return nn.Sequential(*layers)


class Exchange(nn.Module):
    """Every branch becomes the sum of all branches, brought to its resolution and width."""

    def __init__(self, widths: tuple[int, ...], targets: tuple[int, ...]) -> None:
        super().__init__()
        self.paths = nn.ModuleList(
            nn.ModuleList(self._path(widths, targets, i, j) for i in range(len(widths)))
            for j in range(len(targets))
        )
        # Not in place: a branch that is passed on as it is belongs to other paths too.
        self.relu = nn.ReLU()

    @staticmethod
    def _path(widths: tuple[int, ...], targets: tuple[int, ...], i: int, j: int) -> nn.Module:
        if i < j:
            return downward(widths[i], targets[j], j - i)
        if i > j or widths[i] != targets[j]:
            return nn.Sequential(*convolution(widths[i], targets[j], 1))
        return nn.Identity()

    def forward(self, branches: list[Tensor]) -> list[Tensor]:
        return [self.target(j, paths, branches) for j, paths in enumerate(self.paths)]

    def target(self, j: int, paths: nn.ModuleList, branches: list[Tensor]) -> Tensor:
        total = paths[j](branches[j]) if j < len(branches) else None
        # From the coarsest up, so that each resolution is enlarged only once, with the sum of all
        # coarser ones already in it.
        coarse = None
        for i in range(len(branches) - 1, j, -1):
            term = paths[i](branches[i])
            coarse = term if coarse is None else term + interpolate(coarse, scale_factor=2.0)
        if coarse is not None:
            total = total + interpolate(coarse, scale_factor=2.0)
        for i in range(min(j, len(branches))):
            term = paths[i](branches[i])
            total = term if total is None else total + term
        return self.relu(total)


def middle(x: Tensor) -> Tensor:
    """A window over [.., h, w] that is 1 in the middle, where the person is."""
    rows, columns = (torch.hann_window(n + 2, periodic=False)[1:-1].to(x) for n in x.shape[2:])
    return rows[:, None] * columns


class Network(nn.Module):
    """Stem, stages of parallel branches, and a head on the finest one."""

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        first = shape.widths[0]
        self.stem = nn.Sequential(
            *convolution(3, shape.stem, 3, stride=2),
            nn.ReLU(inplace=True),
            *convolution(shape.stem, first, 3, stride=2),
            nn.ReLU(inplace=True),
            Residual(first),
        )
        self.stages = nn.ModuleList()
        self.exchanges = nn.ModuleList()
        # The first transition only adds a branch.
        have = 1
        self.start = Exchange(shape.widths[:1], shape.widths[: shape.branches[0]])
        for stage, (blocks, have) in enumerate(zip(shape.blocks, shape.branches, strict=True)):
            widths = shape.widths[:have]
            self.stages.append(
                nn.ModuleList(
                    nn.Sequential(*(Residual(width) for _ in range(blocks))) for width in widths
                )
            )
            is_last = stage == len(shape.branches) - 1
            targets = (shape.head,) if is_last else shape.widths[: shape.branches[stage + 1]]
            self.exchanges.append(Exchange(widths, targets))
        self.head = nn.Conv2d(shape.head, KEYPOINTS, 1)
        # Only to train with, see `with_sides`.
        self.sides = nn.Conv2d(shape.widths[-1], 2 * PAIRS, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
        nn.init.normal_(self.head.weight, std=0.01)
        nn.init.zeros_(self.head.bias)

    def forward(self, x: Tensor) -> Tensor:
        return self.with_sides(x)[0]

    def with_sides(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """The maps, and what the coarsest branch believes of left and right.

        The second is [n, 8, 2], the way from each right keypoint to its left one in tenths of the
        input's height. Maps alone are slow to teach which side is which: a peak on either side of
        the body is a long way towards the truth, until the network finds the face.
        """
        branches = self.start([self.stem(x)])
        coarsest = x
        for stage, exchange in zip(self.stages, self.exchanges, strict=True):
            bodies = [body(x) for body, x in zip(stage, branches, strict=True)]
            coarsest = bodies[-1]
            branches = exchange(bodies)
        weight = middle(coarsest)
        sides = (self.sides(coarsest) * weight).sum((2, 3)) / weight.sum()
        return self.head(branches[0]), sides.reshape(-1, PAIRS, 2)
