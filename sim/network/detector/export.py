"""Exports a checkpoint as ONNX.

    python export.py RUN/latest.pt farfield_detector.onnx
"""

import argparse
import sys
import warnings
from pathlib import Path

import torch

from accuracy import OnnxDetector
from detector import Detector

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from halving import OPSET, finish  # noqa: E402

# Weights of tensors of this size and larger are stored with 16 bits.
HALVED_FROM = 4_000
# Height and width of the input: pictures of 16:10, made small.
HEIGHT_PX, WIDTH_PX = 256, 416


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("model", type=Path)
    args = parser.parse_args()
    checkpoint = torch.load(args.checkpoint)
    network = Detector()
    network.load_state_dict(checkpoint["average"])
    network.eval()
    x = torch.randn(1, 3, HEIGHT_PX, WIDTH_PX)
    with warnings.catch_warnings():
        # The exporter by tracing says that there is a newer one, which needs more packages.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network,
            (x,),
            str(args.model),
            dynamo=False,
            opset_version=OPSET,
            input_names=["image"],
            output_names=["cells"],
        )
    operators = finish(args.model, HALVED_FROM)
    with torch.no_grad():
        difference = (OnnxDetector(args.model)(x) - network(x)).abs().max().item()
    if not difference < 2e-2:
        raise SystemExit(f"the exported detector differs by {difference}")
    print(
        f"{args.model}: {args.model.stat().st_size / 1e6:.2f} MB, {', '.join(operators)}; trained on"
        f" {checkpoint['frames']} pictures ({checkpoint['different']} different) in"
        f" {checkpoint['minutes']:.0f} minutes; differs from PyTorch by {difference:.1e}"
    )


if __name__ == "__main__":
    main()
