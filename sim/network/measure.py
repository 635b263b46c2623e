"""Accuracy of a network on held-out crops, and its time per crop under ONNX Runtime.

    python measure.py farfield_hrnet.onnx CROPS/held-out
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from data import HIDDEN, VISIBLE, Shards, normalised, peaks, shrunk
from network import Shape

# A keypoint counts as found within this share of the crop's height (the box with its margin).
PCK_SHARE = 0.05
BATCH = 32


@dataclass
class Accuracy:
    """Found keypoints in percent, and errors in input pixels."""

    crops: int
    pck_visible: float
    pck_hidden: float
    pck_all: float
    median_px: float
    mean_px: float
    # Highest value of the maps of visible keypoints, and of those outside the crop.
    peak_visible: float
    peak_outside: float
    pck_by_keypoint: list[float]

    def __str__(self) -> str:
        return (
            f"PCK@{PCK_SHARE} {self.pck_visible:.2f} % of visible, {self.pck_hidden:.2f} % of"
            f" hidden, {self.pck_all:.2f} % of all keypoints; visible: median {self.median_px:.2f} px,"
            f" mean {self.mean_px:.2f} px, peak {self.peak_visible:.2f}; outside: peak"
            f" {self.peak_outside:.2f} ({self.crops} crops)"
        )


def accuracy(
    infer: nn.Module,
    shards: Shards,
    small_px: tuple[int, int] | None = None,
    limit: int | None = None,
) -> Accuracy:
    """Scores `infer` on at most `limit` crops, or on small copies of this height and width.

    Errors are in pixels of the crops as they are, not of the copies.
    """
    errors, states, heights = [], [], []
    count = 0
    for crops in shards.in_order(BATCH):
        x, wanted = normalised(torch.from_numpy(crops.pixels)), torch.from_numpy(crops.keypoints)
        full_px = x.shape[2:]
        if small_px:
            x, _ = shrunk(x, wanted, *small_px)
        with torch.no_grad():
            found, height = peaks(infer(x).float())
        ratio = torch.tensor([full_px[1] / x.shape[3], full_px[0] / x.shape[2]])
        found = (found + 0.5) * ratio - 0.5
        errors.append((found.numpy() - crops.keypoints[:, :, :2]))
        states.append(crops.keypoints[:, :, 2])
        heights.append(height.numpy())
        count += len(crops.pixels)
        if limit is not None and count >= limit:
            break
    error = np.linalg.norm(np.concatenate(errors), axis=2)
    state, height = np.concatenate(states), np.concatenate(heights)
    is_found = error < PCK_SHARE * shards.record["pixels"].shape[0]
    visible, hidden = state == VISIBLE, state == HIDDEN

    def percent(of: np.ndarray) -> float:
        return float(100 * is_found[of].mean()) if of.any() else float("nan")

    return Accuracy(
        crops=count,
        pck_visible=percent(visible),
        pck_hidden=percent(hidden),
        pck_all=percent(visible | hidden),
        median_px=float(np.median(error[visible])),
        mean_px=float(error[visible].mean()),
        peak_visible=float(height[visible].mean()),
        peak_outside=float(height[state == 0].mean()),
        pck_by_keypoint=[
            float(100 * is_found[:, k][visible[:, k]].mean()) for k in range(state.shape[1])
        ],
    )


class OnnxNetwork(nn.Module):
    """An ONNX file under ONNX Runtime, on one thread."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(
            path, options, providers=["CPUExecutionProvider"]
        )
        self.input = self.session.get_inputs()[0]

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return torch.from_numpy(self.session.run(None, {self.input.name: x.numpy()})[0])


def milliseconds(network: OnnxNetwork, shape: Shape, batch: int, runs: int = 200) -> list[float]:
    """Processor time per crop, the shortest first: a busy machine's clock tells of other work."""
    x = torch.zeros(batch, 3, shape.height_px, shape.width_px)
    times = []
    for _ in range(runs // batch):
        began = time.process_time()
        network(x)
        times.append(1000 * (time.process_time() - began) / batch)
    return sorted(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("held_out", type=Path)
    args = parser.parse_args()
    network = OnnxNetwork(args.model)
    shape = Shape(height_px=network.input.shape[2], width_px=network.input.shape[3])
    score = accuracy(network, Shards(args.held_out, shape))
    print(score)
    print("visible, by keypoint:", " ".join(f"{p:.1f}" for p in score.pck_by_keypoint))
    for batch in [1, 4]:
        times = milliseconds(network, shape, batch)
        print(
            f"ONNX Runtime, one thread, batch {batch}: {times[len(times) // 2]:.2f} ms a"
            f" crop (best {times[0]:.2f})"
        )


if __name__ == "__main__":
    main()
