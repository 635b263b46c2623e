//! Reads graph models of TensorFlow.js: a JSON file with the nodes and the manifest, and one file of weights.
//!
//! The manifest states type and shape of each tensor of weights, in the order of the file. Their sizes must add up to
//! that of the file, and numbers are read only where they are used.

use std::collections::BTreeMap;
use std::ops::Range;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use half::f16;
use serde::Deserialize;
use thiserror::Error;

/// Largest JSON file that is read, bytes. In memory it takes at most some 16 times as much.
const MAX_JSON_BYTES: usize = 4 << 20;
/// Most characters of the JSON reader's message that are shown.
const MAX_MESSAGE: usize = 200;
/// Largest stride or dilation of a window.
const MAX_STEP: usize = 1 << 12;

/// Why a graph model cannot be read, or not be converted.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TfjsError {
    /// The JSON file is another one.
    #[error("found no graph model of TensorFlow.js: {problem}")]
    OtherKind {
        /// The reader's message.
        problem: String,
    },
    /// The JSON file is too large.
    #[error("found {found} bytes of JSON, expected at most {MAX_JSON_BYTES}")]
    LargeJson {
        /// Its size, bytes.
        found: usize,
    },
    /// The weights are in several files.
    #[error("the manifest lists {found} files of weights, expected 1")]
    WeightFiles {
        /// Their number.
        found: usize,
    },
    /// A tensor of weights in an unknown form.
    #[error("the weights {weights} are {found}, expected {expected}")]
    Weights {
        /// Their name.
        weights: String,
        /// What was found.
        found: String,
        /// What is read.
        expected: &'static str,
    },
    /// The file of weights does not fit the manifest.
    #[error("found {found} bytes of weights, expected the {expected} of the manifest")]
    WeightsSize {
        /// Size of the file.
        found: usize,
        /// Size by the manifest.
        expected: usize,
    },
    /// A node is missing.
    #[error("the graph has no node {node}")]
    NoNode {
        /// Its name.
        node: String,
    },
    /// The manifest lacks the weights of a node.
    #[error("the manifest has no weights {weights}, which the node {node} uses")]
    NoWeights {
        /// Their name.
        weights: String,
        /// The node.
        node: String,
    },
    /// The nodes form a ring.
    #[error("the node {node} depends on itself")]
    Ring {
        /// Its name.
        node: String,
    },
    /// A grid of the detector has another shape.
    #[error(
        "the node {node} has {found:?} numbers, expected {expected:?} (channels, rows, columns)"
    )]
    Grid {
        /// Name of the node.
        node: String,
        /// Its channels, rows and columns.
        found: [usize; 3],
        /// Those of the detector.
        expected: [usize; 3],
    },
    /// An operator without a counterpart here.
    #[error("the node {node} is the operator {operator}, which is not converted")]
    Operator {
        /// Name of the node.
        node: String,
        /// The operator.
        operator: String,
    },
    /// A known operator in an unknown form.
    #[error("the node {node} ({operator}) has {found}, expected {expected}")]
    Form {
        /// Name of the node.
        node: String,
        /// The operator.
        operator: String,
        /// What was found.
        found: String,
        /// What is converted.
        expected: String,
    },
}

#[derive(Deserialize)]
struct File {
    #[serde(rename = "modelTopology")]
    topology: Topology,
    #[serde(rename = "weightsManifest")]
    manifest: Vec<WeightGroup>,
}

#[derive(Deserialize)]
struct Topology {
    node: Vec<Operation>,
}

#[derive(Deserialize)]
struct WeightGroup {
    paths: Vec<String>,
    weights: Vec<ListedWeights>,
}

#[derive(Deserialize)]
struct ListedWeights {
    name: String,
    shape: Vec<usize>,
    dtype: String,
    quantization: Option<Quantization>,
}

#[derive(Deserialize)]
struct Quantization {
    dtype: String,
    scale: Option<f64>,
    min: Option<f64>,
}

/// A node of the graph.
#[derive(Debug, Deserialize)]
pub(crate) struct Operation {
    /// Its name.
    pub(crate) name: String,
    /// Its operator.
    #[serde(rename = "op")]
    pub(crate) operator: String,
    #[serde(default, rename = "input")]
    inputs: Vec<String>,
    #[serde(default, rename = "attr")]
    attributes: BTreeMap<String, Attribute>,
}

/// An attribute; other types of values are skipped.
#[derive(Debug, Deserialize)]
struct Attribute {
    /// Text in base 64.
    #[serde(rename = "s")]
    text: Option<String>,
    #[serde(rename = "b")]
    flag: Option<bool>,
    list: Option<List>,
}

#[derive(Debug, Deserialize)]
struct List {
    #[serde(default, rename = "s")]
    texts: Vec<String>,
    #[serde(default, rename = "i")]
    whole_numbers: Vec<WholeNumber>,
}

/// Numbers of 64 bits are text in most files.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum WholeNumber {
    Number(i64),
    Text(String),
}

