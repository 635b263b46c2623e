//! Reduction of an ONNX file to the outputs that are read, for `ort-tract`.
//!
//! Tract counts integers symbolically, and `ort` panics if a loaded session has such an output,
//! like `labels` of RTMDet. The other outputs are therefore removed from the graph before loading,
//! and `labels` gets an additional node that converts it to floats. Of the file's protobuf only the
//! necessary fields are parsed; all others are copied byte by byte.

/// The output of the classes in RTMDet's exports.
pub(super) const LABELS: &str = "labels";

/// Its replacement in [`reduced`]: the same classes as 32-bit floats, exact up to 2^24.
pub(super) const LABELS_AS_FLOATS: &str = "labels_as_floats";

// Field numbers of onnx.proto.
const MODEL_GRAPH: u64 = 7;
const GRAPH_NODE: u64 = 1;
const GRAPH_OUTPUT: u64 = 12;
const VALUE_NAME: u64 = 1;
const VALUE_TYPE: u64 = 2;
const TYPE_TENSOR: u64 = 1;
const TENSOR_ELEMENT: u64 = 1;
const NODE_INPUT: u64 = 1;
const NODE_OUTPUT: u64 = 2;
const NODE_OPERATOR: u64 = 4;
const NODE_ATTRIBUTE: u64 = 5;
const ATTRIBUTE_NAME: u64 = 1;
const ATTRIBUTE_INTEGER: u64 = 3;
const ATTRIBUTE_TYPE: u64 = 20;

/// `TensorProto.FLOAT`, 32 bits.
const FLOAT: u64 = 1;
/// `AttributeProto.INT`.
const INTEGER: u64 = 2;

/// `model` with only the outputs `needed` and [`LABELS_AS_FLOATS`]; `None` if it has no others, lacks
/// one of `needed`, or is no ONNX file.
pub(super) fn reduced(model: &[u8], needed: &[&str]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(model.len() + 128);
    let mut is_changed = false;
    for field in fields(model)? {
        if field.number == MODEL_GRAPH {
            let graph = reduced_graph(field.content?, needed)?;
            put(&mut out, MODEL_GRAPH, &graph);
            is_changed = true;
        } else {
            out.extend_from_slice(field.whole);
        }
    }
    is_changed.then_some(out)
}

fn reduced_graph(graph: &[u8], needed: &[&str]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(graph.len() + 128);
    let (mut n_found, mut has_others) = (0, false);
    for field in fields(graph)? {
        if field.number != GRAPH_OUTPUT {
            out.extend_from_slice(field.whole);
            continue;
        }
        let name = fields(field.content?)?
            .into_iter()
            .find(|f| f.number == VALUE_NAME)
            .and_then(|f| f.content);
        if needed.iter().any(|it| name == Some(it.as_bytes())) {
            out.extend_from_slice(field.whole);
            n_found += 1;
            continue;
        }
        has_others = true;
        if name == Some(LABELS.as_bytes()) {
            put(&mut out, GRAPH_NODE, &cast_of_labels());
            put(&mut out, GRAPH_OUTPUT, &float_labels());
        }
    }
    (n_found == needed.len() && has_others).then_some(out)
}

/// The node that converts the labels to floats.
fn cast_of_labels() -> Vec<u8> {
    let mut to = Vec::new();
    put(&mut to, ATTRIBUTE_NAME, b"to");
    put_integer(&mut to, ATTRIBUTE_INTEGER, FLOAT);
    put_integer(&mut to, ATTRIBUTE_TYPE, INTEGER);
    let mut node = Vec::new();
    put(&mut node, NODE_INPUT, LABELS.as_bytes());
    put(&mut node, NODE_OUTPUT, LABELS_AS_FLOATS.as_bytes());
    put(&mut node, NODE_OPERATOR, b"Cast");
    put(&mut node, NODE_ATTRIBUTE, &to);
    node
}

