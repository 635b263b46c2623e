//! Converts nodes of a TensorFlow.js graph to ONNX, from an image to the nodes that are wanted.
//!
//! As in TFLite files, images are [batch, row, column, channel] there.

use std::collections::{BTreeMap, BTreeSet};

use super::{ConvertError, FLOAT_BYTES, INPUT, MAX_GROWTH, Window, permuted};
use crate::onnx::{Batch, Graph, Node};
use crate::tfjs::{Model, Operation, TfjsError, Weights};

/// Largest side of an image inside a network, pixels.
const MAX_SIDE: usize = 1 << 16;

/// The value of a node.
#[derive(Debug, Clone)]
pub(super) struct Image {
    /// Its name in the ONNX graph.
    pub(super) name: String,
    /// Channels, rows and columns.
    pub(super) shape: [usize; 3],
}

/// An ONNX graph under construction.
pub(super) struct GraphConversion<'a> {
    model: &'a Model<'a>,
    /// The nodes so far.
    pub(super) graph: Graph,
    computed: BTreeMap<&'a str, Image>,
    /// Bytes of weights that may still be added.
    weights_left: usize,
}

/// What a convolution applies to its own result.
struct Fused {
    has_bias: bool,
    activation: Activation,
}

#[derive(Clone, Copy)]
enum Activation {
    None,
    Relu,
    Relu6,
}

impl<'a> GraphConversion<'a> {
    /// A graph whose input is the value of the node `image`, a square image of three channels.
    pub(super) fn new(
        model: &'a Model<'a>,
        image: &'a str,
        side: usize,
    ) -> Result<Self, ConvertError> {
        model.operation(image)?;
        let shape = [3, side, side];
        let mut graph = Graph::new("boxes");
        graph.input(INPUT, Batch::One, shape);
        let name = INPUT.to_owned();
        Ok(Self {
            model,
            graph,
            computed: BTreeMap::from([(image, Image { name, shape })]),
            weights_left: MAX_GROWTH * model.weight_bytes,
        })
    }

    /// The value of the node `goal`. Nodes that it depends on are converted first.
    pub(super) fn value(&mut self, goal: &'a str) -> Result<Image, ConvertError> {
        let mut entered = BTreeSet::new();
        let mut waiting = vec![goal];
        while let Some(&name) = waiting.last() {
            if self.computed.contains_key(name) {
                waiting.pop();
                continue;
            }
            let operation = self.model.operation(name)?;
            let inputs = image_inputs(operation)?;
            let inputs = inputs.iter().map(|&i| operation.input(i));
            let mut missing = inputs.collect::<Result<Vec<_>, _>>()?;
            missing.retain(|input| !self.computed.contains_key(input));
            if missing.is_empty() {
                let image = self.converted(operation)?;
                self.computed.insert(name, image);
            } else if entered.insert(name) {
                waiting.extend(missing);
            } else {
                let node = name.to_owned();
                return Err(TfjsError::Ring { node }.into());
            }
        }
        Ok(self.image(goal)?)
    }

    fn image(&self, name: &str) -> Result<Image, TfjsError> {
        let image = self.computed.get(name).cloned();
        image.ok_or_else(|| TfjsError::NoNode {
            node: name.to_owned(),
        })
    }

    fn converted(&mut self, operation: &Operation) -> Result<Image, ConvertError> {
        match operation.operator.as_str() {
            "AddV2" => self.add(operation),
            "ResizeBilinear" => self.resize(operation),
            // `image_inputs` has refused other operators.
            _ => self.convolution(operation),
        }
    }

    /// A name for the value of the next node.
    fn next_name(&self) -> String {
        format!("t{}", self.computed.len())
    }

