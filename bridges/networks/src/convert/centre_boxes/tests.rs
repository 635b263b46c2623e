//! Conversion of a small graph with every operator, and what damaged or unknown files cause.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use half::f16;
use proptest::prelude::*;
use serde_json::{Value, json};

use super::*;
use crate::onnx::{attribute, constant, operators};

const BOXES_OF_SMALL: CentreBoxes = CentreBoxes {
    image: "image",
    centre: "centre",
    size: "size",
    offset: "offset",
    cells: 4,
    cell_px: 2,
    min_score: 0.25,
};

/// A graph model under construction.
struct Network {
    nodes: Vec<Value>,
    manifest: Vec<Value>,
    data: Vec<u8>,
}

impl Network {
    fn node(&mut self, operator: &str, name: &str, inputs: &[&str], attributes: Value) {
        let mut node = json!({ "name": name, "op": operator, "input": inputs });
        node["attr"] = attributes;
        self.nodes.push(node);
    }

    fn list(&mut self, entry: Value, bytes: impl IntoIterator<Item = u8>) {
        self.manifest.push(entry);
        self.data.extend(bytes);
    }

    /// Weights of 16 bits.
    fn halves(&mut self, name: &str, shape: &[usize]) {
        let quantization = json!({ "dtype": "float16", "original_dtype": "float32" });
        let entry = json!({ "name": name, "shape": shape, "dtype": "float32", "quantization": quantization });
        let n: usize = shape.iter().product();
        let values = (0..n).map(|i| f16::from_f32(i as f32 / 8.0).to_le_bytes());
        self.list(entry, values.flatten());
    }

    fn floats(&mut self, name: &str, shape: &[usize]) {
        let entry = json!({ "name": name, "shape": shape, "dtype": "float32" });
        let n: usize = shape.iter().product();
        self.list(entry, (0..n).flat_map(|i| (i as f32 / 8.0).to_le_bytes()));
    }

    fn ints(&mut self, name: &str, values: &[i32]) {
        let entry = json!({ "name": name, "shape": [values.len()], "dtype": "int32" });
        self.list(entry, values.iter().flat_map(|value| value.to_le_bytes()));
    }

    /// A convolution of one pixel with a bias.
    fn head(&mut self, name: &str, input: &str, to: usize) {
        let (w, b) = (format!("{name}/w"), format!("{name}/b"));
        self.floats(&w, &[1, 1, 4, to]);
        self.floats(&b, &[to]);
        let attributes = convolution(1, "VALID", &["BiasAdd"]);
        self.node("_FusedConv2D", name, &[input, &w, &b], attributes);
    }

    fn json(&self) -> Value {
        json!({
            "format": "graph-model",
            "modelTopology": { "node": self.nodes, "versions": { "producer": 808 } },
            "weightsManifest": [{ "paths": ["small.bin"], "weights": self.manifest }],
        })
    }

    fn convert(&self) -> Result<Vec<u8>, ConvertError> {
        convert(&self.json(), &self.data)
    }

    fn refusal(&self) -> String {
        self.convert().unwrap_err().to_string()
    }
}

fn convert(json: &Value, data: &[u8]) -> Result<Vec<u8>, ConvertError> {
    centre_boxes(json.to_string().as_bytes(), data, &BOXES_OF_SMALL)
}

fn convolution(stride: usize, padding: &str, fused: &[&str]) -> Value {
    let fused: Vec<String> = fused.iter().map(|it| STANDARD.encode(it)).collect();
    let steps =
        |side: usize| json!({ "list": { "i": ["1", side.to_string(), side.to_string(), "1"] } });
    json!({
        "strides": steps(stride),
        "dilations": steps(1),
        "padding": { "s": STANDARD.encode(padding) },
        "data_format": { "s": STANDARD.encode("NHWC") },
        "fused_ops": { "list": { "s": fused } },
        "explicit_paddings": { "list": {} },
        "epsilon": { "f": 0 },
        "T": { "type": "DT_FLOAT" },
    })
}

