//! The messages of `onnx.proto` that a converted network needs. Names and field numbers are those of ONNX 1.14.

use prost::Message;

/// Version of the operators: the first with `Pad`, `Clip` and `Resize` in the form that is written here.
const OPSET: i64 = 13;
/// Version of the file format.
const IR_VERSION: i64 = 8;
/// `TensorProto.FLOAT`, 32 bits.
const FLOAT: i32 = 1;
/// `TensorProto.INT64`.
const INT64: i32 = 7;
/// `AttributeProto.INT`.
const ONE_NUMBER: i32 = 2;
/// `AttributeProto.STRING`.
const TEXT: i32 = 3;
/// `AttributeProto.INTS`.
const NUMBERS: i32 = 7;

#[derive(Clone, PartialEq, Message)]
struct ModelProto {
    #[prost(int64, tag = "1")]
    ir_version: i64,
    #[prost(string, tag = "2")]
    producer_name: String,
    #[prost(message, optional, tag = "7")]
    graph: Option<Graph>,
    #[prost(message, repeated, tag = "8")]
    opset_import: Vec<OperatorSet>,
}

#[derive(Clone, PartialEq, Message)]
struct OperatorSet {
    #[prost(string, tag = "1")]
    domain: String,
    #[prost(int64, tag = "2")]
    version: i64,
}

/// A graph under construction. Its image tensors are [batch, channel, row, column].
#[derive(Clone, PartialEq, Message)]
pub(crate) struct Graph {
    #[prost(message, repeated, tag = "1")]
    pub(crate) nodes: Vec<Node>,
    #[prost(string, tag = "2")]
    name: String,
    #[prost(message, repeated, tag = "5")]
    constants: Vec<Constant>,
    #[prost(message, repeated, tag = "11")]
    inputs: Vec<Value>,
    #[prost(message, repeated, tag = "12")]
    outputs: Vec<Value>,
}

/// How many images a network takes at once.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Batch {
    /// Any number.
    Any,
    /// One, for which some backends make a faster network.
    One,
}

/// One operator.
#[derive(Clone, PartialEq, Message)]
pub(crate) struct Node {
    #[prost(string, repeated, tag = "1")]
    inputs: Vec<String>,
    #[prost(string, repeated, tag = "2")]
    outputs: Vec<String>,
    #[prost(string, tag = "3")]
    name: String,
    #[prost(string, tag = "4")]
    pub(crate) operator: String,
    #[prost(message, repeated, tag = "5")]
    attributes: Vec<Attribute>,
}

#[derive(Clone, PartialEq, Message)]
struct Attribute {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(int64, optional, tag = "3")]
    int: Option<i64>,
    #[prost(bytes = "vec", optional, tag = "4")]
    text: Option<Vec<u8>>,
    #[prost(int64, repeated, packed = "false", tag = "8")]
    ints: Vec<i64>,
    #[prost(int32, tag = "20")]
    kind: i32,
}

/// A constant: the only large part of a file.
#[derive(Clone, PartialEq, Message)]
struct Constant {
    #[prost(int64, repeated, packed = "false", tag = "1")]
    shape: Vec<i64>,
    #[prost(int32, tag = "2")]
    elements: i32,
    #[prost(string, tag = "8")]
    name: String,
    #[prost(bytes = "vec", tag = "9")]
    data: Vec<u8>,
}

#[derive(Clone, PartialEq, Message)]
struct Value {
    #[prost(string, tag = "1")]
    name: String,
    #[prost(message, optional, tag = "2")]
    kind: Option<ValueKind>,
}

#[derive(Clone, PartialEq, Message)]
struct ValueKind {
    #[prost(message, optional, tag = "1")]
    tensor: Option<TensorKind>,
}

#[derive(Clone, PartialEq, Message)]
struct TensorKind {
    #[prost(int32, tag = "1")]
    elements: i32,
    #[prost(message, optional, tag = "2")]
    shape: Option<Shape>,
}

#[derive(Clone, PartialEq, Message)]
struct Shape {
    #[prost(message, repeated, tag = "1")]
    axes: Vec<Axis>,
}

#[derive(Clone, PartialEq, Message)]
struct Axis {
    #[prost(int64, optional, tag = "1")]
    size: Option<i64>,
    #[prost(string, optional, tag = "2")]
    name: Option<String>,
}

/// Sizes are far below the limit.
fn whole(size: usize) -> i64 {
    i64::try_from(size).unwrap_or(i64::MAX)
}

impl Node {
    /// The operator `operator` from `inputs` to `output`. An empty name is an input that is left out.
    pub(crate) fn new(operator: &str, inputs: &[&str], output: &str) -> Self {
        Self {
            inputs: inputs.iter().map(|&name| name.to_owned()).collect(),
            outputs: vec![output.to_owned()],
            name: format!("{operator}_{output}"),
            operator: operator.to_owned(),
            attributes: Vec::new(),
        }
    }

