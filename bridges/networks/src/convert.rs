//! Converts networks to ONNX: here the part of a TFLite graph that draws heat maps, in [`centre_boxes`] detectors.
//!
//! TFLite stores images as [batch, row, column, channel], ONNX as [batch, channel, row, column]; constants are permuted
//! accordingly. Weights of 16 bits become floats of 32 bits, with the same values. Operators that the maps do not depend
//! on are left out.

mod centre_boxes;
mod tfjs;

use half::f16;
use thiserror::Error;

use crate::onnx::{Batch, Graph, Node};
use crate::tfjs::TfjsError;
use crate::tflite::{Elements, Model, Operator, Table, Tensor, TfliteError};

pub use self::centre_boxes::{BOXES, CentreBoxes, centre_boxes};

/// Name of the converted network's input.
pub const INPUT: &str = "image";
/// Name of its output.
pub const OUTPUT: &str = "heatmaps";

/// Largest size of all converted weights relative to the file: those of 16 bits double.
const MAX_GROWTH: usize = 4;
/// Bytes of a 32-bit float.
const FLOAT_BYTES: usize = 4;
const NO_PRODUCER: u32 = u32::MAX;

// The schema's `BuiltinOperator`.
const ADD: i32 = 0;
const CONV_2D: i32 = 3;
const DEPTHWISE_CONV_2D: i32 = 4;
const DEQUANTIZE: i32 = 6;
const LOGISTIC: i32 = 14;
const MAX_POOL_2D: i32 = 17;
const RELU: i32 = 19;
const RELU6: i32 = 21;
const RESIZE_BILINEAR: i32 = 23;
const PAD: i32 = 34;

/// Names of operators for errors, where they differ from the schema's number.
const NAMES: [(i32, &str); 14] = [
    (ADD, "ADD"),
    (1, "AVERAGE_POOL_2D"),
    (2, "CONCATENATION"),
    (CONV_2D, "CONV_2D"),
    (DEPTHWISE_CONV_2D, "DEPTHWISE_CONV_2D"),
    (DEQUANTIZE, "DEQUANTIZE"),
    (9, "FULLY_CONNECTED"),
    (LOGISTIC, "LOGISTIC"),
    (MAX_POOL_2D, "MAX_POOL_2D"),
    (18, "MUL"),
    (22, "RESHAPE"),
    (RESIZE_BILINEAR, "RESIZE_BILINEAR"),
    (25, "SOFTMAX"),
    (PAD, "PAD"),
];

/// Which output of a TFLite graph has the heat maps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeatMaps {
    /// Rows, columns and channels of that output; no other output has them.
    pub shape: [usize; 3],
    /// The first channels are the maps of the keypoints, as logits.
    pub n_keypoints: usize,
}

/// Why a file cannot be converted.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ConvertError {
    /// The file cannot be read.
    #[error(transparent)]
    Tflite(#[from] TfliteError),
    /// The files of a graph model cannot be read, or not be converted.
    #[error(transparent)]
    Tfjs(#[from] TfjsError),
    /// The conversion takes another number of files.
    #[error("found {found} files, expected {expected}")]
    Files {
        /// Their number.
        found: usize,
        /// The number that the conversion takes.
        expected: usize,
    },
    /// An operator without a counterpart here.
    #[error("the network has the operator {operator}, which is not converted")]
    Operator {
        /// Its name, or its number in TensorFlow's schema.
        operator: String,
    },
    /// A known operator in an unknown form.
    #[error("the network has the operator {operator} with {found}, expected {expected}")]
    Form {
        /// Its name.
        operator: String,
        /// What was found.
        found: String,
        /// What is converted.
        expected: &'static str,
    },
    /// No output has the shape of the maps.
    #[error(
        "the network has no output of {rows} x {columns} x {channels} numbers (rows, columns, channels)"
    )]
    NoMaps {
        /// Expected rows.
        rows: usize,
        /// Expected columns.
        columns: usize,
        /// Expected channels.
        channels: usize,
    },
    /// The operators are not in the order of their results.
    #[error("tensor {tensor} is used before an operator computes it")]
    Order {
        /// Index of the tensor.
        tensor: usize,
    },
    /// The weights are used so often that the result would be far larger than the file.
    #[error("the converted weights exceed {limit} bytes")]
    Large {
        /// The limit, bytes.
        limit: usize,
    },
}