/// A network with every operator that is converted: an image of 8 x 8, and a grid of 4 x 4. It also has an operator that
/// is not converted, for another output.
fn small() -> Network {
    let mut net = Network {
        nodes: Vec::new(),
        manifest: Vec::new(),
        data: Vec::new(),
    };
    net.node("Sub", "image", &["input"], json!({}));
    net.halves("first/w", &[3, 3, 3, 4]);
    net.floats("first/b", &[4]);
    let attributes = convolution(2, "SAME", &["BiasAdd", "Relu6"]);
    net.node(
        "_FusedConv2D",
        "first",
        &["image:0", "first/w", "first/b"],
        attributes,
    );
    net.floats("each/w", &[3, 3, 4, 1]);
    net.floats("each/b", &[4]);
    let attributes = convolution(1, "SAME", &["BiasAdd", "Relu"]);
    net.node(
        "FusedDepthwiseConv2dNative",
        "each",
        &["first", "each/w", "each/b"],
        attributes,
    );
    net.node("AddV2", "sum", &["first", "each"], json!({}));
    let quantization = json!({ "dtype": "uint8", "scale": 0.5, "min": -1.0 });
    let entry = json!({ "name": "down/w", "shape": [3, 3, 4, 1], "dtype": "float32", "quantization": quantization });
    net.list(entry, 0..36);
    net.node(
        "DepthwiseConv2dNative",
        "down",
        &["sum", "down/w"],
        convolution(1, "VALID", &[]),
    );
    net.node("Shape", "shape", &["down"], json!({}));
    for (name, values) in [
        ("from", &[1][..]),
        ("to", &[3]),
        ("by", &[1]),
        ("twice", &[2, 2]),
    ] {
        net.ints(name, values);
    }
    net.node(
        "StridedSlice",
        "sides",
        &["shape", "from", "to", "by"],
        json!({}),
    );
    net.node("Mul", "sides twice", &["sides", "twice"], json!({}));
    let half_pixel =
        json!({ "half_pixel_centers": { "b": true }, "align_corners": { "b": false } });
    net.node("ResizeBilinear", "up", &["down", "sides twice"], half_pixel);
    net.node("AddV2", "all", &["up", "sum"], json!({}));
    for (name, to) in [("centre", 1), ("size", 2), ("offset", 2)] {
        net.head(name, "all", to);
    }
    net.node("Softmax", "other", &["all"], json!({}));
    net
}

#[test]
fn the_grid_is_converted_and_the_rest_left_out() {
    let onnx = small().convert().unwrap();
    let of_graph = [
        "Conv", "Clip", "Conv", "Relu", "Add", "Conv", "Resize", "Add", "Conv", "Conv", "Conv",
    ];
    let of_boxes = [
        "Sigmoid",
        "Mul",
        "Add",
        "Add",
        "Mul",
        "Relu",
        "Mul",
        "Sub",
        "Add",
        "Concat",
        "Gather",
        "Reshape",
        "Transpose",
    ];
    assert_eq!(operators(&onnx), [&of_graph[..], &of_boxes].concat());
    // The kernel of 3 with stride 2 on 8 pixels needs one cell, below and right.
    assert_eq!(attribute(&onnx, 0, "pads"), [0, 0, 1, 1]);
    assert_eq!(attribute(&onnx, 2, "pads"), [1; 4]);
    assert_eq!(attribute(&onnx, 5, "pads"), [0; 4]);
    assert_eq!([0, 2].map(|i| attribute(&onnx, i, "group")), [[1], [4]]);
}

#[test]
fn constants_keep_their_values_in_the_order_of_onnx() {
    let onnx = small().convert().unwrap();
    let (shape, values) = constant(&onnx, "t1_weights");
    assert_eq!(shape, [4, 3, 3, 3]);
    // Row 2, column 1, input 2, output 3 of [3, 3, 3, 4].
    let from = ((2 * 3 + 1) * 3 + 2) * 4 + 3;
    let at = ((3 * 3 + 2) * 3 + 2) * 3 + 1;
    assert_eq!(values[at].to_bits(), (from as f32 / 8.0).to_bits());
    // Steps of 0.5 from -1; row 1, column 2, channel 3 of [3, 3, 4, 1].
    let (shape, values) = constant(&onnx, "t4_weights");
    assert_eq!(shape, [4, 1, 3, 3]);
    assert_eq!(
        values[3 * 9 + 3 + 2].to_bits(),
        (0.5_f32 * 23.0 - 1.0).to_bits()
    );
    let (shape, places) = constant(&onnx, "cell_places");
    assert_eq!(shape, [1, 2, 4, 4]);
    assert_eq!(
        [places[6], places[16 + 6]].map(f32::to_bits),
        [1.0_f32, 2.0].map(f32::to_bits)
    );
    let (_, scales) = constant(&onnx, "t5_scales");
    assert_eq!(scales, [1.0, 1.0, 2.0, 2.0]);
    let [slope, at_zero] = ["score_slope", "score_at_zero"].map(|name| constant(&onnx, name).1[0]);
    assert!((slope * 0.25 + at_zero - 0.3).abs() < 1e-6 && (slope + at_zero - 1.0).abs() < 1e-6);
}

