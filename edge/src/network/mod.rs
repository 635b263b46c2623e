//! Networks from ONNX files, run by ONNX Runtime if found and by `ort-tract` otherwise.
//!
//! [`InferenceBackend`] finds and starts the backend, once per process, after a trial in another
//! process ([`answer_trial`]). [`OnnxKeypointNetwork`] is a network of the pipeline. A file that
//! does not match its card is refused at the start.

mod backend;
mod library;
mod model;
mod outputs;
mod providers;
mod simcc;
mod trial;

use std::path::{Path, PathBuf};

use farfield_proto::model_card::{HeatmapCard, HeatmapTensors};
use farfield_proto::venue::Provider;

use crate::inference::{InputTensor, KeypointNetwork, NetworkError};

use self::simcc::SimccMaps;

pub use backend::{BackendChoice, InferenceBackend, answer_trial};
pub(crate) use model::{Contract, OnnxModel, OutputTensor, TensorAxis, read_card};

/// A network that turns crops into part confidence maps, from an ONNX file and its card.
#[derive(Debug)]
pub struct OnnxKeypointNetwork {
    card_path: PathBuf,
    provider: Provider,
    card: HeatmapCard,
    model: OnnxModel,
    /// The decoder of a network without maps.
    simcc: Option<SimccMaps>,
    /// All inputs of a call, one after the other.
    values: Vec<f32>,
}

impl OnnxKeypointNetwork {
    /// Reads the card at `card_path` and loads its network. One zero crop is run, so that exports
    /// without stated shapes are also checked.
    ///
    /// # Errors
    /// [`NetworkError`] with the file, if a file cannot be read, the model is not ONNX, or its
    /// input or output does not match the card; also if no backend starts.
    pub fn load(card_path: &Path) -> Result<Self, NetworkError> {
        Self::load_on(card_path, Provider::Cpu)
    }

    /// Like [`Self::load`], on `provider`.
    ///
    /// # Errors
    /// Those of [`Self::load`]; also if the backend lacks the provider, or that refuses the
    /// network.
    pub fn load_on(card_path: &Path, provider: Provider) -> Result<Self, NetworkError> {
        let text = read_card(card_path)?;
        let card = HeatmapCard::parse(&text, card_path)?;
        let simcc = match &card.output.tensors {
            HeatmapTensors::Maps(_) => None,
            HeatmapTensors::Simcc(simcc) => Some(SimccMaps::new(&card, simcc)),
        };
        let contract = Contract {
            input: &card.input,
            outputs: &outputs_of(&card, simcc.as_ref()),
        };
        let mut model = OnnxModel::load(&card.file, text.as_bytes(), &contract, provider)?;
        model.try_out(&contract)?;
        Ok(Self {
            card_path: card_path.to_owned(),
            provider,
            card,
            model,
            simcc,
            values: Vec::new(),
        })
    }

    /// Fingerprint of the model's file and its card: 16 hexadecimal digits.
    pub fn model_hash(&self) -> &str {
        self.model.hash()
    }
}

impl KeypointNetwork for OnnxKeypointNetwork {
    fn card(&self) -> &HeatmapCard {
        &self.card
    }

    fn infer(&mut self, inputs: &[InputTensor]) -> Result<Vec<f32>, NetworkError> {
        let Self {
            card, model, simcc, ..
        } = self;
        let shape = output_shape(card);
        let mut maps = Vec::with_capacity(inputs.len() * shape.iter().product::<usize>());
        // An export with a fixed batch takes that many at a time; the last batch is padded with
        // zeros.
        for inputs in inputs.chunks(model.batch().unwrap_or(inputs.len()).max(1)) {
            let batch = model.batch().unwrap_or(inputs.len());
            self.values.clear();
            for input in inputs {
                self.values.extend_from_slice(&input.values);
            }
            let per_input = model.values_per_input();
            check_length(self.values.len(), inputs.len() * per_input)?;
            self.values.resize(batch * per_input, 0.0);
            model.run(batch, &self.values, |outputs, _| {
                append_maps(outputs, shape, [inputs.len(), batch], simcc, &mut maps)
            })?;
        }
        Ok(maps)
    }

    fn another(&self) -> Result<Option<Box<dyn KeypointNetwork>>, NetworkError> {
        let other = Self::load_on(&self.card_path, self.provider)?;
        if other.model_hash() != self.model_hash() {
            return Err(NetworkError::Model {
                path: self.card.file.clone(),
                problem: "the file has changed since it was loaded: start the edge again"
                    .to_owned(),
            });
        }
        Ok(Some(Box::new(other)))
    }
}

/// Appends the maps of the first `n` of `batch` inputs.
fn append_maps(
    outputs: &[OutputTensor<'_>],
    shape: [usize; 3],
    [n, batch]: [usize; 2],
    simcc: &mut Option<SimccMaps>,
    maps: &mut Vec<f32>,
) -> Result<(), NetworkError> {
    match (simcc, outputs) {
        (None, [output]) => {
            let per_crop: usize = shape.iter().product();
            check_length(output.values.len(), batch * per_crop)?;
            maps.extend_from_slice(&output.values[..n * per_crop]);
        }
        (Some(simcc), [x, y]) => {
            for (output, bins) in [x, y].into_iter().zip(simcc.n_bins()) {
                check_length(output.values.len(), batch * shape[0] * bins)?;
            }
            simcc.decode(n * shape[0], x.values, y.values, maps);
        }
        (simcc, outputs) => check_length(outputs.len(), 1 + usize::from(simcc.is_some()))?,
    }
    Ok(())
}

fn check_length(got: usize, expected: usize) -> Result<(), NetworkError> {
    if got == expected {
        Ok(())
    } else {
        Err(NetworkError::Length { got, expected })
    }
}

/// The outputs that the card demands of the model, each with its axes.
fn outputs_of<'a>(
    card: &'a HeatmapCard,
    simcc: Option<&SimccMaps>,
) -> Vec<(&'a str, Vec<TensorAxis>)> {
    let [keypoints, height, width] = output_shape(card);
    let output = |name: &'a str, sides: &[(&'static str, usize)]| {
        let maps = ("maps, as the card lists keypoints", keypoints);
        let fixed = [maps].into_iter().chain(sides.iter().copied());
        let fixed = fixed.map(|(what, n)| TensorAxis::Fixed(what, n));
        let axes = [TensorAxis::Batch].into_iter().chain(fixed);
        (name, axes.collect())
    };
    match &card.output.tensors {
        HeatmapTensors::Maps(name) => vec![output(name, &[("rows", height), ("columns", width)])],
        HeatmapTensors::Simcc(names) => {
            let [x, y] = simcc.map_or([0; 2], SimccMaps::n_bins);
            vec![
                output(&names.x, &[("bins", x)]),
                output(&names.y, &[("bins", y)]),
            ]
        }
    }
}

fn output_shape(card: &HeatmapCard) -> [usize; 3] {
    [
        card.output.keypoints.len(),
        card.output.height as usize,
        card.output.width as usize,
    ]
}