/// Converts the part of the TFLite file `bytes` that draws `maps` to an ONNX file.
///
/// Its input [`INPUT`] is [n, 3, rows, columns] with colours from 0 to 1. Its output [`OUTPUT`] is [n, keypoints, rows,
/// columns], after a sigmoid.
///
/// # Errors
/// [`ConvertError`] for a damaged file, and for a network that this module does not know.
pub fn heat_maps(bytes: &[u8], maps: HeatMaps) -> Result<Vec<u8>, ConvertError> {
    let model = Model::read(bytes)?;
    let input = model.input()?;
    let goal = goal(&model, maps)?;
    let producers = producers(&model)?;
    let needed = needed(&model, &producers, input, goal)?;
    let mut conversion = Conversion {
        graph: Graph::new("heat maps"),
        weights_left: MAX_GROWTH * model.file_bytes,
        is_computed: vec![false; model.n_tensors()],
        model,
        producers,
        input,
    };
    let [rows, columns, channels] = model.tensor(input)?.image_shape()?;
    let shape = [channels, rows, columns];
    conversion.graph.input(INPUT, Batch::Any, shape);
    if let Some(is_computed) = conversion.is_computed.get_mut(input) {
        *is_computed = true;
    }
    for (index, _) in needed
        .iter()
        .enumerate()
        .filter(|(_, is_needed)| **is_needed)
    {
        conversion.operator(&model.operator(index)?)?;
    }
    conversion.finish(goal, maps)
}

/// The output with the maps.
fn goal(model: &Model<'_>, maps: HeatMaps) -> Result<usize, ConvertError> {
    let [rows, columns, channels] = maps.shape;
    for output in model.outputs() {
        // Outputs of another number of axes are not images.
        let shape = model.tensor(output)?.image_shape();
        if shape.is_ok_and(|shape| shape == maps.shape) && maps.n_keypoints <= channels {
            return Ok(output);
        }
    }
    Err(ConvertError::NoMaps {
        rows,
        columns,
        channels,
    })
}

/// The operator that computes each tensor.
fn producers(model: &Model<'_>) -> Result<Vec<u32>, ConvertError> {
    let mut producers = vec![NO_PRODUCER; model.n_tensors()];
    for index in 0..model.n_operators() {
        let output = model.operator(index)?.output()?;
        if let Some(producer) = producers.get_mut(output) {
            *producer = index as u32;
        }
    }
    Ok(producers)
}

/// Whether each operator is needed to compute the tensor `goal` from the tensor `input`.
fn needed(
    model: &Model<'_>,
    producers: &[u32],
    input: usize,
    goal: usize,
) -> Result<Vec<bool>, ConvertError> {
    let mut needed = vec![false; model.n_operators()];
    let mut waiting = vec![goal];
    while let Some(tensor) = waiting.pop() {
        let producer = producers.get(tensor).copied().unwrap_or(NO_PRODUCER);
        if tensor == input || producer == NO_PRODUCER {
            continue;
        }
        let operator = model.operator(producer as usize)?;
        let is_needed = &mut needed[producer as usize];
        // The weights of 16 bits behind it are read where they are used.
        if !*is_needed && operator.code != DEQUANTIZE {
            *is_needed = true;
            // Constants among them have no producer.
            waiting.extend((0..3).filter_map(|i| operator.optional_input(i)));
        }
    }
    Ok(needed)
}