#[test]
fn an_unknown_operator_is_refused_with_its_node() {
    let mut network = small();
    network.node("Softmax", "late", &["all"], json!({}));
    network.head("next", "late", 1);
    let boxes = CentreBoxes {
        centre: "next",
        ..BOXES_OF_SMALL
    };
    let json = network.json().to_string();
    let error = centre_boxes(json.as_bytes(), &network.data, &boxes).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the node late is the operator Softmax, which is not converted"
    );
}

#[test]
fn missing_nodes_and_weights_are_refused_by_name() {
    let mut network = small();
    network.nodes.retain(|node| node["name"] != "each");
    assert_eq!(network.refusal(), "the graph has no node each");
    let mut network = small();
    network.manifest[0]["name"] = json!("other");
    let refused = network.refusal();
    assert_eq!(
        refused,
        "the manifest has no weights first/w, which the node first uses"
    );
    let mut network = small();
    network.data.pop();
    let (found, expected) = (network.data.len(), network.data.len() + 1);
    let size = format!("found {found} bytes of weights, expected the {expected} of the manifest");
    assert_eq!(network.refusal(), size);
}

#[test]
fn a_wrong_manifest_is_refused() {
    for (field, value, expected) in [
        (
            "dtype",
            json!("string"),
            "the weights first/b are of string, expected float32, int32 or bool",
        ),
        (
            "shape",
            json!([usize::MAX, 2]),
            "less than the memory of a machine",
        ),
        (
            "quantization",
            json!({ "dtype": "uint16" }),
            "float32 stored as uint16, expected a scale",
        ),
        (
            "quantization",
            json!({ "dtype": "int4" }),
            "float32 stored as int4, expected float32 stored as",
        ),
        (
            "shape",
            json!("4"),
            "found no graph model of TensorFlow.js: invalid type",
        ),
    ] {
        let mut network = small();
        network.manifest[1][field] = value;
        let refused = network.refusal();
        assert!(refused.contains(expected), "{refused}");
    }
    let mut json = small().json();
    json["weightsManifest"][0]["paths"] = json!(["1.bin", "2.bin"]);
    let refused = convert(&json, &small().data).unwrap_err().to_string();
    assert_eq!(refused, "the manifest lists 2 files of weights, expected 1");
}

#[test]
fn a_large_json_file_is_refused_at_once() {
    let json = vec![b' '; (4 << 20) + 1];
    let refused = centre_boxes(&json, b"", &BOXES_OF_SMALL).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "found 4194305 bytes of JSON, expected at most 4194304"
    );
}

#[test]
fn wrong_forms_of_known_operators_are_refused() {
    let text = |text: &str| json!({ "s": STANDARD.encode(text) });
    let steps = |side: &str| json!({ "list": { "i": ["1", side, side, "1"] } });
    let fused = |name: &str| json!({ "list": { "s": [STANDARD.encode("BiasAdd"), STANDARD.encode(name)] } });
    for (node, attribute, value, expected) in [
        (
            1,
            "padding",
            text("EXPLICIT"),
            "the node first (_FusedConv2D) has the padding \"EXPLICIT\"",
        ),
        (
            1,
            "padding",
            json!({ "s": "?" }),
            "the text \"?\", expected text in base 64",
        ),
        (
            1,
            "data_format",
            text("NCHW"),
            "the order of axes \"NCHW\", expected NHWC",
        ),
        (
            1,
            "strides",
            steps("0"),
            "strides [1, 0, 0, 1], expected [1, rows, columns, 1]",
        ),
        (1, "strides", steps("4096"), "a window of 3 cells for 1"),
        (1, "dilations", json!({}), "dilations [], expected"),
        (
            1,
            "fused_ops",
            fused("Elu"),
            "fused_ops [\"BiasAdd\", \"Elu\"], expected none",
        ),
        (
            4,
            "dilations",
            steps("2"),
            "a window of 5 cells for 4, expected a window inside",
        ),
        (
            8,
            "half_pixel_centers",
            json!({ "b": false }),
            "half_pixel_centers alone",
        ),
    ] {
        let mut network = small();
        network.nodes[node]["attr"][attribute] = value;
        let refused = network.refusal();
        assert!(refused.contains(expected), "{attribute}: {refused}");
    }
}