    fn convolution(&mut self, operation: &Operation) -> Result<Image, ConvertError> {
        let input = self.image(operation.input(0)?)?;
        let [channels, rows, columns] = input.shape;
        let weights = self.model.weights(operation, 1)?;
        let [kernel_rows, kernel_columns, from, to] = kernel(operation, weights, channels)?;
        let values = self.floats(operation, weights)?;
        let shape = [kernel_rows, kernel_columns, from, to];
        // [row, column, in, out] becomes [out, in, row, column]; each channel by itself: [in, multiplier, row, column].
        let is_depthwise = operation.operator.contains("Depthwise");
        let (mut shape, values) = if is_depthwise {
            permuted(&values, shape, [2, 3, 0, 1])
        } else {
            permuted(&values, shape, [3, 2, 0, 1])
        };
        if is_depthwise {
            shape = [from * to, 1, kernel_rows, kernel_columns];
        }
        let window = window(operation, [kernel_rows, kernel_columns])?;
        let [to_rows, to_columns] = output_sides(operation, &window, [rows, columns])?;
        let fused = Fused::read(operation)?;
        let stem = self.next_name();
        let (w, b) = (format!("{stem}_weights"), format!("{stem}_bias"));
        self.graph.floats(&w, &shape, &values);
        let mut inputs = vec![input.name.as_str(), w.as_str()];
        if fused.has_bias {
            let bias = self.model.weights(operation, 2)?;
            if bias.n_elements != shape[0] {
                let found = format!("{} biases for {} channels", bias.n_elements, shape[0]);
                return Err(operation.form(found, "one bias per channel").into());
            }
            let values = self.floats(operation, bias)?;
            self.graph.floats(&b, &[values.len()], &values);
            inputs.push(&b);
        }
        let linear = match fused.activation {
            Activation::None => stem.clone(),
            Activation::Relu | Activation::Relu6 => format!("{stem}_linear"),
        };
        let node = Node::new("Conv", &inputs, &linear)
            .ints("kernel_shape", &window.kernel)
            .ints("strides", &window.strides)
            .ints("dilations", &window.dilations)
            .ints("pads", &window.pads([rows, columns]))
            .int("group", if is_depthwise { channels } else { 1 });
        self.graph.nodes.push(node);
        self.activate(fused.activation, &linear, &stem);
        Ok(Image {
            name: stem,
            shape: [shape[0], to_rows, to_columns],
        })
    }

    fn activate(&mut self, activation: Activation, linear: &str, output: &str) {
        match activation {
            Activation::None => {}
            Activation::Relu => {
                let node = Node::new("Relu", &[linear], output);
                self.graph.nodes.push(node);
            }
            Activation::Relu6 => self.graph.clip(linear, output),
        }
    }

    fn add(&mut self, operation: &Operation) -> Result<Image, ConvertError> {
        let one = self.image(operation.input(0)?)?;
        let other = self.image(operation.input(1)?)?;
        if one.shape != other.shape {
            let found = format!("images {:?} and {:?}", one.shape, other.shape);
            return Err(operation.form(found, "equal shapes").into());
        }
        let name = self.next_name();
        let node = Node::new("Add", &[&one.name, &other.name], &name);
        self.graph.nodes.push(node);
        let shape = one.shape;
        Ok(Image { name, shape })
    }

    fn resize(&mut self, operation: &Operation) -> Result<Image, ConvertError> {
        if operation.flag("align_corners") || !operation.flag("half_pixel_centers") {
            let found = "other positions of the pixels".to_owned();
            return Err(operation.form(found, "half_pixel_centers alone").into());
        }
        let input = self.image(operation.input(0)?)?;
        let [channels, rows, columns] = input.shape;
        let to = self.new_sides(operation, [rows, columns])?;
        let name = self.next_name();
        let scales = format!("{name}_scales");
        let factors = [to[0] as f32 / rows as f32, to[1] as f32 / columns as f32];
        self.graph
            .floats(&scales, &[4], &[1.0, 1.0, factors[0], factors[1]]);
        let node = Node::new("Resize", &[&input.name, "", &scales], &name)
            .text("mode", "linear")
            .text("coordinate_transformation_mode", "half_pixel");
        self.graph.nodes.push(node);
        let shape = [channels, to[0], to[1]];
        Ok(Image { name, shape })
    }

    /// Rows and columns after a resize: a constant, or a constant multiple of the input's.
    fn new_sides(&self, operation: &Operation, sides: [usize; 2]) -> Result<[usize; 2], TfjsError> {
        let refused = |found: String| {
            let expected = "a constant size, or a constant multiple of the input's";
            operation.form(found, expected)
        };
        let size = operation.input(1)?;
        let (numbers, unit) = if let Some(numbers) = self.model.whole_numbers(size) {
            (numbers, [1, 1])
        } else {
            let factors = self.factors(operation.input(0)?, size)?;
            let factors = factors.ok_or_else(|| refused(format!("the size {size}")))?;
            (factors, sides)
        };
        let mut to = [0; 2];
        for axis in 0..2 {
            let number = usize::try_from(numbers[axis]).unwrap_or(0);
            to[axis] = number.saturating_mul(unit[axis]);
            if to[axis] == 0 || to[axis] > MAX_SIDE {
                return Err(refused(format!("the size {numbers:?} for {sides:?}")));
            }
        }
        Ok(to)
    }