struct Conversion<'a> {
    model: Model<'a>,
    graph: Graph,
    producers: Vec<u32>,
    /// Whether a node or the input gives each tensor its value so far.
    is_computed: Vec<bool>,
    input: usize,
    /// Bytes of weights that may still be added.
    weights_left: usize,
}

impl Conversion<'_> {
    /// The name of a computed tensor.
    fn name(&self, tensor: usize) -> Result<String, ConvertError> {
        if self.is_computed.get(tensor) != Some(&true) {
            return Err(ConvertError::Order { tensor });
        }
        Ok(if tensor == self.input {
            INPUT.to_owned()
        } else {
            named(tensor)
        })
    }

    fn operator(&mut self, operator: &Operator<'_>) -> Result<(), ConvertError> {
        match operator.code {
            CONV_2D | DEPTHWISE_CONV_2D => self.convolution(operator),
            ADD => self.add(operator),
            MAX_POOL_2D => self.max_pool(operator),
            PAD => self.pad(operator),
            RESIZE_BILINEAR => self.resize(operator),
            LOGISTIC => self.plain(operator, "Sigmoid"),
            RELU => self.plain(operator, "Relu"),
            RELU6 => {
                let input = self.name(operator.input(0)?)?;
                let output = operator.output()?;
                self.graph.clip(&input, &named(output));
                self.computed(output);
                Ok(())
            }
            code => Err(ConvertError::Operator {
                operator: operator_name(code),
            }),
        }
    }

    /// An operator with one input and without options.
    fn plain(&mut self, operator: &Operator<'_>, name: &str) -> Result<(), ConvertError> {
        let input = self.name(operator.input(0)?)?;
        let output = operator.output()?;
        let node = Node::new(name, &[&input], &named(output));
        self.graph.nodes.push(node);
        self.computed(output);
        Ok(())
    }

    fn convolution(&mut self, operator: &Operator<'_>) -> Result<(), ConvertError> {
        let is_depthwise = operator.code == DEPTHWISE_CONV_2D;
        // The options of the depthwise form have the multiplier of channels as field 3.
        let after = usize::from(is_depthwise);
        let options = operator.options()?;
        let input = operator.input(0)?;
        let name = self.name(input)?;
        let [rows, columns, channels] = self.model.tensor(input)?.image_shape()?;
        let (tensor, weights) = self.constant(operator.input(1)?)?;
        let shape = tensor.shape_of_four()?;
        let [first, kernel_rows, kernel_columns, last] = shape;
        let kernel = [kernel_rows, kernel_columns];
        let fits = if is_depthwise {
            first == 1 && last % channels == 0
        } else {
            last == channels
        };
        if !fits {
            return Err(form(
                operator,
                format!("weights {shape:?} for {channels} channels"),
                "weights of all channels",
            ));
        }
        // [out, row, column, in] and [1, row, column, out] become [out, in, row, column] and [out, 1, row, column].
        let order = if is_depthwise {
            [3, 0, 1, 2]
        } else {
            [0, 3, 1, 2]
        };
        let output = operator.output()?;
        let stem = named(output);
        let (w, b) = (format!("{stem}_weights"), format!("{stem}_bias"));
        let (to, values) = permuted(&weights, shape, order);
        self.graph.floats(&w, &to, &values);
        let mut inputs = vec![name.as_str(), w.as_str()];
        if let Some(bias) = operator.optional_input(2) {
            let (_, values) = self.constant(bias)?;
            if values.len() != to[0] {
                let found = format!("{} biases for {} channels", values.len(), to[0]);
                return Err(form(operator, found, "one bias per channel"));
            }
            self.graph.floats(&b, &[values.len()], &values);
            inputs.push(&b);
        }
        let window = Window {
            kernel,
            strides: strides(&options)?,
            dilations: [
                options.side(5 + after, 1, "a dilation")?,
                options.side(4 + after, 1, "a dilation")?,
            ],
            is_same: is_same(operator, &options)?,
        };
        let activation = Activation::read(operator, options.byte(3 + after)?)?;
        let before = activation.name_before(output);
        let node = Node::new("Conv", &inputs, &before)
            .ints("kernel_shape", &kernel)
            .ints("strides", &window.strides)
            .ints("dilations", &window.dilations)
            .ints("pads", &window.pads([rows, columns]))
            .int("group", if is_depthwise { channels } else { 1 });
        self.graph.nodes.push(node);
        self.activate(activation, &before, output);
        Ok(())
    }

    fn add(&mut self, operator: &Operator<'_>) -> Result<(), ConvertError> {
        let [one, other] = [operator.input(0)?, operator.input(1)?];
        let shapes = [one, other].map(|it| self.model.tensor(it).and_then(|it| it.shape_of_four()));
        let [shape, other_shape] = shapes;
        if shape? != other_shape? {
            let found = "tensors of different shapes".to_owned();
            return Err(form(operator, found, "equal shapes"));
        }
        let (one, other) = (self.name(one)?, self.name(other)?);
        let activation = Activation::read(operator, operator.options()?.byte(0)?)?;
        let output = operator.output()?;
        let before = activation.name_before(output);
        let node = Node::new("Add", &[&one, &other], &before);
        self.graph.nodes.push(node);
        self.activate(activation, &before, output);
        Ok(())
    }

    fn max_pool(&mut self, operator: &Operator<'_>) -> Result<(), ConvertError> {
        let options = operator.options()?;
        let input = operator.input(0)?;
        let name = self.name(input)?;
        let [rows, columns, _] = self.model.tensor(input)?.image_shape()?;
        let window = Window {
            kernel: [
                options.side(4, 0, "a height of a window")?,
                options.side(3, 0, "a width of a window")?,
            ],
            strides: strides(&options)?,
            dilations: [1, 1],
            is_same: is_same(operator, &options)?,
        };
        let activation = Activation::read(operator, options.byte(5)?)?;
        let output = operator.output()?;
        let before = activation.name_before(output);
        let node = Node::new("MaxPool", &[&name], &before)
            .ints("kernel_shape", &window.kernel)
            .ints("strides", &window.strides)
            .ints("pads", &window.pads([rows, columns]));
        self.graph.nodes.push(node);
        self.activate(activation, &before, output);
        Ok(())
    }

    fn pad(&mut self, operator: &Operator<'_>) -> Result<(), ConvertError> {
        let name = self.name(operator.input(0)?)?;
        let sizes = self.whole_numbers(operator, 8)?;
        // [before, after] of batch, row, column, channel.
        let of = |side: usize| [0, 3, 1, 2].map(|axis| i64::from(sizes[2 * axis + side]));
        let output = operator.output()?;
        let pads = format!("{}_pads", named(output));
        self.graph.whole_numbers(&pads, &[of(0), of(1)].concat());
        let node = Node::new("Pad", &[&name, &pads], &named(output));
        self.graph.nodes.push(node);
        self.computed(output);
        Ok(())
    }

    fn resize(&mut self, operator: &Operator<'_>) -> Result<(), ConvertError> {
        let options = operator.options()?;
        let input = operator.input(0)?;
        let name = self.name(input)?;
        let [rows, columns, _] = self.model.tensor(input)?.image_shape()?;
        let to = self.whole_numbers(operator, 2)?;
        if to.iter().any(|&side| side < 1) {
            let found = format!("the size {to:?}");
            return Err(form(operator, found, "a size of at least 1 x 1"));
        }
        let mode = match (options.byte(2)?, options.byte(3)?) {
            (0, 0) => "asymmetric",
            (0, _) => "half_pixel",
            _ => "align_corners",
        };
        let output = operator.output()?;
        let scales = format!("{}_scales", named(output));
        let factors = [
            1.0,
            1.0,
            to[0] as f32 / rows as f32,
            to[1] as f32 / columns as f32,
        ];
        self.graph.floats(&scales, &[4], &factors);
        let node = Node::new("Resize", &[&name, "", &scales], &named(output))
            .text("mode", "linear")
            .text("coordinate_transformation_mode", mode);
        self.graph.nodes.push(node);
        self.computed(output);
        Ok(())
    }

    /// Applies an activation to the result `before`, and marks `output` as computed.
    fn activate(&mut self, activation: Activation, before: &str, output: usize) {
        match activation {
            Activation::None => {}
            Activation::Relu => {
                let node = Node::new("Relu", &[before], &named(output));
                self.graph.nodes.push(node);
            }
            Activation::Relu6 => self.graph.clip(before, &named(output)),
        }
        self.computed(output);
    }

    fn computed(&mut self, output: usize) {
        if let Some(is_computed) = self.is_computed.get_mut(output) {
            *is_computed = true;
        }
    }

    /// A constant of floats, also one of 16 bits behind an operator that converts it.
    fn constant(&mut self, tensor: usize) -> Result<(Tensor<'_>, Vec<f32>), ConvertError> {
        let stated = self.model.tensor(tensor)?;
        let producer = self.producers.get(tensor).copied();
        let stored = match producer.filter(|&it| it != NO_PRODUCER) {
            None => stated,
            Some(producer) => {
                let operator = self.model.operator(producer as usize)?;
                if operator.code != DEQUANTIZE {
                    return Err(form(&operator, "weights".to_owned(), "constant weights"));
                }
                self.model.tensor(operator.input(0)?)?
            }
        };
        let n = match stored.elements {
            Elements::Float32 => stored.data.len() / 4,
            Elements::Float16 => stored.data.len() / 2,
            _ => 0,
        };
        let expected = stated.n_elements()?;
        if n != expected {
            return Err(ConvertError::Form {
                operator: format!("of tensor {tensor}"),
                found: format!("{n} numbers of {:?}", stored.elements),
                expected: "as many floats of 32 or 16 bits as its shape has",
            });
        }
        let left = self.weights_left.checked_sub(n * FLOAT_BYTES);
        self.weights_left = left.ok_or(ConvertError::Large {
            limit: MAX_GROWTH * self.model.file_bytes,
        })?;
        let values = if stored.elements == Elements::Float16 {
            let halves = stored.data.as_chunks().0.iter();
            let halves = halves.map(|&bytes| f16::from_le_bytes(bytes));
            halves.map(f16::to_f32).collect()
        } else {
            let floats = stored.data.as_chunks().0.iter();
            floats.map(|&bytes| f32::from_le_bytes(bytes)).collect()
        };
        Ok((stated, values))
    }

    /// The constant second input, `n` whole numbers.
    fn whole_numbers(&self, operator: &Operator<'_>, n: usize) -> Result<Vec<i32>, ConvertError> {
        let tensor = self.model.tensor(operator.input(1)?)?;
        if tensor.elements != Elements::Int32 || tensor.data.len() != 4 * n {
            let found = format!("{} bytes of {:?}", tensor.data.len(), tensor.elements);
            return Err(form(operator, found, "constant whole numbers of 32 bits"));
        }
        let numbers = tensor.data.as_chunks().0.iter();
        Ok(numbers.map(|&bytes| i32::from_le_bytes(bytes)).collect())
    }

    /// Takes the maps of the keypoints, and applies a sigmoid.
    fn finish(mut self, goal: usize, maps: HeatMaps) -> Result<Vec<u8>, ConvertError> {
        let all = self.name(goal)?;
        let indices: Vec<i64> = (0..).take(maps.n_keypoints).collect();
        self.graph.whole_numbers("keypoints", &indices);
        let picked = Node::new("Gather", &[&all, "keypoints"], "logits").int("axis", 1);
        let sigmoid = Node::new("Sigmoid", &["logits"], OUTPUT);
        self.graph.nodes.extend([picked, sigmoid]);
        let [rows, columns, _] = maps.shape;
        let shape = [maps.n_keypoints, rows, columns];
        self.graph.output(OUTPUT, Batch::Any, &shape);
        Ok(self.graph.into_file())
    }
}

