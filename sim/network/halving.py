"""What all exports share."""

from pathlib import Path

import numpy as np
import onnx
from onnx import helper, numpy_helper

# Read by tract 0.23 and by every ONNX Runtime of the last years.
OPSET = 13


def halve(model: onnx.ModelProto, smallest: int) -> None:
    """Stores weights of at least `smallest` numbers with 16 bits, each widened by a node of its own.

    Runtimes make 32 bits of them when they load the file.
    """
    casts = []
    for weights in model.graph.initializer:
        values = numpy_helper.to_array(weights)
        if values.size < smallest or values.dtype != np.float32:
            continue
        name = weights.name
        weights.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}.half"))
        casts.append(helper.make_node("Cast", [f"{name}.half"], [name], to=onnx.TensorProto.FLOAT))
    nodes = casts + list(model.graph.node)
    del model.graph.node[:]
    model.graph.node.extend(nodes)


def finish(path: Path, smallest: int) -> list[str]:
    """Rewrites an exported file with halved weights; returns the names of its operators."""
    model = onnx.load(path)
    for node in model.graph.node:
        # The exporter keeps the paths of the sources here.
        node.ClearField("doc_string")
    halve(model, smallest)
    onnx.checker.check_model(model)
    onnx.save(model, path)
    return sorted({node.op_type for node in model.graph.node})
