//! Small TFLite files for tests, and a writer for FlatBuffers: each table refers to later ones only.
#![expect(clippy::cast_possible_wrap, reason = "the files are small")]

/// A field of a table, or an entry of a list.
#[derive(Debug, Clone)]
pub(crate) enum Field {
    Byte(u8),
    Int(i32),
    To(Part),
}

/// What an offset refers to.
#[derive(Debug, Clone)]
pub(crate) enum Part {
    /// Fields by number.
    Table(Vec<(usize, Field)>),
    Tables(Vec<Part>),
    Ints(Vec<i32>),
    Bytes(Vec<u8>),
}

/// A TFLite file with the table `model`.
pub(crate) fn file(model: &Part) -> Vec<u8> {
    let mut out = vec![0; 4];
    out.extend(b"TFL3");
    let at = write(model, &mut out);
    put(&mut out, 0, at as u32);
    out
}

fn put(out: &mut [u8], at: usize, value: u32) {
    out[at..at + 4].copy_from_slice(&value.to_le_bytes());
}

/// Writes the parts that the offsets at these positions refer to.
fn refer(places: Vec<(usize, &Part)>, out: &mut Vec<u8>) {
    for (place, part) in places {
        let at = write(part, out);
        put(out, place, (at - place) as u32);
    }
}

fn write(part: &Part, out: &mut Vec<u8>) -> usize {
    out.resize(out.len().next_multiple_of(4), 0);
    match part {
        Part::Table(fields) => write_table(fields, out),
        Part::Bytes(bytes) => {
            let at = out.len();
            out.extend((bytes.len() as u32).to_le_bytes());
            out.extend(bytes);
            at
        }
        Part::Ints(values) => {
            let at = out.len();
            out.extend((values.len() as u32).to_le_bytes());
            out.extend(values.iter().flat_map(|value| value.to_le_bytes()));
            at
        }
        Part::Tables(tables) => {
            let at = out.len();
            out.extend((tables.len() as u32).to_le_bytes());
            let first = out.len();
            out.resize(first + 4 * tables.len(), 0);
            let places = tables.iter().enumerate();
            refer(places.map(|(i, it)| (first + 4 * i, it)).collect(), out);
            at
        }
    }
}

fn write_table(fields: &[(usize, Field)], out: &mut Vec<u8>) -> usize {
    let n = fields
        .iter()
        .map(|(number, _)| number + 1)
        .max()
        .unwrap_or(0);
    let kinds = out.len();
    let table = (kinds + 4 + 2 * n).next_multiple_of(4);
    out.resize(table, 0);
    out[kinds..kinds + 2].copy_from_slice(&((4 + 2 * n) as u16).to_le_bytes());
    out.extend(((table - kinds) as u32).to_le_bytes());
    let mut places = Vec::new();
    for (number, field) in fields {
        let (entry, offset) = (kinds + 4 + 2 * number, out.len() - table);
        out[entry..entry + 2].copy_from_slice(&(offset as u16).to_le_bytes());
        let value = match field {
            Field::Byte(value) => u32::from(*value),
            Field::Int(value) => value.cast_unsigned(),
            Field::To(part) => {
                places.push((out.len(), part));
                0
            }
        };
        out.extend(value.to_le_bytes());
    }
    refer(places, out);
    table
}

/// A tensor of a [`Network`].
#[derive(Debug, Clone)]
pub(crate) struct Tensor {
    shape: Vec<i32>,
    /// 0 for floats of 32 bits, 1 for floats of 16 bits, 2 for whole numbers of 32 bits.
    elements: u8,
    data: Vec<u8>,
}

/// An operator: code, inputs, output and options.
pub(crate) type Operator = (u8, Vec<i32>, i32, Vec<(usize, Field)>);

/// A graph under construction. Its first tensor is its input.
#[derive(Debug, Clone)]
pub(crate) struct Network {
    pub(crate) tensors: Vec<Tensor>,
    pub(crate) operators: Vec<Operator>,
    pub(crate) outputs: Vec<i32>,
}

impl Network {
    /// A graph with an image as its input.
    pub(crate) fn new(shape: [i32; 3]) -> Self {
        let mut network = Self {
            tensors: Vec::new(),
            operators: Vec::new(),
            outputs: Vec::new(),
        };
        network.image(shape);
        network
    }

    fn tensor(&mut self, shape: &[i32], elements: u8, data: Vec<u8>) -> i32 {
        self.tensors.push(Tensor {
            shape: shape.to_vec(),
            elements,
            data,
        });
        self.tensors.len() as i32 - 1
    }

    /// A tensor without a constant value.
    pub(crate) fn image(&mut self, [rows, columns, channels]: [i32; 3]) -> i32 {
        self.tensor(&[1, rows, columns, channels], 0, Vec::new())
    }

    pub(crate) fn floats(&mut self, shape: &[i32], values: &[f32]) -> i32 {
        let data = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        self.tensor(shape, 0, data)
    }

    pub(crate) fn ints(&mut self, shape: &[i32], values: &[i32]) -> i32 {
        let data = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        self.tensor(shape, 2, data)
    }

