"""How many people the detector finds in held-out pictures, by their size, and what else it finds.

    python accuracy.py farfield_detector.onnx FRAMES/held-out
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from detector import boxes_of, cells_of
from frames import HEIGHT_PX, WIDTH_PX, Frames, inputs

# The edge's bars for a box and for one person of two boxes. The edge also drops boxes that are the upper part
# of somebody (edge/src/tiles/merge.rs), which is not done here: some of what is false here, it does not report.
MIN_SCORE, SAME_PERSON = 0.3, 0.45
# A person is found by a box that overlaps so much, as COCO counts.
FOUND = 0.5
# Who is seen less than half is not counted, found or not; nor who is hardly there.
CLEAR, FAINT = 0.5, 9.0
SIZES_PX = ((9, 16), (16, 24), (24, 48), (48, 96), (96, 200))


@dataclass
class Accuracy:
    """People found in percent by size (longest side), and boxes that are nobody's."""

    pictures: int
    found: list[float]
    false_per_picture: float
    overlap: float

    def __str__(self) -> str:
        sizes = ", ".join(f"{low}-{high} px {found:.1f}" for (low, high), found in zip(SIZES_PX, self.found, strict=True))
        return (
            f"found % {sizes}; false {self.false_per_picture:.3f} a picture; mean overlap"
            f" {self.overlap:.3f} ({self.pictures} pictures)"
        )


def overlaps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Intersection over union of all pairs [n, m]."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:4], b[None, :, 2:4])
    both = (high - low).clip(0).prod(2)
    area = lambda c: (c[:, 2:4] - c[:, :2]).prod(1)  # noqa: E731
    return both / (area(a)[:, None] + area(b)[None] - both).clip(1e-6)


def detections(cells: Tensor, corners: Tensor, strides: Tensor) -> list[np.ndarray]:
    """Per picture the boxes and scores [n, 5], the surest first and thinned out."""
    boxes = boxes_of(cells, corners, strides).numpy()
    scores = cells[:, :, 4].numpy()
    found = []
    for box, score in zip(boxes, scores, strict=True):
        order = [i for i in np.argsort(-score) if score[i] >= MIN_SCORE]
        kept: list[int] = []
        for i in order:
            if not kept or overlaps(box[[i]], box[kept]).max() < SAME_PERSON:
                kept.append(i)
        found.append(np.concatenate([box[kept], score[kept, None]], 1))
    return found


def accuracy(network: nn.Module, frames: Frames, limit: int | None = None) -> Accuracy:
    """Scores `network` (cells with how sure as 0 to 1) on at most `limit` pictures."""
    corners, strides = cells_of(HEIGHT_PX, WIDTH_PX)
    hits: list[list[bool]] = [[] for _ in SIZES_PX]
    false, pictures, shares = 0, 0, []
    for records in frames.in_order(32):
        x, boxes = inputs(records)
        with torch.no_grad():
            cells = network(x).float()
        for found, truth in zip(detections(cells, corners, strides), boxes.numpy(), strict=True):
            truth = truth[truth[:, 4] >= 0]
            table = overlaps(found, truth) if len(found) and len(truth) else np.zeros((len(found), len(truth)))
            taken: set[int] = set()
            for row in table:
                free = [j for j in range(len(truth)) if j not in taken and row[j] >= FOUND]
                if free:
                    taken.add(best := max(free, key=lambda j: row[j]))
                    shares.append(row[best])
                elif not len(row) or row.max() < 0.1:
                    false += 1
            for j, person in enumerate(truth):
                longest = (person[2:4] - person[:2]).max()
                for n, (low, high) in enumerate(SIZES_PX):
                    if low <= longest < high and person[4] >= CLEAR and longest >= FAINT:
                        hits[n].append(j in taken)
        pictures += len(records)
        if limit is not None and pictures >= limit:
            break
    found = [100 * float(np.mean(h)) if h else float("nan") for h in hits]
    return Accuracy(pictures, found, false / max(1, pictures), float(np.mean(shares or [0.0])))


class OnnxDetector(nn.Module):
    """An ONNX file under ONNX Runtime, on one thread."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def forward(self, x: Tensor) -> Tensor:
        return torch.from_numpy(self.session.run(None, {"image": x.numpy()})[0])

    def milliseconds(self, height_px: int, width_px: int) -> float:
        """Least time of 30 runs on one picture."""
        x = torch.zeros(1, 3, height_px, width_px)
        times = []
        for _ in range(30):
            start = time.perf_counter()
            self(x)
            times.append(time.perf_counter() - start)
        return 1e3 * min(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("frames", type=Path)
    args = parser.parse_args()
    network = OnnxDetector(args.model)
    print(accuracy(network, Frames(args.frames)))
    shape = network.session.get_inputs()[0].shape
    print(f"{network.milliseconds(shape[2], shape[3]):.1f} ms a pass of {shape[3]} x {shape[2]}")


if __name__ == "__main__":
    main()