#[test]
fn a_resize_to_a_size_that_is_not_constant_is_refused() {
    let mut network = small();
    network.nodes[7]["op"] = json!("FloorDiv");
    let refused = network.refusal();
    assert!(
        refused.contains("the size sides twice, expected a constant size"),
        "{refused}"
    );
    let mut network = small();
    network.nodes[5]["input"] = json!(["sum"]);
    assert!(network.refusal().contains("the size sides twice"));
    let mut network = small();
    network.ints("constant", &[4, 4]);
    network.nodes[8]["input"] = json!(["down", "constant"]);
    assert!(network.convert().is_ok());
}

#[test]
fn a_ring_of_nodes_is_refused() {
    let mut network = small();
    network.nodes[3]["input"] = json!(["first", "all"]);
    assert!(network.refusal().ends_with("depends on itself"));
}

#[test]
fn a_grid_of_another_shape_is_refused() {
    let mut network = small();
    network.node("AddV2", "size", &["all", "all"], json!({}));
    assert_eq!(
        network.refusal(),
        "the node size has [4, 4, 4] numbers, expected [2, 4, 4] (channels, rows, columns)"
    );
}

/// Replaces the value `index` of all numbers, texts and flags in `json`.
fn replace(json: &mut Value, index: &mut usize, by: &Value) {
    match json {
        Value::Array(values) => values.iter_mut().for_each(|it| replace(it, index, by)),
        Value::Object(fields) => fields.values_mut().for_each(|it| replace(it, index, by)),
        value if *index == 0 => {
            *value = by.clone();
            *index = usize::MAX;
        }
        _ => *index = index.saturating_sub(1),
    }
}

fn any_value() -> impl Strategy<Value = Value> {
    let number = prop_oneof![0_u64..5, Just(1 << 32), Just(1 << 62), any::<u64>()];
    let names = [
        "first",
        "all",
        "sides",
        "sum",
        "image",
        "Mul",
        "AddV2",
        "ResizeBilinear",
        "Conv2D",
        "float32",
    ];
    let text = prop_oneof![
        prop::sample::select(names.to_vec()).prop_map(str::to_owned),
        any::<String>(),
        any::<u64>().prop_map(|it| it.to_string()),
    ];
    prop_oneof![
        Just(json!(null)),
        any::<bool>().prop_map(|it| json!(it)),
        any::<f64>().prop_map(|it| json!(it)),
        number.prop_map(|it| json!(it)),
        text.prop_map(|it| json!(it)),
        prop::collection::vec(0_u64..4, 0..5).prop_map(|it| json!(it)),
    ]
}

proptest! {
    #[test]
    fn no_changed_graph_causes_a_panic_or_a_larger_result(
        changes in prop::collection::vec((0_usize..400, any_value()), 1..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let mut json = small().json();
        for (mut index, value) in changes {
            replace(&mut json, &mut index, &value);
        }
        let mut data = small().data;
        if let Some(cut) = cut {
            data.truncate(cut.index(data.len()));
        }
        if let Ok(onnx) = convert(&json, &data) {
            prop_assert!(onnx.len() < 8 * (json.to_string().len() + data.len()));
        }
    }

    #[test]
    fn no_damaged_file_causes_a_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = small().json().to_string().into_bytes();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        centre_boxes(&bytes, &small().data, &BOXES_OF_SMALL).ok();
        centre_boxes(&bytes[..cut.index(bytes.len())], &small().data, &BOXES_OF_SMALL).ok();
    }

    #[test]
    fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(centre_boxes(&bytes, &bytes, &BOXES_OF_SMALL).is_err());
    }
}
