"""Makes the networks of this folder: a few kB each, no training, the contract of HRNet.

A network of K maps sees K pure hues: keypoint k is wherever the picture has the hue 360 k / K degrees
at full saturation and value (red is keypoint 0). Per pixel c, its map is max(0, 1 - |c - c_k|^2 / r^2),
averaged over 8 x 8 pixels every 4 pixels, so that cell i is centred on input pixel 4 i + 1.5.
The SimCC network has the same hues, and the contract of RTMPose. Its pixels are averaged over
9 x 9; a distribution is the maximum over the other direction, with two bins per pixel.

    output "simcc_x" [N, K, 192], "simcc_y" [N, K, 256]  0 to 1; bin i is input pixel i / 2

Colours that no keypoint owns (black, grey, white, dark or pale hues) leave every map at zero.

    input  "image"    [N, 3, 128, 96]  RGB, 0 to 1
    output "heatmaps" [N, K, 32, 24]   0 to 1

The detector finds one person: the box of all pixels that are not grey, in the layout of RTMDet.

    input  "input" [1, 3, 160, 160] RGB, 0 to 1
    output "dets"  [1, 1, 5]  x0 y0 x1 y1 score (score 0: nothing there),  "labels" [1, 1]

Run: python3 make_networks.py (needs the packages onnx and numpy).
"""

import colorsys
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

HERE = Path(__file__).parent
RADIUS = 0.17  # half the distance of two hues of 17
OPSET = 13


def constant(name, values, dtype=np.float32):
    return numpy_helper.from_array(np.asarray(values, dtype=dtype), name)


def save(name, nodes, inputs, outputs, constants):
    graph = helper.make_graph(nodes, name, inputs, outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=8)
    model.producer_name = "make_networks.py"
    onnx.checker.check_model(model)
    onnx.save(model, HERE / f"{name}.onnx")


def matches(n):
    """Nodes from "image" to "pixels", the match of every pixel with every hue, and their constants."""
    colours = np.array([colorsys.hsv_to_rgb(k / n, 1, 1) for k in range(n)])
    gain = 1 / RADIUS**2
    # 1 - g |c - c_k|^2 = (1 - g |c_k|^2) + 2 g c_k . c - g |c|^2
    linear = (2 * gain * colours).reshape(n, 3, 1, 1)
    square = np.full((n, 3, 1, 1), -gain)
    bias = 1 - gain * (colours**2).sum(axis=1)
    nodes = [
        helper.make_node("Conv", ["image", "linear", "bias"], ["by_colour"], kernel_shape=[1, 1]),
        helper.make_node("Mul", ["image", "image"], ["squares"]),
        helper.make_node("Conv", ["squares", "square"], ["by_length"], kernel_shape=[1, 1]),
        helper.make_node("Add", ["by_colour", "by_length"], ["match"]),
        helper.make_node("Relu", ["match"], ["pixels"]),
    ]
    return nodes, [constant("linear", linear), constant("square", square), constant("bias", bias)]


