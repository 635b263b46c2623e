"""Exports the averaged weights of a checkpoint as ONNX.

    python export.py RUN/latest.pt farfield_hrnet.onnx
"""

import argparse
import warnings
from pathlib import Path

import numpy as np
import torch

from halving import OPSET, finish
from measure import OnnxNetwork
from network import Network, Shape

# Weights of tensors of this size and larger are stored with 16 bits.
HALVED_FROM = 50_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("model", type=Path)
    args = parser.parse_args()
    checkpoint = torch.load(args.checkpoint)
    shape = Shape(**checkpoint["shape"])
    network = Network(shape)
    network.load_state_dict(checkpoint["average"])
    network.eval()
    x = torch.randn(2, 3, shape.height_px, shape.width_px)
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
            output_names=["heatmap"],
            dynamic_axes={"image": {0: "n"}, "heatmap": {0: "n"}},
        )
    operators = finish(args.model, HALVED_FROM)
    with torch.no_grad():
        difference = (OnnxNetwork(args.model)(x) - network(x)).abs().max().item()
    if not difference < 5e-3:
        raise SystemExit(f"the exported network differs by {difference}")
    print(
        f"{args.model}: {args.model.stat().st_size / 1e6:.2f} MB, {', '.join(operators)}; trained on"
        f" {checkpoint['crops']} crops ({checkpoint['different']} different) in"
        f" {checkpoint['minutes']:.0f} minutes; differs from PyTorch by {np.format_float_scientific(difference, 1)}"
    )


if __name__ == "__main__":
    main()