/// What an operator applies to its own result.
#[derive(Debug, Clone, Copy)]
enum Activation {
    None,
    Relu,
    Relu6,
}

impl Activation {
    /// Reads the schema's `ActivationFunctionType`.
    fn read(operator: &Operator<'_>, code: u8) -> Result<Self, ConvertError> {
        match code {
            0 => Ok(Self::None),
            1 => Ok(Self::Relu),
            3 => Ok(Self::Relu6),
            other => {
                let found = format!("the activation {other}");
                Err(form(operator, found, "none, RELU or RELU6"))
            }
        }
    }

    /// The name of the result before this activation makes `output` of it.
    fn name_before(self, output: usize) -> String {
        match self {
            Self::None => named(output),
            Self::Relu | Self::Relu6 => format!("{}_linear", named(output)),
        }
    }
}

/// A window that moves over an image.
struct Window {
    /// Rows and columns, as below.
    kernel: [usize; 2],
    strides: [usize; 2],
    dilations: [usize; 2],
    /// Whether the image is padded so that the output has its size over the stride.
    is_same: bool,
}

impl Window {
    /// Padding of an image of `sides`: above, left, below, right. An odd cell is below or right.
    fn pads(&self, sides: [usize; 2]) -> [usize; 4] {
        if !self.is_same {
            return [0; 4];
        }
        let of = |axis: usize| {
            let (side, stride) = (sides[axis], self.strides[axis]);
            let reach = (side.div_ceil(stride) - 1) * stride
                + (self.kernel[axis] - 1) * self.dilations[axis]
                + 1;
            let all = reach.saturating_sub(side);
            (all / 2, all - all / 2)
        };
        let ((above, below), (left, right)) = (of(0), of(1));
        [above, left, below, right]
    }
}

