//! Reads the tables of a TFLite file that a conversion needs.
//!
//! A TFLite file is a FlatBuffer: tables refer to each other by offsets. Every value is read when it is requested, and
//! every offset and length is checked against the file. So nothing is copied, and no content of a file causes a panic.
//! Field numbers are those of TensorFlow's `schema.fbs`.

use thiserror::Error;

/// Bytes 4 to 8 of every TFLite file.
const IDENTIFIER: &[u8] = b"TFL3";
/// Largest side, stride or number of channels of an image tensor: products of two fit 64 bits.
const MAX_SIDE: i32 = 1 << 16;

// Fields of the tables.
const MODEL_CODES: usize = 1;
const MODEL_SUBGRAPHS: usize = 2;
const MODEL_BUFFERS: usize = 4;
const CODE_OLD: usize = 0;
const CODE_NEW: usize = 3;
const GRAPH_TENSORS: usize = 0;
const GRAPH_INPUTS: usize = 1;
const GRAPH_OUTPUTS: usize = 2;
const GRAPH_OPERATORS: usize = 3;
const TENSOR_SHAPE: usize = 0;
const TENSOR_TYPE: usize = 1;
const TENSOR_BUFFER: usize = 2;
const OPERATOR_CODE: usize = 0;
const OPERATOR_INPUTS: usize = 1;
const OPERATOR_OUTPUTS: usize = 2;
const OPERATOR_OPTIONS: usize = 4;
const BUFFER_DATA: usize = 0;

/// Why a file is not a readable TFLite file.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum TfliteError {
    /// The file is of another kind.
    #[error("found no TFLite file: bytes 4 to 8 are not `TFL3`")]
    OtherKind,
    /// An offset or a length exceeds the file.
    #[error("the TFLite file is damaged at byte {at}: a table or list exceeds its end")]
    Truncated {
        /// The byte.
        at: usize,
    },
    /// A required part is missing.
    #[error("the TFLite file has no {what}")]
    Missing {
        /// The part.
        what: &'static str,
    },
    /// A number is outside its range.
    #[error("the TFLite file has {value} as {what}, expected 1 to {MAX_SIDE}")]
    Side {
        /// The meaning of the number.
        what: &'static str,
        /// The number.
        value: i32,
    },
    /// An image tensor with another number of axes.
    #[error("tensor {tensor} has {found} axes, expected 4: batch, row, column, channel")]
    Axes {
        /// Index of the tensor.
        tensor: usize,
        /// Its number of axes.
        found: usize,
    },
}

/// A position in the file at which a table starts.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Table<'a> {
    bytes: &'a [u8],
    at: usize,
}

fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N], TfliteError> {
    let part = at.checked_add(N).and_then(|end| bytes.get(at..end));
    part.and_then(|part| part.try_into().ok())
        .ok_or(TfliteError::Truncated { at })
}

/// The position that the offset at `at` refers to.
fn followed(bytes: &[u8], at: usize) -> Result<usize, TfliteError> {
    let offset = u32::from_le_bytes(array(bytes, at)?);
    let to = at.checked_add(offset as usize);
    to.filter(|&to| to < bytes.len())
        .ok_or(TfliteError::Truncated { at })
}

impl<'a> Table<'a> {
    /// Position of field `number`; `None` if the table does not have it.
    fn field(&self, number: usize) -> Result<Option<usize>, TfliteError> {
        let cut = TfliteError::Truncated { at: self.at };
        let back = i32::from_le_bytes(array(self.bytes, self.at)?);
        let kinds = i64::try_from(self.at).map_err(|_| cut.clone())? - i64::from(back);
        let kinds = usize::try_from(kinds).map_err(|_| cut)?;
        let size = u16::from_le_bytes(array(self.bytes, kinds)?);
        let entry = 4 + 2 * number;
        if entry + 2 > usize::from(size) {
            return Ok(None);
        }
        let offset = u16::from_le_bytes(array(self.bytes, kinds.saturating_add(entry))?);
        Ok((offset != 0).then(|| self.at.saturating_add(usize::from(offset))))
    }

    /// Field `number` of one byte.
    pub(crate) fn byte(&self, number: usize) -> Result<u8, TfliteError> {
        let at = self.field(number)?;
        at.map_or(Ok(0), |at| array(self.bytes, at).map(|[byte]| byte))
    }

    /// Field `number` of 32 bits, or its default.
    pub(crate) fn int(&self, number: usize, default: i32) -> Result<i32, TfliteError> {
        let at = self.field(number)?;
        at.map_or(Ok(default), |at| {
            array(self.bytes, at).map(i32::from_le_bytes)
        })
    }

