"""Trains the detector on rendered pictures, for a given time of the wall clock.

    python train.py --train FRAMES/train --held-out FRAMES/held-out --pose POSE/latest.pt --out RUN --minutes 45

The learning rate falls with the time, not with the steps, so that a busy machine trains less but
always to the end. The first part of the time goes to copies of half the size, in which the network learns what
people are. RUN/latest.pt can be exported at any time.
"""

import argparse
import time
from copy import deepcopy
from math import cos, pi
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from accuracy import accuracy
from detector import STRIDES, Detector, boxes_of, cells_of
from frames import Frames, augmented, shrunk
from network import Network, Shape

# Longest sides of the people that each grid is for, pixels; neighbours share some.
SIZES_PX = ((0.0, 64.0), (40.0, 140.0), (100.0, 1e9))
# Cells this near to the middle of a person are the person's, strides.
RADIUS = 1.3
# Who is seen less than this, or is smaller, is neither asked for nor wrong.
LEAST_SEEN, LEAST_PX = 0.25, 9.0
BOX_SCALE = 2.0
WARM_UP = 0.02


def generalised_overlap(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Intersection over union of boxes [n, 4], and less the share of the hull that is in neither."""
    size = (torch.minimum(a[:, 2:], b[:, 2:]) - torch.maximum(a[:, :2], b[:, :2])).clamp(min=0)
    both = size.prod(1)
    union = (a[:, 2:] - a[:, :2]).prod(1) + (b[:, 2:] - b[:, :2]).prod(1) - both
    hull = (torch.maximum(a[:, 2:], b[:, 2:]) - torch.minimum(a[:, :2], b[:, :2])).prod(1)
    overlap = both / union.clamp(min=1e-6)
    return overlap, overlap - (hull - union) / hull.clamp(min=1e-6)


def assigned(boxes: Tensor, corners: Tensor, strides: Tensor) -> tuple[Tensor, Tensor]:
    """Which box each cell is to find [n, cells], -1 for none; and where the answer counts."""
    middle = (boxes[:, :, :2] + boxes[:, :, 2:4]) / 2
    size = boxes[:, :, 2:4] - boxes[:, :, :2]
    longest = size.amax(2)
    is_there = boxes[:, :, 4] >= 0
    is_asked = is_there & (boxes[:, :, 4] >= LEAST_SEEN) & (longest >= LEAST_PX)
    at = corners + strides[:, None] / 2
    away = (at[None, :, None] - middle[:, None]).abs().amax(3) / strides[None, :, None]
    fits = torch.zeros(away.shape, dtype=torch.bool)
    for stride, (low, high) in zip(STRIDES, SIZES_PX, strict=True):
        fits |= (strides == stride)[None, :, None] & ((longest >= low) & (longest < high))[:, None]
    is_near = fits & (away < RADIUS) & is_asked[:, None]
    # The smaller of two is in front of the larger, or farther away and lost otherwise.
    area = torch.where(is_near, size.prod(2)[:, None].expand_as(away), torch.inf)
    smallest, which = area.min(2)
    which = torch.where(smallest.isfinite(), which, -1)
    inside = ((at[None, :, None] > boxes[:, None, :, :2]) & (at[None, :, None] < boxes[:, None, :, 2:4])).all(3)
    doubtful = (inside & (is_there & ~is_asked)[:, None]).any(2)
    return which, (which >= 0) | ~doubtful


def loss_of(cells: Tensor, boxes: Tensor, corners: Tensor, strides: Tensor) -> tuple[Tensor, Tensor]:
    """Of how sure (a focal loss towards the overlap that is reached), and of the boxes."""
    which, counts = assigned(boxes, corners, strides)
    is_person = which >= 0
    found = boxes_of(cells, corners, strides)[is_person]
    truth = boxes.gather(1, which.clamp(min=0)[:, :, None].expand(-1, -1, 5))[is_person][:, :4]
    overlap, generalised = generalised_overlap(found, truth)
    wanted = torch.zeros(which.shape)
    wanted[is_person] = overlap.detach().clamp(min=0.1)
    sure = cells[:, :, 4]
    cross = nn.functional.binary_cross_entropy_with_logits(sure, wanted, reduction="none")
    off = (sure.sigmoid() - wanted).detach().abs() ** 2
    persons = max(1, int(is_person.sum()))
    return (cross * off * counts).sum() / persons, (1 - generalised).sum() / persons


def learning_rate(share: float, highest: float) -> float:
    """At a share of the time gone: a short rise, then half a cosine down to a hundredth."""
    return highest * min(1.0, share / WARM_UP) * (0.01 + 0.99 * 0.5 * (1 + cos(pi * min(share, 1.0))))


def follow(average: nn.Module, network: nn.Module, step: int) -> None:
    """Moves the running average of the weights on."""
    keep = min(0.998, (1 + step) / (10 + step))
    with torch.no_grad():
        state = network.state_dict()
        for name, value in average.state_dict().items():
            if value.dtype.is_floating_point:
                value.lerp_(state[name], 1 - keep)
            else:
                value.copy_(state[name])


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--train", type=Path, required=True)
    parser.add_argument("--held-out", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=45.0)
    parser.add_argument("--small", type=float, default=0.6, help="share of the time, small copies")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--rate", type=float, default=2e-3)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--pose", type=Path, help="a checkpoint of the pose network to begin with")
    parser.add_argument("--start", type=Path, help="a checkpoint whose weights to begin with")
    return parser.parse_args()


def main() -> None:
    args = arguments()
    torch.manual_seed(0)
    torch.set_num_threads(args.threads)
    random = np.random.default_rng(0)
    pose = Network(Shape())
    if args.pose:
        pose.load_state_dict(torch.load(args.pose)["average"])
    network, seen, minutes_before = Detector(pose), 0, 0.0
    if args.start:
        checkpoint = torch.load(args.start)
        network.load_state_dict(checkpoint["average"])
        seen, minutes_before = checkpoint["frames"], checkpoint["minutes"]
    network = network.to(memory_format=torch.channels_last).train()
    average = deepcopy(network).eval()
    optimiser = torch.optim.AdamW(network.parameters(), lr=args.rate, weight_decay=1e-2)
    frames, held_out = Frames(args.train), Frames(args.held_out)
    args.out.mkdir(parents=True, exist_ok=True)
    began = said = time.monotonic()
    step, since, sums = 0, 0, np.zeros(2)
    while (share := (time.monotonic() - began) / (60 * args.minutes)) < 1:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(share, args.rate)
        is_small = share < args.small
        # Small copies cost a quarter.
        x, boxes = augmented(frames.draw(args.batch * (2 if is_small else 1)), random)
        if is_small:
            x, boxes = shrunk(x, boxes)
        corners, strides = cells_of(*x.shape[2:])
        with torch.autocast("cpu", torch.bfloat16):
            cells = network.flat(x.contiguous(memory_format=torch.channels_last))
        sure, box = loss_of(cells.float(), boxes, corners, strides)
        optimiser.zero_grad()
        (sure + BOX_SCALE * box).backward()
        nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        follow(average, network, step)
        step, seen, since = step + 1, seen + len(x), since + len(x)
        sums += np.array([sure.item(), box.item()]) * len(x)
        if (now := time.monotonic()) - said > 300 or step == 30:
            minutes = minutes_before + (now - began) / 60
            score = accuracy(average, held_out, limit=96)
            rate = since / (now - said)
            print(
                f"{minutes:.1f} min, {seen} pictures ({len(frames)} different), {rate:.1f} a second,"
                f" loss {sums[0] / since:.3f} + {sums[1] / since:.3f}; held out: {score}",
                flush=True,
            )
            save(args.out / "latest.pt", average, seen, minutes, len(frames))
            frames.refresh()
            held_out.refresh()
            said, since, sums = time.monotonic(), 0, np.zeros(2)
    save(args.out / "latest.pt", average, seen, minutes_before + args.minutes, len(frames))
    print(f"{seen} pictures; held out: {accuracy(average, held_out)}")


def save(path: Path, average: nn.Module, seen: int, minutes: float, different: int) -> None:
    """Writes a checkpoint under its name when it is whole."""
    unfinished = path.with_suffix(".tmp")
    state = {"average": average.state_dict(), "frames": seen, "minutes": minutes, "different": different}
    torch.save(state, unfinished)
    unfinished.rename(path)


if __name__ == "__main__":
    main()