/// The output of that node, with an open shape.
fn float_labels() -> Vec<u8> {
    let (mut tensor, mut kind, mut value) = (Vec::new(), Vec::new(), Vec::new());
    put_integer(&mut tensor, TENSOR_ELEMENT, FLOAT);
    put(&mut kind, TYPE_TENSOR, &tensor);
    put(&mut value, VALUE_NAME, LABELS_AS_FLOATS.as_bytes());
    put(&mut value, VALUE_TYPE, &kind);
    value
}

/// One field of a protobuf message.
#[derive(Debug, PartialEq)]
struct ProtobufField<'a> {
    number: u64,
    /// With its number and length.
    whole: &'a [u8],
    /// For a text, bytes or an inner message.
    content: Option<&'a [u8]>,
}

/// All fields of a message in order; `None` if the data are no message.
fn fields(message: &[u8]) -> Option<Vec<ProtobufField<'_>>> {
    let mut found = Vec::new();
    let mut rest = message;
    while !rest.is_empty() {
        let start = rest;
        let tag = varint(&mut rest)?;
        let mut content = None;
        match tag & 7 {
            0 => {
                varint(&mut rest)?;
            }
            1 => rest = rest.get(8..)?,
            2 => {
                let length = usize::try_from(varint(&mut rest)?).ok()?;
                let (inner, after) = rest.split_at_checked(length)?;
                (content, rest) = (Some(inner), after);
            }
            5 => rest = rest.get(4..)?,
            _ => return None,
        }
        found.push(ProtobufField {
            number: tag >> 3,
            whole: &start[..start.len() - rest.len()],
            content,
        });
    }
    Some(found)
}

/// Removes a varint (7 bits per byte, the lowest first) from the front.
fn varint(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for shift in (0..64).step_by(7) {
        let (&byte, after) = rest.split_first()?;
        *rest = after;
        value |= u64::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

fn put(out: &mut Vec<u8>, number: u64, content: &[u8]) {
    put_varint(out, number << 3 | 2);
    put_varint(out, content.len() as u64);
    out.extend_from_slice(content);
}

fn put_integer(out: &mut Vec<u8>, number: u64, value: u64) {
    put_varint(out, number << 3);
    put_varint(out, value);
}

fn put_varint(out: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn chroma() -> Vec<u8> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/testdata/chroma_160.onnx");
        std::fs::read(path).unwrap()
    }

    fn output_names(model: &[u8]) -> Vec<String> {
        let mut names = Vec::new();
        for graph in fields(model).unwrap() {
            if graph.number != MODEL_GRAPH {
                continue;
            }
            for output in fields(graph.content.unwrap()).unwrap() {
                if output.number == GRAPH_OUTPUT {
                    let value = fields(output.content.unwrap()).unwrap();
                    names.push(String::from_utf8(value[0].content.unwrap().to_vec()).unwrap());
                }
            }
        }
        names
    }

    #[test]
    fn labels_become_floats_and_other_outputs_are_removed() {
        let model = chroma();
        assert_eq!(output_names(&model), ["dets", "labels"]);
        let less = reduced(&model, &["dets"]).unwrap();
        assert_eq!(output_names(&less), ["dets", LABELS_AS_FLOATS]);
        let less = reduced(&model, &[LABELS]).unwrap();
        assert_eq!(output_names(&less), [LABELS]);
        assert_eq!(
            reduced(&less, &[LABELS]),
            None,
            "nothing is left to take out"
        );
    }

    #[test]
    fn a_model_without_labels_is_unchanged() {
        assert_eq!(reduced(&chroma(), &["boxes"]), None);
        assert_eq!(reduced(b"", &["dets"]), None);
        assert_eq!(reduced(b"not a network\n", &["dets"]), None);
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in any::<prop::sample::Index>(), byte: u8, cut in any::<prop::sample::Index>()) {
            let mut model = chroma();
            let at = at.index(model.len());
            model[at] = byte;
            model.truncate(cut.index(model.len() + 1));
            if let Some(less) = reduced(&model, &["dets"]) {
                prop_assert!(fields(&less).is_some());
            }
        }
    }
}