    /// Field `number` as a side or stride.
    pub(crate) fn side(
        &self,
        number: usize,
        default: i32,
        what: &'static str,
    ) -> Result<usize, TfliteError> {
        side(self.int(number, default)?, what)
    }

    /// Field `number` as a list of entries of `size` bytes; empty if the table does not have it.
    fn list(&self, number: usize, size: usize) -> Result<List<'a>, TfliteError> {
        let Some(at) = self.field(number)? else {
            return Ok(List {
                bytes: self.bytes,
                start: 0,
                len: 0,
            });
        };
        let start = followed(self.bytes, at)?;
        let len = u32::from_le_bytes(array(self.bytes, start)?) as usize;
        let start = start + 4;
        let end = len.checked_mul(size).and_then(|n| n.checked_add(start));
        if end.is_none_or(|end| end > self.bytes.len()) {
            return Err(TfliteError::Truncated { at: start });
        }
        Ok(List {
            bytes: self.bytes,
            start,
            len,
        })
    }
}

fn side(value: i32, what: &'static str) -> Result<usize, TfliteError> {
    let is_side = (1..=MAX_SIDE).contains(&value);
    let side = usize::try_from(value).ok().filter(|_| is_side);
    side.ok_or(TfliteError::Side { what, value })
}

/// A list in the file, whose length has been checked.
#[derive(Debug, Clone, Copy)]
pub(crate) struct List<'a> {
    bytes: &'a [u8],
    start: usize,
    pub(crate) len: usize,
}

impl<'a> List<'a> {
    /// Entry `index` of a list of tables.
    fn table(&self, index: usize, what: &'static str) -> Result<Table<'a>, TfliteError> {
        if index >= self.len {
            return Err(TfliteError::Missing { what });
        }
        let at = followed(self.bytes, self.start + 4 * index)?;
        Ok(Table {
            bytes: self.bytes,
            at,
        })
    }

    /// Entry `index` of a list of 32-bit numbers.
    pub(crate) fn int(&self, index: usize) -> Option<i32> {
        let bytes = array(self.bytes, self.start + 4 * index).ok()?;
        (index < self.len).then(|| i32::from_le_bytes(bytes))
    }

    /// The bytes of a list of bytes.
    fn whole(&self) -> &'a [u8] {
        &self.bytes[self.start..self.start + self.len]
    }
}

/// The elements of a tensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Elements {
    Float32,
    Float16,
    Int32,
    /// Another type, with its number in the schema.
    Other(u8),
}

/// A tensor: an input, a constant or an intermediate result.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tensor<'a> {
    /// Its index in the graph.
    pub(crate) index: usize,
    shape: List<'a>,
    pub(crate) elements: Elements,
    /// The bytes of a constant; empty for others.
    pub(crate) data: &'a [u8],
}

impl Tensor<'_> {
    /// Rows, columns and channels of an image tensor [batch, row, column, channel].
    pub(crate) fn image_shape(&self) -> Result<[usize; 3], TfliteError> {
        let [_, rows, columns, channels] = self.shape_of_four()?;
        Ok([rows, columns, channels])
    }

    /// The number of elements by its shape: 1 without axes.
    pub(crate) fn n_elements(&self) -> Result<usize, TfliteError> {
        let mut n: usize = 1;
        for i in 0..self.shape.len {
            let size = side(self.shape.int(i).unwrap_or(0), "the size of an axis")?;
            n = n.saturating_mul(size);
        }
        Ok(n)
    }

    /// The sizes of four axes.
    pub(crate) fn shape_of_four(&self) -> Result<[usize; 4], TfliteError> {
        if self.shape.len != 4 {
            return Err(TfliteError::Axes {
                tensor: self.index,
                found: self.shape.len,
            });
        }
        let mut shape = [0; 4];
        for (i, size) in shape.iter_mut().enumerate() {
            *size = side(self.shape.int(i).unwrap_or(0), "the size of an axis")?;
        }
        Ok(shape)
    }
}

/// An operator with its tensors.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Operator<'a> {
    /// Its number in the schema's `BuiltinOperator`.
    pub(crate) code: i32,
    inputs: List<'a>,
    outputs: List<'a>,
    options: Option<Table<'a>>,
}

impl<'a> Operator<'a> {
    /// The tensor that is input `index`.
    pub(crate) fn input(&self, index: usize) -> Result<usize, TfliteError> {
        let input = self.optional_input(index);
        input.ok_or(TfliteError::Missing {
            what: "input of an operator",
        })
    }

