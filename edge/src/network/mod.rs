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
mod trial;

use std::path::{Path, PathBuf};

use farfield_proto::model_card::HeatmapCard;
use farfield_proto::venue::Provider;

use crate::inference::{InputTensor, KeypointNetwork, NetworkError};

pub use backend::{BackendChoice, InferenceBackend, answer_trial};
pub(crate) use model::{Contract, OnnxModel, TensorAxis, read_card};

/// A network that turns crops into part confidence maps, from an ONNX file and its card.
#[derive(Debug)]
pub struct OnnxKeypointNetwork {
    card_path: PathBuf,
    provider: Provider,
    card: HeatmapCard,
    model: OnnxModel,
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
        let [keypoints, height, width] = output_shape(&card);
        let contract = Contract {
            input: &card.input,
            output: &card.output.name,
            axes: &[
                TensorAxis::Batch,
                TensorAxis::Fixed("maps, as the card lists keypoints", keypoints),
                TensorAxis::Fixed("rows", height),
                TensorAxis::Fixed("columns", width),
            ],
        };
        let mut model = OnnxModel::load(&card.file, text.as_bytes(), &contract, provider)?;
        model.try_out(&contract)?;
        Ok(Self {
            card_path: card_path.to_owned(),
            provider,
            card,
            model,
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
        let per_crop: usize = output_shape(&self.card).iter().product();
        let mut maps = Vec::with_capacity(inputs.len() * per_crop);
        // An export with a fixed batch takes that many at a time; the last batch is padded with
        // zeros.
        for inputs in inputs.chunks(self.model.batch().unwrap_or(inputs.len()).max(1)) {
            let batch = self.model.batch().unwrap_or(inputs.len());
            self.values.clear();
            for input in inputs {
                self.values.extend_from_slice(&input.values);
            }
            let got = self.values.len();
            let per_input = self.model.values_per_input();
            if got != inputs.len() * per_input {
                return Err(NetworkError::Length {
                    got,
                    expected: inputs.len() * per_input,
                });
            }
            self.values.resize(batch * per_input, 0.0);
            self.model.run(batch, &self.values, |_, values| {
                if values.len() != batch * per_crop {
                    return Err(NetworkError::Length {
                        got: values.len(),
                        expected: batch * per_crop,
                    });
                }
                maps.extend_from_slice(&values[..inputs.len() * per_crop]);
                Ok(())
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

fn output_shape(card: &HeatmapCard) -> [usize; 3] {
    [
        card.output.keypoints.len(),
        card.output.height as usize,
        card.output.width as usize,
    ]
}