/// Strides along rows and columns; the same fields in all windows.
fn strides(options: &Table<'_>) -> Result<[usize; 2], ConvertError> {
    Ok([
        options.side(2, 0, "a stride")?,
        options.side(1, 0, "a stride")?,
    ])
}

fn is_same(operator: &Operator<'_>, options: &Table<'_>) -> Result<bool, ConvertError> {
    match options.byte(0)? {
        0 => Ok(true),
        1 => Ok(false),
        other => Err(form(
            operator,
            format!("the padding {other}"),
            "SAME or VALID",
        )),
    }
}

/// `values` with their axes in another order: axis i of the result is axis `order[i]`.
fn permuted(values: &[f32], shape: [usize; 4], order: [usize; 4]) -> ([usize; 4], Vec<f32>) {
    let strides = [
        shape[1] * shape[2] * shape[3],
        shape[2] * shape[3],
        shape[3],
        1,
    ];
    let to = order.map(|axis| shape[axis]);
    let step = order.map(|axis| strides[axis]);
    let mut out = Vec::with_capacity(values.len());
    for a in 0..to[0] {
        for b in 0..to[1] {
            for c in 0..to[2] {
                let start = a * step[0] + b * step[1] + c * step[2];
                out.extend((0..to[3]).map(|d| values[start + d * step[3]]));
            }
        }
    }
    (to, out)
}

fn named(tensor: usize) -> String {
    format!("t{tensor}")
}

fn operator_name(code: i32) -> String {
    let known = NAMES.iter().find(|(known, _)| *known == code);
    known.map_or_else(
        || format!("number {code} of TensorFlow's schema"),
        |(_, name)| (*name).to_owned(),
    )
}

fn form(operator: &Operator<'_>, found: String, expected: &'static str) -> ConvertError {
    ConvertError::Form {
        operator: operator_name(operator.code),
        found,
        expected,
    }
}

#[cfg(test)]
mod tests;