    /// The tensor that is input `index`, if there is one.
    pub(crate) fn optional_input(&self, index: usize) -> Option<usize> {
        self.inputs
            .int(index)
            .and_then(|tensor| usize::try_from(tensor).ok())
    }

    /// The only output.
    pub(crate) fn output(&self) -> Result<usize, TfliteError> {
        let output = self.outputs.int(0);
        let output = output.and_then(|tensor| usize::try_from(tensor).ok());
        output.ok_or(TfliteError::Missing {
            what: "output of an operator",
        })
    }

    /// Its options.
    pub(crate) fn options(&self) -> Result<Table<'a>, TfliteError> {
        self.options.ok_or(TfliteError::Missing {
            what: "options of an operator",
        })
    }
}

/// A TFLite file with one graph.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Model<'a> {
    codes: List<'a>,
    buffers: List<'a>,
    tensors: List<'a>,
    inputs: List<'a>,
    outputs: List<'a>,
    operators: List<'a>,
    /// Length of the file, bytes.
    pub(crate) file_bytes: usize,
}

impl<'a> Model<'a> {
    /// Reads the head of a file.
    pub(crate) fn read(bytes: &'a [u8]) -> Result<Self, TfliteError> {
        if bytes.get(4..8) != Some(IDENTIFIER) {
            return Err(TfliteError::OtherKind);
        }
        let at = followed(bytes, 0)?;
        let model = Table { bytes, at };
        let graph = model.list(MODEL_SUBGRAPHS, 4)?.table(0, "graph")?;
        Ok(Self {
            codes: model.list(MODEL_CODES, 4)?,
            buffers: model.list(MODEL_BUFFERS, 4)?,
            tensors: graph.list(GRAPH_TENSORS, 4)?,
            inputs: graph.list(GRAPH_INPUTS, 4)?,
            outputs: graph.list(GRAPH_OUTPUTS, 4)?,
            operators: graph.list(GRAPH_OPERATORS, 4)?,
            file_bytes: bytes.len(),
        })
    }

    /// Number of tensors.
    pub(crate) fn n_tensors(&self) -> usize {
        self.tensors.len
    }

    /// Number of operators.
    pub(crate) fn n_operators(&self) -> usize {
        self.operators.len
    }

    /// The first input of the graph.
    pub(crate) fn input(&self) -> Result<usize, TfliteError> {
        let input = self.inputs.int(0);
        let input = input.and_then(|tensor| usize::try_from(tensor).ok());
        input.ok_or(TfliteError::Missing { what: "input" })
    }

    /// The outputs of the graph.
    pub(crate) fn outputs(&self) -> impl Iterator<Item = usize> + '_ {
        let outputs = (0..self.outputs.len).filter_map(|i| self.outputs.int(i));
        outputs.filter_map(|tensor| usize::try_from(tensor).ok())
    }

    /// Tensor `index`.
    pub(crate) fn tensor(&self, index: usize) -> Result<Tensor<'a>, TfliteError> {
        let table = self.tensors.table(index, "tensor of an operator")?;
        let elements = match table.byte(TENSOR_TYPE)? {
            0 => Elements::Float32,
            1 => Elements::Float16,
            2 => Elements::Int32,
            other => Elements::Other(other),
        };
        let buffer = usize::try_from(table.int(TENSOR_BUFFER, 0)?);
        let buffer = buffer.map_err(|_| TfliteError::Missing { what: "buffer" })?;
        let buffer = self.buffers.table(buffer, "buffer of a tensor")?;
        Ok(Tensor {
            index,
            shape: table.list(TENSOR_SHAPE, 4)?,
            elements,
            data: buffer.list(BUFFER_DATA, 1)?.whole(),
        })
    }

    /// Operator `index`.
    pub(crate) fn operator(&self, index: usize) -> Result<Operator<'a>, TfliteError> {
        let table = self.operators.table(index, "operator")?;
        let code = usize::try_from(table.int(OPERATOR_CODE, 0)?);
        let code = code.map_err(|_| TfliteError::Missing { what: "operator" })?;
        let code = self.codes.table(code, "code of an operator")?;
        // Newer files have both; codes above 127 are in the second alone.
        let old = i32::from(code.byte(CODE_OLD)?.cast_signed());
        let options = table.field(OPERATOR_OPTIONS)?;
        let options = options.map(|at| followed(table.bytes, at)).transpose()?;
        Ok(Operator {
            code: old.max(code.int(CODE_NEW, 0)?),
            inputs: table.list(OPERATOR_INPUTS, 4)?,
            outputs: table.list(OPERATOR_OUTPUTS, 4)?,
            options: options.map(|at| Table {
                bytes: table.bytes,
                at,
            }),
        })
    }
}