    /// The constant factors of the node `size`, if it multiplies rows and columns of `image` by them.
    fn factors(&self, image: &str, size: &str) -> Result<Option<[i32; 2]>, TfjsError> {
        let product = self.model.operation(size)?;
        if product.operator != "Mul" {
            return Ok(None);
        }
        let sides = self.model.operation(product.input(0)?)?;
        if sides.operator != "StridedSlice" {
            return Ok(None);
        }
        let shape = self.model.operation(sides.input(0)?)?;
        // From axis 1 to before axis 3, one by one.
        let mut is_of_image = shape.operator == "Shape" && shape.input(0)? == image;
        for (index, expected) in [(1, 1), (2, 3), (3, 1)] {
            let number = self.model.whole_numbers(sides.input(index)?);
            is_of_image &= number == Some([expected]);
        }
        let factors = self.model.whole_numbers(product.input(1)?);
        Ok(factors.filter(|_| is_of_image))
    }

    /// The numbers of weights, within the limit of all.
    fn floats(
        &mut self,
        operation: &Operation,
        weights: &Weights<'_>,
    ) -> Result<Vec<f32>, ConvertError> {
        let bytes = weights.n_elements.saturating_mul(FLOAT_BYTES);
        let left = self.weights_left.checked_sub(bytes);
        self.weights_left = left.ok_or(ConvertError::Large {
            limit: MAX_GROWTH * self.model.weight_bytes,
        })?;
        weights.floats().ok_or_else(|| {
            let found = "weights that are whole numbers".to_owned();
            operation.form(found, "floats").into()
        })
    }
}

/// Which inputs of an operator are images.
fn image_inputs(operation: &Operation) -> Result<&'static [usize], TfjsError> {
    match operation.operator.as_str() {
        "Conv2D"
        | "_FusedConv2D"
        | "DepthwiseConv2dNative"
        | "FusedDepthwiseConv2dNative"
        | "ResizeBilinear" => Ok(&[0]),
        "AddV2" => Ok(&[0, 1]),
        other => Err(TfjsError::Operator {
            node: operation.name.clone(),
            operator: other.to_owned(),
        }),
    }
}

/// The shape of a convolution's weights for so many `channels`: rows, columns, channels, and outputs or multiplier.
fn kernel(
    operation: &Operation,
    weights: &Weights<'_>,
    channels: usize,
) -> Result<[usize; 4], TfjsError> {
    match weights.shape[..] {
        [rows, columns, from, to] if from == channels && weights.n_elements > 0 => {
            Ok([rows, columns, from, to])
        }
        _ => {
            let found = format!("weights {:?}", weights.shape);
            let expected = format!("weights [rows, columns, {channels}, outputs]");
            Err(operation.form(found, expected))
        }
    }
}

/// How the window of a convolution moves.
fn window(operation: &Operation, kernel: [usize; 2]) -> Result<Window, TfjsError> {
    let order = operation.text("data_format")?;
    if order != "NHWC" {
        let found = format!("the order of axes {order:?}");
        return Err(operation.form(found, "NHWC"));
    }
    let padding = operation.text("padding")?;
    let is_same = match padding.as_str() {
        "SAME" => true,
        "VALID" => false,
        other => {
            let found = format!("the padding {other:?}");
            return Err(operation.form(found, "SAME or VALID"));
        }
    };
    Ok(Window {
        kernel,
        strides: operation.steps("strides")?,
        dilations: operation.steps("dilations")?,
        is_same,
    })
}

/// Rows and columns that a window makes of an image of `sides`.
fn output_sides(
    operation: &Operation,
    window: &Window,
    sides: [usize; 2],
) -> Result<[usize; 2], TfjsError> {
    let mut to = [0; 2];
    for axis in 0..2 {
        let (side, stride) = (sides[axis], window.strides[axis]);
        // Kernels have at most as many cells as the file has bytes.
        let reach = (window.kernel[axis] - 1).saturating_mul(window.dilations[axis]);
        to[axis] = if window.is_same {
            side.div_ceil(stride)
        } else if reach < side {
            (side - reach - 1) / stride + 1
        } else {
            let found = format!("a window of {} cells for {side}", reach.saturating_add(1));
            return Err(operation.form(found, "a window inside the image"));
        };
    }
    Ok(to)
}

impl Fused {
    fn read(operation: &Operation) -> Result<Self, TfjsError> {
        let names = operation.texts("fused_ops")?;
        let activation = match names.get(1).map(String::as_str) {
            None => Some(Activation::None),
            Some("Relu") => Some(Activation::Relu),
            Some("Relu6") => Some(Activation::Relu6),
            Some(_) => None,
        };
        let is_known = names.len() <= 2 && names.first().is_none_or(|it| it == "BiasAdd");
        let Some(activation) = activation.filter(|_| is_known) else {
            let found = format!("fused_ops {names:?}");
            let expected = "none, or BiasAdd with Relu, Relu6 or nothing";
            return Err(operation.form(found, expected));
        };
        Ok(Self {
            has_bias: !names.is_empty(),
            activation,
        })
    }
}