/// The numbers of a tensor of weights in the file.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Elements {
    Float32,
    Float16,
    /// Whole numbers `q` of so many bytes that stand for `scale * q + min`.
    Steps {
        bytes: usize,
        scale: f64,
        min: f64,
    },
    Int32,
    Bool,
}

/// A tensor of weights.
#[derive(Debug)]
pub(crate) struct Weights<'a> {
    /// Sizes of its axes.
    pub(crate) shape: Vec<usize>,
    /// Their product.
    pub(crate) n_elements: usize,
    elements: Elements,
    data: &'a [u8],
}

/// A graph model, with positions of weights that lie inside the file.
#[derive(Debug)]
pub(crate) struct Model<'a> {
    operations: BTreeMap<String, Operation>,
    weights: BTreeMap<String, Weights<'a>>,
    /// Size of the file of weights.
    pub(crate) weight_bytes: usize,
}

impl<'a> Model<'a> {
    /// Reads the JSON file `json` with the file of weights `data`.
    pub(crate) fn read(json: &[u8], data: &'a [u8]) -> Result<Self, TfjsError> {
        let found = json.len();
        if found > MAX_JSON_BYTES {
            return Err(TfjsError::LargeJson { found });
        }
        let file: File = serde_json::from_slice(json).map_err(|error| TfjsError::OtherKind {
            problem: error.to_string().chars().take(MAX_MESSAGE).collect(),
        })?;
        let found = file.manifest.iter().map(|group| group.paths.len()).sum();
        let mut groups = file.manifest.into_iter();
        let (Some(group), None, 1) = (groups.next(), groups.next(), found) else {
            return Err(TfjsError::WeightFiles { found });
        };
        let operations = file.topology.node.into_iter();
        Ok(Self {
            operations: operations.map(|it| (it.name.clone(), it)).collect(),
            weights: located(group.weights, data)?,
            weight_bytes: data.len(),
        })
    }

    /// The node `name`.
    pub(crate) fn operation(&self, name: &str) -> Result<&Operation, TfjsError> {
        let node = || name.to_owned();
        let operation = self.operations.get(name);
        operation.ok_or_else(|| TfjsError::NoNode { node: node() })
    }

    /// The weights that are the input `index` of `operation`.
    pub(crate) fn weights(
        &self,
        operation: &Operation,
        index: usize,
    ) -> Result<&Weights<'a>, TfjsError> {
        let name = operation.input(index)?;
        self.weights.get(name).ok_or_else(|| TfjsError::NoWeights {
            weights: name.to_owned(),
            node: operation.name.clone(),
        })
    }

    /// The constant whole numbers `name`; `None` if no weights of this name have `N` of them.
    pub(crate) fn whole_numbers<const N: usize>(&self, name: &str) -> Option<[i32; N]> {
        let weights = self.weights.get(name)?;
        let numbers = weights.data.as_chunks().0;
        let numbers: &[[u8; 4]; N] = numbers.try_into().ok()?;
        (weights.elements == Elements::Int32).then(|| numbers.map(i32::from_le_bytes))
    }
}

/// The weights of the manifest, with their bytes in `data`.
fn located(
    manifest: Vec<ListedWeights>,
    data: &[u8],
) -> Result<BTreeMap<String, Weights<'_>>, TfjsError> {
    let mut ranges: Vec<(ListedWeights, Elements, usize, Range<usize>)> = Vec::new();
    let mut end = 0;
    for listed in manifest {
        let elements = listed.elements()?;
        let mut axes = listed.shape.iter();
        let n = axes.try_fold(1_usize, |n, &side| n.checked_mul(side));
        let bytes = n.and_then(|n| n.checked_mul(elements.bytes()));
        let (Some(n), Some(next)) = (n, bytes.and_then(|bytes| bytes.checked_add(end))) else {
            let found = format!("of the shape {:?}", listed.shape);
            return Err(listed.refused(found, "less than the memory of a machine"));
        };
        ranges.push((listed, elements, n, end..next));
        end = next;
    }
    let mismatch = || TfjsError::WeightsSize {
        found: data.len(),
        expected: end,
    };
    if end != data.len() {
        return Err(mismatch());
    }
    let weights = ranges
        .into_iter()
        .map(|(listed, elements, n_elements, range)| {
            let weights = Weights {
                shape: listed.shape,
                n_elements,
                elements,
                data: data.get(range).ok_or_else(mismatch)?,
            };
            Ok((listed.name, weights))
        });
    weights.collect()
}