    /// Weights of 16 bits behind the operator DEQUANTIZE.
    pub(crate) fn halves(&mut self, shape: &[i32], values: &[f32]) -> i32 {
        let halves = values.iter().map(|&value| half::f16::from_f32(value));
        let data = halves.flat_map(half::f16::to_le_bytes).collect();
        let stored = self.tensor(shape, 1, data);
        let read = self.tensor(shape, 0, Vec::new());
        self.operators.push((6, vec![stored], read, Vec::new()));
        read
    }

    /// Adds an operator that computes an image.
    pub(crate) fn operator(
        &mut self,
        code: u8,
        inputs: &[i32],
        options: &[(usize, Field)],
        shape: [i32; 3],
    ) -> i32 {
        let output = self.image(shape);
        let operator = (code, inputs.to_vec(), output, options.to_vec());
        self.operators.push(operator);
        output
    }

    /// The TFLite file.
    pub(crate) fn file(&self) -> Vec<u8> {
        let table = |fields: Vec<(usize, Field)>| Part::Table(fields);
        let tables = |parts: Vec<Part>| Field::To(Part::Tables(parts));
        let ints = |values: &[i32]| Field::To(Part::Ints(values.to_vec()));
        let tensors = self.tensors.iter().enumerate().map(|(i, it)| {
            let buffer = Field::Int(i as i32);
            table(vec![
                (0, ints(&it.shape)),
                (1, Field::Byte(it.elements)),
                (2, buffer),
            ])
        });
        let buffers = self.tensors.iter().map(|it| {
            let data = (!it.data.is_empty()).then(|| Field::To(Part::Bytes(it.data.clone())));
            table(data.map(|data| (0, data)).into_iter().collect())
        });
        let codes = self.operators.iter().map(|(code, ..)| {
            let code_new = Field::Int(i32::from(*code));
            table(vec![(0, Field::Byte(*code)), (3, code_new)])
        });
        let operators = self.operators.iter().enumerate();
        let operators = operators.map(|(i, (_, inputs, output, options))| {
            table(vec![
                (0, Field::Int(i as i32)),
                (1, ints(inputs)),
                (2, ints(&[*output])),
                (4, Field::To(Part::Table(options.clone()))),
            ])
        });
        let graph = table(vec![
            (0, tables(tensors.collect())),
            (1, ints(&[0])),
            (2, ints(&self.outputs)),
            (3, tables(operators.collect())),
        ]);
        file(&table(vec![
            (0, Field::Int(3)),
            (1, tables(codes.collect())),
            (2, tables(vec![graph])),
            (4, tables(buffers.collect())),
        ]))
    }
}

/// Rows, columns and channels of the maps of [`small`].
pub(crate) const SMALL_MAPS: [usize; 3] = [4, 4, 3];

/// A network with every operator that is converted: an image of 8 x 8 to maps of 4 x 4, of which 2 are of keypoints. One
/// output more does not belong to the maps.
pub(crate) fn small() -> Network {
    let mut net = Network::new([8, 8, 3]);
    let [same, valid] = [Field::Byte(0), Field::Byte(1)];
    let (one, two) = (Field::Int(1), Field::Int(2));
    let relu6 = Field::Byte(3);
    let weights: Vec<f32> = (0..4 * 9 * 3)
        .map(|i| (i % 7) as f32 / 8.0 - 0.25)
        .collect();
    let w = net.halves(&[4, 3, 3, 3], &weights);
    let b = net.floats(&[4], &[0.5, -0.5, 0.25, 0.0]);
    let options = [
        (0, same.clone()),
        (1, two.clone()),
        (2, two.clone()),
        (3, relu6),
    ];
    let x = net.operator(3, &[0, w, b], &options, [4, 4, 4]);
    let w = net.floats(&[1, 3, 3, 4], &weights[..36]);
    let options = [
        (0, same),
        (1, one.clone()),
        (2, one.clone()),
        (4, Field::Byte(1)),
    ];
    let deep = net.operator(4, &[x, w], &options, [4, 4, 4]);
    let sum = net.operator(0, &[x, deep], &[], [4, 4, 4]);
    let pads = net.ints(&[4, 2], &[0, 0, 1, 1, 0, 2, 0, 0]);
    let padded = net.operator(34, &[sum, pads], &[], [6, 6, 4]);
    let window = [
        (0, valid.clone()),
        (1, two.clone()),
        (2, two.clone()),
        (3, two.clone()),
        (4, two),
    ];
    let pooled = net.operator(17, &[padded], &window, [3, 3, 4]);
    let size = net.ints(&[2], &[4, 4]);
    let large = net.operator(23, &[pooled, size], &[(3, Field::Byte(1))], [4, 4, 4]);
    let active = net.operator(19, &[large], &[], [4, 4, 4]);
    let active = net.operator(21, &[active], &[], [4, 4, 4]);
    let active = net.operator(14, &[active], &[], [4, 4, 4]);
    let w = net.floats(&[3, 1, 1, 4], &weights[..12]);
    let options = [(0, valid), (1, one.clone()), (2, one)];
    let maps = net.operator(3, &[active, w, -1], &options, [4, 4, 3]);
    // An operator that is not converted, for the other output.
    let other = net.operator(25, &[active], &[], [1, 1, 7]);
    net.outputs = vec![other, maps];
    net
}
