"""Trains the network on rendered crops, for a given time of the wall clock.

    python train.py --train CROPS/train --held-out CROPS/held-out --out RUN --minutes 100

The learning rate falls with the time, not with the steps, so that a busy machine trains less but
always to the end. The first part of the time goes to small copies of the crops, which cost a third: the
network learns there what bodies are, and where exactly joints lie in the rest. RUN/latest.pt can
be exported at any time.
"""

import argparse
import time
from copy import deepcopy
from dataclasses import asdict
from math import cos, pi
from pathlib import Path

import numpy as np
import torch
from torch import nn

from data import Shards, augmented, shrunk, sides, targets
from measure import accuracy
from network import Network, Shape

# Of hidden keypoints: the network should guess them, not bend its features to them.
HIDDEN_WEIGHT = 0.4
WARM_UP = 0.02
# Height and width of the small copies, pixels.
SMALL_PX = (160, 128)
# The loss of a map is counted about per peak, not per cell.
LOSS_SCALE = 100.0
SIDES_SCALE = 0.2


def learning_rate(share: float, highest: float) -> float:
    """At a share of the time gone: a short rise, then half a cosine down to a hundredth."""
    rise = min(1.0, share / WARM_UP)
    return highest * rise * (0.01 + 0.99 * 0.5 * (1 + cos(pi * min(share, 1.0))))


def shared(network: nn.Module, share: float, processes: int) -> float:
    """Replaces the gradients by their mean over all processes; gives the sum of `share`."""
    if processes == 1:
        return share
    gradients = [p.grad for p in network.parameters()]
    flat = torch.cat([g.flatten() for g in gradients] + [torch.tensor([share])])
    torch.distributed.all_reduce(flat)
    for gradient, mean in zip(gradients, (flat / processes).split([g.numel() for g in gradients] + [1])):
        gradient.copy_(mean.view_as(gradient))
    return flat[-1].item()


def follow(average: nn.Module, network: nn.Module, step: int) -> None:
    """Moves the running average of the weights on."""
    keep = min(0.999, (1 + step) / (10 + step))
    with torch.no_grad():
        state = network.state_dict()
        for name, value in average.state_dict().items():
            if value.dtype.is_floating_point:
                value.lerp_(state[name], 1 - keep)
            else:
                value.copy_(state[name])


def save(path: Path, shape: Shape, networks: dict[str, nn.Module], progress: dict) -> None:
    """Writes a checkpoint under its name when it is whole."""
    unfinished = path.with_suffix(".tmp")
    states = {name: network.state_dict() for name, network in networks.items()}
    torch.save({"shape": asdict(shape), **states, **progress}, unfinished)
    unfinished.rename(path)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--train", type=Path, required=True)
    parser.add_argument("--held-out", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=100.0)
    parser.add_argument("--small", type=float, default=0.4, help="share of the time, small copies")
    parser.add_argument("--batch", type=int, default=24)
    parser.add_argument("--rate", type=float, default=3e-3)
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--processes", type=int, default=1, help="that train together")
    parser.add_argument("--process", type=int, default=0, help="which of them this one is")
    parser.add_argument("--float32", action="store_true", help="no bfloat16")
    parser.add_argument("--start", type=Path, help="a checkpoint whose weights to begin with")
    return parser.parse_args()


def main() -> None:
    args = arguments()
    torch.manual_seed(0)
    torch.set_num_threads(args.threads)
    random = np.random.default_rng(args.process)
    shape = Shape()
    network = Network(shape)
    seen, minutes_before = 0, 0.0
    if args.start:
        checkpoint = torch.load(args.start)
        network.load_state_dict(checkpoint["average"], strict=False)
        seen, minutes_before = checkpoint["crops"], checkpoint.get("minutes", 0.0)
    network = network.to(memory_format=torch.channels_last).train()
    average = deepcopy(network).eval()
    optimiser = torch.optim.AdamW(network.parameters(), lr=args.rate, weight_decay=1e-2)
    crops, held_out = Shards(args.train, shape, args.process), Shards(args.held_out, shape)
    args.out.mkdir(parents=True, exist_ok=True)
    if args.processes > 1:
        meeting = f"file://{(args.out / 'meeting').resolve()}"
        torch.distributed.init_process_group("gloo", meeting, rank=args.process, world_size=args.processes)
    began = said = time.monotonic()
    step, sum_loss, sum_sides, since = 0, 0.0, 0.0, 0
    share = 0.0

    def share_now() -> float:
        """Of the time, by the clock of the first process."""
        return (time.monotonic() - began) / (60 * args.minutes) if args.process == 0 else 0.0

    while share < 1:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(share, args.rate)
        x, keypoints = augmented(crops.draw(args.batch), random)
        is_small = share < args.small
        if is_small:
            x, keypoints = shrunk(x, keypoints, *SMALL_PX)
        wanted, weight = targets(keypoints, *x.shape[2:], HIDDEN_WEIGHT)
        ways, is_known = sides(keypoints, x.shape[2])
        with torch.autocast("cpu", torch.bfloat16, enabled=not args.float32):
            maps, believed = network.with_sides(x.contiguous(memory_format=torch.channels_last))
        loss = LOSS_SCALE * (weight * (maps.float() - wanted) ** 2).mean()
        error = nn.functional.smooth_l1_loss(believed.float(), ways, reduction="none")
        side_loss = (error * is_known).mean()
        optimiser.zero_grad()
        (loss + SIDES_SCALE * side_loss).backward()
        share = shared(network, share_now(), args.processes)
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
        if args.process == 0:
            follow(average, network, step)
        step, seen, since, sum_loss = step + 1, seen + args.batch * args.processes, since + 1, sum_loss + loss.item()
        sum_sides += side_loss.item()
        is_due = (now := time.monotonic()) - said > 120 or step == 50
        if args.process > 0:
            if step % 100 == 0:
                crops.refresh()
        elif is_due:
            rate = since * args.batch * args.processes / (now - said)
            score = accuracy(average, held_out, SMALL_PX if is_small else None, limit=512)
            minutes = minutes_before + (now - began) / 60
            print(
                f"{minutes:.1f} min, {seen} crops ({len(crops)} of them different), {rate:.1f} a second,"
                f" loss {sum_loss / since:.4f}, sides {sum_sides / since:.4f}, held out: {score}",
                flush=True,
            )
            progress = {"crops": seen, "minutes": minutes, "different": len(crops)}
            save(args.out / "latest.pt", shape, {"network": network, "average": average}, progress)
            crops.refresh()
            held_out.refresh()
            said, since, sum_loss, sum_sides = time.monotonic(), 0, 0.0, 0.0
    if args.process > 0:
        return
    progress = {"crops": seen, "minutes": minutes_before + args.minutes, "different": len(crops)}
    save(args.out / "latest.pt", shape, {"network": network, "average": average}, progress)
    print(f"{seen} crops; held out: {accuracy(average, held_out)}")


if __name__ == "__main__":
    main()