impl ListedWeights {
    fn elements(&self) -> Result<Elements, TfjsError> {
        let Some(quantization) = &self.quantization else {
            return match self.dtype.as_str() {
                "float32" => Ok(Elements::Float32),
                "int32" => Ok(Elements::Int32),
                "bool" => Ok(Elements::Bool),
                other => Err(self.refused(format!("of {other}"), "float32, int32 or bool")),
            };
        };
        let form = format!("{} stored as {}", self.dtype, quantization.dtype);
        let bytes = match (self.dtype.as_str(), quantization.dtype.as_str()) {
            ("float32", "float16") => return Ok(Elements::Float16),
            ("float32", "uint8") => 1,
            ("float32", "uint16") => 2,
            _ => return Err(self.refused(form, "float32 stored as float16, uint8 or uint16")),
        };
        match (quantization.scale, quantization.min) {
            (Some(scale), Some(min)) => Ok(Elements::Steps { bytes, scale, min }),
            _ => Err(self.refused(form, "a scale and a least value with it")),
        }
    }

    fn refused(&self, found: String, expected: &'static str) -> TfjsError {
        TfjsError::Weights {
            weights: self.name.clone(),
            found,
            expected,
        }
    }
}

impl Elements {
    fn bytes(self) -> usize {
        match self {
            Self::Float32 | Self::Int32 => 4,
            Self::Float16 => 2,
            Self::Steps { bytes, .. } => bytes,
            Self::Bool => 1,
        }
    }
}

impl Weights<'_> {
    /// Its numbers; `None` if they are not floats.
    pub(crate) fn floats(&self) -> Option<Vec<f32>> {
        let halves = || self.data.as_chunks().0.iter();
        Some(match self.elements {
            Elements::Float32 => {
                let floats = self.data.as_chunks().0.iter();
                floats.map(|&bytes| f32::from_le_bytes(bytes)).collect()
            }
            Elements::Float16 => halves()
                .map(|&bytes| f16::from_le_bytes(bytes).to_f32())
                .collect(),
            Elements::Steps { bytes, scale, min } => {
                let value = |q: u16| (f64::from(q) * scale + min) as f32;
                if bytes == 1 {
                    self.data.iter().map(|&q| value(q.into())).collect()
                } else {
                    halves()
                        .map(|&bytes| value(u16::from_le_bytes(bytes)))
                        .collect()
                }
            }
            Elements::Int32 | Elements::Bool => return None,
        })
    }
}

impl Operation {
    /// The name of the node or weights that are its input `index`.
    pub(crate) fn input(&self, index: usize) -> Result<&str, TfjsError> {
        let name = self.inputs.get(index).ok_or_else(|| {
            let found = format!("{} inputs", self.inputs.len());
            self.form(found, format!("at least {}", index + 1))
        })?;
        // The converted operators have one output, number 0.
        Ok(name.strip_suffix(":0").unwrap_or(name))
    }

    /// An attribute of text; empty if it is absent.
    pub(crate) fn text(&self, attribute: &str) -> Result<String, TfjsError> {
        let value = self.attributes.get(attribute);
        let text = value.and_then(|value| value.text.as_ref());
        text.map_or(Ok(String::new()), |text| self.decoded(text))
    }

    /// An attribute of several texts; none if it is absent.
    pub(crate) fn texts(&self, attribute: &str) -> Result<Vec<String>, TfjsError> {
        let texts = self.list(attribute).map_or(&[][..], |list| &list.texts);
        texts.iter().map(|text| self.decoded(text)).collect()
    }

    /// An attribute that is true or false; absent ones are false.
    pub(crate) fn flag(&self, attribute: &str) -> bool {
        let value = self.attributes.get(attribute);
        value.and_then(|value| value.flag).unwrap_or(false)
    }

    /// Rows and columns of an attribute [1, rows, columns, 1].
    pub(crate) fn steps(&self, attribute: &str) -> Result<[usize; 2], TfjsError> {
        let numbers = self
            .list(attribute)
            .map_or(&[][..], |list| &list.whole_numbers);
        let number = |it: &WholeNumber| match it {
            WholeNumber::Number(number) => usize::try_from(*number).ok(),
            WholeNumber::Text(text) => text.parse().ok(),
        };
        let steps: Vec<usize> = numbers.iter().take(5).filter_map(number).collect();
        match steps[..] {
            [1, rows, columns, 1]
                if (1..=MAX_STEP).contains(&rows) && (1..=MAX_STEP).contains(&columns) =>
            {
                Ok([rows, columns])
            }
            _ => Err(self.form(
                format!("{attribute} {steps:?}"),
                format!("[1, rows, columns, 1] with numbers from 1 to {MAX_STEP}"),
            )),
        }
    }

    fn list(&self, attribute: &str) -> Option<&List> {
        self.attributes.get(attribute)?.list.as_ref()
    }

    fn decoded(&self, text: &str) -> Result<String, TfjsError> {
        let bytes = STANDARD.decode(text).ok();
        let decoded = bytes.and_then(|bytes| String::from_utf8(bytes).ok());
        decoded.ok_or_else(|| {
            let found = format!("the text {text:?}");
            self.form(found, "text in base 64".to_owned())
        })
    }

    /// An error about its form.
    pub(crate) fn form(&self, found: String, expected: impl Into<String>) -> TfjsError {
        TfjsError::Form {
            node: self.name.clone(),
            operator: self.operator.clone(),
            found,
            expected: expected.into(),
        }
    }
}
