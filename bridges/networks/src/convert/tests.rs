//! Conversion of small graphs with every operator, and what damaged or unknown files cause.

use proptest::prelude::*;

use super::*;
use crate::fixture::{Field, Network, SMALL_MAPS, small};

const MAPS: HeatMaps = HeatMaps {
    shape: SMALL_MAPS,
    n_keypoints: 2,
};

fn refusal(network: &Network) -> String {
    heat_maps(&network.file(), MAPS).unwrap_err().to_string()
}

#[test]
fn what_the_maps_need_is_converted_and_the_rest_left_out() {
    let onnx = heat_maps(&small().file(), MAPS).unwrap();
    let operators = crate::onnx::operators(&onnx);
    let expected = [
        "Conv", "Clip", "Conv", "Relu", "Add", "Pad", "MaxPool", "Resize", "Relu", "Clip",
        "Sigmoid", "Conv", "Gather", "Sigmoid",
    ];
    assert_eq!(operators, expected);
}

#[test]
fn weights_are_permuted_by_axes() {
    let values: Vec<f32> = (0..24).map(|i| i as f32).collect();
    let (shape, permuted) = permuted(&values, [2, 3, 1, 4], [0, 3, 1, 2]);
    assert_eq!(shape, [2, 4, 3, 1]);
    // Element (1, 2, 1, 0) of the result is element (1, 1, 0, 2).
    assert_eq!(
        permuted[12 + 2 * 3 + 1].to_bits(),
        values[12 + 4 + 2].to_bits()
    );
}

#[test]
fn an_odd_cell_of_padding_is_below_and_right() {
    let window = |is_same| Window {
        kernel: [3, 5],
        strides: [2, 1],
        dilations: [1, 2],
        is_same,
    };
    // TensorFlow: an even side with stride 2 and kernel 3 needs one cell, at its end.
    assert_eq!(window(true).pads([256, 64]), [0, 4, 1, 4]);
    assert_eq!(window(false).pads([256, 64]), [0; 4]);
}

#[test]
fn an_unknown_operator_is_refused_by_name() {
    for (code, name) in [(25, "SOFTMAX"), (99, "number 99 of TensorFlow's schema")] {
        let mut network = small();
        let maps = network.outputs[1];
        let before = network.operator(code, &[maps], &[], [4, 4, 3]);
        let w = network.floats(&[3, 1, 1, 3], &[0.0; 9]);
        let options = [(0, Field::Byte(1)), (1, Field::Int(1)), (2, Field::Int(1))];
        let last = network.operator(3, &[before, w], &options, [4, 4, 3]);
        network.outputs = vec![last];
        let refused = refusal(&network);
        assert!(
            refused.contains(&format!("the operator {name}, ")),
            "{refused}"
        );
    }
}

#[test]
fn a_network_without_the_maps_is_refused_with_their_shape() {
    let mut network = small();
    network.outputs.pop();
    let refused = refusal(&network);
    assert!(
        refused.contains("no output of 4 x 4 x 3 numbers"),
        "{refused}"
    );
}

#[test]
fn wrong_forms_of_known_operators_are_refused() {
    let with_options = |index: usize, field: usize, value: Field| {
        let mut network = small();
        network.operators[index].3.push((field, value));
        refusal(&network)
    };
    // The operators 0 and 1 are DEQUANTIZE and CONV_2D.
    for (field, value, expected) in [
        (0, Field::Byte(9), "the padding 9, expected SAME or VALID"),
        (1, Field::Int(0), "0 as a stride, expected 1 to"),
        (
            3,
            Field::Byte(4),
            "the activation 4, expected none, RELU or RELU6",
        ),
        (4, Field::Int(-1), "-1 as a dilation"),
    ] {
        let refused = with_options(1, field, value);
        assert!(refused.contains(expected), "{refused}");
    }
    let mut network = small();
    network.operators.swap(1, 2);
    assert!(refusal(&network).contains("is used before an operator computes it"));
}

#[test]
fn other_files_are_refused_at_once() {
    for bytes in [&b""[..], b"TFL3", b"\x08\0\0\0ONNX\0\0\0\0"] {
        let refused = heat_maps(bytes, MAPS).unwrap_err();
        assert_eq!(refused, ConvertError::Tflite(TfliteError::OtherKind));
    }
}

proptest! {
    #[test]
    fn no_damaged_file_causes_a_panic_or_a_larger_result(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = small().file();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        for bytes in [&bytes[..], &bytes[..cut.index(bytes.len())]] {
            if let Ok(onnx) = heat_maps(bytes, MAPS) {
                prop_assert!(onnx.len() < 20 * bytes.len());
            }
        }
    }

    #[test]
    fn any_bytes_behind_the_head_are_read_or_refused(rest in prop::collection::vec(any::<u8>(), 0..200)) {
        let bytes = [&[8, 0, 0, 0], &b"TFL3"[..], &rest].concat();
        heat_maps(&bytes, MAPS).ok();
    }
}