def keypoint_network(name, n):
    nodes, constants = matches(n)
    nodes.append(helper.make_node(
        "AveragePool", ["pixels"], ["heatmaps"],
        kernel_shape=[8, 8], strides=[4, 4], pads=[2, 2, 2, 2], count_include_pad=1,
    ))
    inputs = [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", 3, 128, 96])]
    outputs = [helper.make_tensor_value_info("heatmaps", TensorProto.FLOAT, ["N", n, 32, 24])]
    save(name, nodes, inputs, outputs, constants)


def simcc_network(name, n):
    nodes, constants = matches(n)
    nodes.append(helper.make_node(
        "AveragePool", ["pixels"], ["smooth"],
        kernel_shape=[9, 9], strides=[1, 1], pads=[4, 4, 4, 4], count_include_pad=1,
    ))
    for way, axis in (("x", 2), ("y", 3)):
        nodes += [
            helper.make_node("ReduceMax", ["smooth"], [f"line_{way}"], axes=[axis], keepdims=0),
            # Bin 2 i is pixel i, bin 2 i + 1 the mean of pixels i and i + 1.
            helper.make_node(
                "ConvTranspose", [f"line_{way}", "between"], [f"simcc_{way}"],
                kernel_shape=[3], strides=[2], pads=[1, 0], group=n,
            ),
        ]
    inputs = [helper.make_tensor_value_info("image", TensorProto.FLOAT, ["N", 3, 128, 96])]
    outputs = [
        helper.make_tensor_value_info("simcc_x", TensorProto.FLOAT, ["N", n, 192]),
        helper.make_tensor_value_info("simcc_y", TensorProto.FLOAT, ["N", n, 256]),
    ]
    save(name, nodes, inputs, outputs, constants + [constant("between", [[[0.5, 1, 0.5]]] * n)])


def detector(name, size):
    ramp = np.arange(size, dtype=np.float32)
    nodes = [
        helper.make_node("ReduceMax", ["input"], ["highest"], axes=[1], keepdims=0),
        helper.make_node("ReduceMin", ["input"], ["lowest"], axes=[1], keepdims=0),
        helper.make_node("Sub", ["highest", "lowest"], ["chroma"]),  # [1, H, W]
        # 1 where the chroma is above a half, 0 below, without booleans
        helper.make_node("Sub", ["chroma", "half"], ["above"]),
        helper.make_node("Mul", ["above", "steep"], ["steeply"]),
        helper.make_node("Clip", ["steeply", "zero", "one"], ["seen"]),
        helper.make_node("ReduceMax", ["seen"], ["columns"], axes=[1], keepdims=0),  # [1, W]
        helper.make_node("ReduceMax", ["seen"], ["rows"], axes=[2], keepdims=0),
    ]
    corners = {}
    for line, low, high in (("columns", "x0", "x1"), ("rows", "y0", "y1")):
        nodes += [
            # last seen index: max of index x seen; first: size - 1 - max of (size - 1 - index) x seen
            helper.make_node("Mul", [line, "ramp"], [f"{line}_up"]),
            helper.make_node("ReduceMax", [f"{line}_up"], [high], axes=[1], keepdims=1),
            helper.make_node("Mul", [line, "ramp_down"], [f"{line}_down"]),
            helper.make_node("ReduceMax", [f"{line}_down"], [f"{low}_from_end"], axes=[1], keepdims=1),
            helper.make_node("Sub", ["last", f"{low}_from_end"], [low]),
        ]
        corners[line] = (low, high)
    nodes += [
        helper.make_node("ReduceMax", ["columns"], ["score"], axes=[1], keepdims=1),  # [1, 1]
        helper.make_node("Concat", ["x0", "y0", "x1", "y1", "score"], ["flat"], axis=1),
        helper.make_node("Unsqueeze", ["flat", "axis"], ["dets"]),
        helper.make_node("Mul", ["score", "zero"], ["no_label"]),
        helper.make_node("Cast", ["no_label"], ["labels"], to=TensorProto.INT64),
    ]
    inputs = [helper.make_tensor_value_info("input", TensorProto.FLOAT, [1, 3, size, size])]
    outputs = [
        helper.make_tensor_value_info("dets", TensorProto.FLOAT, [1, 1, 5]),
        helper.make_tensor_value_info("labels", TensorProto.INT64, [1, 1]),
    ]
    constants = [
        constant("ramp", ramp), constant("ramp_down", size - 1 - ramp), constant("last", [size - 1]),
        constant("half", [0.5]), constant("steep", [1e4]), constant("zero", 0.0), constant("one", 1.0),
        constant("axis", [1], np.int64),
    ]
    save(name, nodes, inputs, outputs, constants)


keypoint_network("hues17_128x96", 17)
keypoint_network("hues14_128x96", 14)
simcc_network("simcc17_128x96", 17)
detector("chroma_160", 160)