    /// With an attribute of several numbers.
    pub(crate) fn ints(mut self, name: &str, values: &[usize]) -> Self {
        self.attributes.push(Attribute {
            name: name.to_owned(),
            ints: values.iter().map(|&value| whole(value)).collect(),
            kind: NUMBERS,
            ..Attribute::default()
        });
        self
    }

    /// With an attribute of one number.
    pub(crate) fn int(mut self, name: &str, value: usize) -> Self {
        self.attributes.push(Attribute {
            name: name.to_owned(),
            int: Some(whole(value)),
            kind: ONE_NUMBER,
            ..Attribute::default()
        });
        self
    }

    /// With an attribute of text.
    pub(crate) fn text(mut self, name: &str, value: &str) -> Self {
        self.attributes.push(Attribute {
            name: name.to_owned(),
            text: Some(value.as_bytes().to_vec()),
            kind: TEXT,
            ..Attribute::default()
        });
        self
    }
}

impl Graph {
    /// An empty graph.
    pub(crate) fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            ..Self::default()
        }
    }

    /// Adds a constant of floats.
    pub(crate) fn floats(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        let data = values.iter().flat_map(|value| value.to_le_bytes());
        self.constant(name, shape, FLOAT, data.collect());
    }

    /// Adds a constant list of whole numbers.
    pub(crate) fn whole_numbers(&mut self, name: &str, values: &[i64]) {
        let data = values.iter().flat_map(|value| value.to_le_bytes());
        self.constant(name, &[values.len()], INT64, data.collect());
    }

    fn constant(&mut self, name: &str, shape: &[usize], elements: i32, data: Vec<u8>) {
        self.constants.push(Constant {
            shape: shape.iter().map(|&size| whole(size)).collect(),
            elements,
            name: name.to_owned(),
            data,
        });
    }

    /// Adds a node that keeps values from 0 to 6.
    pub(crate) fn clip(&mut self, input: &str, output: &str) {
        let (low, high) = (format!("{output}_low"), format!("{output}_high"));
        self.floats(&low, &[], &[0.0]);
        self.floats(&high, &[], &[6.0]);
        let node = Node::new("Clip", &[input, &low, &high], output);
        self.nodes.push(node);
    }

    /// Adds an input [batch, channel, row, column].
    pub(crate) fn input(&mut self, name: &str, batch: Batch, shape: [usize; 3]) {
        self.inputs.push(Value::floats(name, batch, &shape));
    }

    /// Adds an output [batch, ..].
    pub(crate) fn output(&mut self, name: &str, batch: Batch, shape: &[usize]) {
        self.outputs.push(Value::floats(name, batch, shape));
    }

    /// The file with this graph.
    pub(crate) fn into_file(self) -> Vec<u8> {
        let model = ModelProto {
            ir_version: IR_VERSION,
            producer_name: "farfield".to_owned(),
            graph: Some(self),
            opset_import: vec![OperatorSet {
                domain: String::new(),
                version: OPSET,
            }],
        };
        model.encode_to_vec()
    }
}

impl Value {
    fn floats(name: &str, batch: Batch, shape: &[usize]) -> Self {
        let batch = match batch {
            Batch::Any => Axis {
                size: None,
                name: Some("n".to_owned()),
            },
            Batch::One => Axis {
                size: Some(1),
                name: None,
            },
        };
        let sizes = shape.iter().map(|&size| Axis {
            size: Some(whole(size)),
            name: None,
        });
        let axes = std::iter::once(batch).chain(sizes).collect();
        Self {
            name: name.to_owned(),
            kind: Some(ValueKind {
                tensor: Some(TensorKind {
                    elements: FLOAT,
                    shape: Some(Shape { axes }),
                }),
            }),
        }
    }
}

/// The operators of a file, in order.
#[cfg(test)]
pub(crate) fn operators(file: &[u8]) -> Vec<String> {
    let graph = ModelProto::decode(file).ok().and_then(|model| model.graph);
    let nodes = graph.into_iter().flat_map(|graph| graph.nodes);
    nodes.map(|node| node.operator).collect()
}

/// The numbers of an attribute of the operator `index` of a file.
#[cfg(test)]
pub(crate) fn attribute(file: &[u8], index: usize, name: &str) -> Vec<i64> {
    let graph = ModelProto::decode(file).unwrap().graph.unwrap();
    let attributes = graph.nodes[index].attributes.iter();
    let mut named = attributes.filter(|it| it.name == name);
    let attribute = named.next().unwrap();
    attribute
        .int
        .map_or_else(|| attribute.ints.clone(), |it| vec![it])
}

/// Shape and numbers of a constant of a file.
#[cfg(test)]
pub(crate) fn constant(file: &[u8], name: &str) -> (Vec<i64>, Vec<f32>) {
    let graph = ModelProto::decode(file).unwrap().graph.unwrap();
    let mut named = graph.constants.into_iter().filter(|it| it.name == name);
    let constant = named.next().unwrap();
    let floats = constant.data.as_chunks().0.iter();
    let floats = floats.map(|&bytes| f32::from_le_bytes(bytes)).collect();
    (constant.shape, floats)
}
