//! One ONNX file, loaded and checked against its card.

use std::path::{Path, PathBuf};

use farfield_proto::model_card::{NetworkInput, unread_card};
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::Provider;
use ort::ep::ExecutionProviderDispatch;
use ort::session::Session;
use ort::session::builder::GraphOptimizationLevel;
use ort::value::{Outlet, TensorElementType, TensorRef, ValueType};

use super::backend::{BackendChoice, InferenceBackend};
use super::outputs::{LABELS, LABELS_AS_FLOATS, reduced};
use super::providers::{compiled_folder, compiles, registration};
use crate::guarded::{first_line, guarded};
use crate::inference::NetworkError;

/// Threads per network. Edges share their cores with decoders and, in tests, with each other; one
/// thread also fixes the order of sums.
const INTRA_THREADS: usize = 1;

/// The expected size of one axis of an output.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum TensorAxis {
    /// One entry per input.
    Batch,
    /// This many; the text names the entries in errors.
    Fixed(&'static str, usize),
    /// Any number.
    Any,
}

/// The card's requirements for its network.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Contract<'a> {
    pub(crate) input: &'a NetworkInput,
    /// Names of the outputs that are read, each with its axes.
    pub(crate) outputs: &'a [(&'a str, Vec<TensorAxis>)],
}

/// One output of a run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OutputTensor<'a> {
    pub(crate) shape: &'a [i64],
    pub(crate) values: &'a [f32],
}

/// A loaded network with one input [batch, 3, height, width] of f32.
#[derive(Debug)]
pub(crate) struct OnnxModel {
    session: Session,
    path: PathBuf,
    hash: String,
    input: String,
    outputs: Vec<String>,
    /// Height and width of the input.
    size_px: [usize; 2],
    /// The fixed batch of the export, if any.
    batch: Option<usize>,
}

/// Reads the text of a model card.
pub(crate) fn read_card(path: &Path) -> Result<String, NetworkError> {
    std::fs::read_to_string(path).map_err(|error| {
        let problem = unread_card(&error, path);
        FileError::new(path, format!("the model card cannot be read: {problem}")).into()
    })
}

/// What a failed download left in place of a network; `None` otherwise. No ONNX file starts with
/// these bytes.
fn stand_in(bytes: &[u8]) -> Option<&'static str> {
    if bytes.starts_with(b"version https://git-lfs") {
        return Some(
            "a pointer of Git LFS and not the network: run `git lfs pull` in its checkout",
        );
    }
    let text = bytes.trim_ascii_start();
    text.starts_with(b"<")
        .then_some("a web page and not the network: download the file itself")
}

impl OnnxModel {
    /// Loads `path` on this process's backend and on `provider`, and checks the shapes that the
    /// file states.
    ///
    /// `card` is the text of the card, which is part of the fingerprint.
    pub(crate) fn load(
        path: &Path,
        card: &[u8],
        contract: &Contract<'_>,
        provider: Provider,
    ) -> Result<Self, NetworkError> {
        let refuse = |problem: String| NetworkError::Model {
            path: path.to_owned(),
            problem,
        };
        let bytes =
            std::fs::read(path).map_err(|e| refuse(format!("the model cannot be read: {e}")))?;
        if let Some(what) = stand_in(&bytes) {
            return Err(refuse(what.to_owned()));
        }
        let hash = blake3::Hasher::new()
            .update(&bytes)
            .update(card)
            .finalize()
            .to_hex()[..16]
            .to_owned();
        let backend = InferenceBackend::start(BackendChoice::Best)?;
        let compiled = compiled_folder(&hash, backend.describe());
        let on = registration(provider, &compiled);
        if compiles(provider) {
            // Without the folder nothing is cached, and the next start takes as long.
            std::fs::create_dir_all(&compiled).ok();
        }
        let session = guarded(|| open(backend, path, &bytes, contract.outputs, on.as_slice())).map_err(|e| {
            let advice = if backend.is_tract() {
                " (ort-tract cannot run every network: install the Python package `onnxruntime`)"
            } else {
                ""
            };
            refuse(match provider {
                Provider::Cpu => format!("not an ONNX model that can be run: {e}{advice}"),
                _ => format!("{} does not run it: {e}", provider.name()),
            })
        })?;
        let NetworkInput {
            name,
            width,
            height,
            ..
        } = contract.input;
        let size_px = [*height as usize, *width as usize];
        let input_axes = [
            TensorAxis::Batch,
            TensorAxis::Fixed("channels", 3),
            TensorAxis::Fixed("rows", size_px[0]),
            TensorAxis::Fixed("columns", size_px[1]),
        ];
        let stated = stated_shape(session.inputs(), "input", name).map_err(refuse)?;
        check_shape("input", name, &stated, &input_axes, None).map_err(refuse)?;
        let batch = stated
            .first()
            .and_then(|&n| usize::try_from(n).ok())
            .filter(|&n| n > 0);
        if let [_, more, ..] = session.inputs() {
            return Err(refuse(format!(
                "it has a second input `{}`, expected only `{name}`",
                more.name()
            )));
        }
        for (name, axes) in contract.outputs {
            let stated = stated_shape(session.outputs(), "output", name).map_err(refuse)?;
            check_shape("output", name, &stated, axes, None).map_err(refuse)?;
        }
        Ok(Self {
            session,
            path: path.to_owned(),
            hash,
            input: name.clone(),
            outputs: contract
                .outputs
                .iter()
                .map(|(name, _)| (*name).to_owned())
                .collect(),
            size_px,
            batch,
        })
    }

    /// Runs one input of zeros and checks the shape of the result.
    pub(crate) fn try_out(&mut self, contract: &Contract<'_>) -> Result<(), NetworkError> {
        let batch = self.batch.unwrap_or(1);
        let zeros = vec![0.0; batch * self.values_per_input()];
        let path = self.path.clone();
        let refuse = |problem| NetworkError::Model {
            path: path.clone(),
            problem,
        };
        let outcome = guarded(|| {
            Ok(self.run(batch, &zeros, |outputs, _| {
                let mut outputs = contract.outputs.iter().zip(outputs);
                outputs.try_for_each(|((name, axes), output)| {
                    check_shape("output", name, output.shape, axes, Some(batch)).map_err(&refuse)
                })
            }))
        });
        outcome.unwrap_or_else(|problem| Err(refuse(format!("cannot be run: {problem}"))))
    }

    /// Fingerprint of the file and its card: 16 hexadecimal digits.
    pub(crate) fn hash(&self) -> &str {
        &self.hash
    }

    /// The fixed batch of the export, if any.
    pub(crate) fn batch(&self) -> Option<usize> {
        self.batch
    }

    pub(crate) fn values_per_input(&self) -> usize {
        3 * self.size_px[0] * self.size_px[1]
    }

    /// Runs `batch` inputs, one after the other in `values`, and passes the outputs of the contract
    /// to `read`, and the values of the output `labels`, if there is one.
    pub(crate) fn run<R>(
        &mut self,
        batch: usize,
        values: &[f32],
        read: impl FnOnce(&[OutputTensor<'_>], Option<&[i64]>) -> Result<R, NetworkError>,
    ) -> Result<R, NetworkError> {
        let path = self.path.clone();
        let failed = |e: ort::Error| NetworkError::Run {
            path: path.clone(),
            problem: e.to_string(),
        };
        let shape = [batch, 3, self.size_px[0], self.size_px[1]];
        let input = TensorRef::from_array_view((shape, values)).map_err(failed)?;
        let outputs = self
            .session
            .run(ort::inputs![self.input.as_str() => input])
            .map_err(failed)?;
        let tensor = |name: &String| {
            let output = outputs.get(name).ok_or_else(|| NetworkError::Run {
                path: path.clone(),
                problem: format!("no output `{name}` came back"),
            })?;
            let (shape, values) = output.try_extract_tensor::<f32>().map_err(failed)?;
            Ok(OutputTensor { shape, values })
        };
        let found: Vec<OutputTensor<'_>> = self
            .outputs
            .iter()
            .map(tensor)
            .collect::<Result<_, NetworkError>>()?;
        let labels = outputs
            .get(LABELS)
            .and_then(|labels| labels.try_extract_tensor::<i64>().ok());
        // Integers, which the reduced file returns as floats.
        let from_floats: Option<Vec<i64>> = outputs
            .get(LABELS_AS_FLOATS)
            .and_then(|labels| labels.try_extract_tensor::<f32>().ok())
            .map(|(_, labels)| labels.iter().map(|&label| label as i64).collect());
        let labels = labels.map(|(_, labels)| labels);
        read(&found, labels.or(from_floats.as_deref()))
    }
}

fn open(
    backend: &InferenceBackend,
    path: &Path,
    bytes: &[u8],
    outputs: &[(&str, Vec<TensorAxis>)],
    on: &[ExecutionProviderDispatch],
) -> Result<Session, String> {
    let text = |e: &dyn std::fmt::Display| first_line(&e.to_string());
    let needed: Vec<&str> = outputs.iter().map(|(name, _)| *name).collect();
    let reduced = backend
        .is_tract()
        .then(|| reduced(bytes, &needed))
        .flatten();
    let mut builder = Session::builder(backend.environment())
        .map_err(|e| text(&e))?
        // Without a level, tract does not optimise at all.
        .with_optimization_level(GraphOptimizationLevel::Level3)
        .map_err(|e| text(&e))?
        .with_intra_threads(INTRA_THREADS)
        .map_err(|e| text(&e))?
        .with_execution_providers(on)
        .map_err(|e| text(&e))?;
    match reduced {
        Some(model) => builder.commit_from_memory(&model),
        // By file name, because weights can be in separate files in the same folder.
        None => builder.commit_from_file(path),
    }
    .map_err(|e| text(&e))
}

/// The shape of the input or output `name` as stated in the file, -1 for open axes.
fn stated_shape(outlets: &[Outlet], kind: &str, name: &str) -> Result<Vec<i64>, String> {
    let Some(outlet) = outlets.iter().find(|outlet| outlet.name() == name) else {
        let names: Vec<String> = outlets
            .iter()
            .map(|outlet| format!("`{}`", outlet.name()))
            .collect();
        return Err(format!(
            "it has no {kind} `{name}`, but {}",
            names.join(", ")
        ));
    };
    match outlet.dtype() {
        ValueType::Tensor {
            ty: TensorElementType::Float32,
            shape,
            ..
        } => Ok(shape.to_vec()),
        other => Err(format!(
            "its {kind} `{name}` is {other}, expected a tensor of 32-bit floats"
        )),
    }
}

/// Checks a shape against the expected one; a size below 0 is open in the file.
fn check_shape(
    kind: &str,
    name: &str,
    got: &[i64],
    axes: &[TensorAxis],
    batch: Option<usize>,
) -> Result<(), String> {
    if got.len() != axes.len() {
        return Err(format!(
            "its {kind} `{name}` has {} axes, expected {}",
            got.len(),
            axes.len()
        ));
    }
    for (&got, &axis) in got.iter().zip(axes) {
        let (what, expected) = match (axis, batch) {
            (TensorAxis::Fixed(what, expected), _) => (what, expected),
            (TensorAxis::Batch, Some(batch)) => ("entries in its batch", batch),
            (TensorAxis::Batch, None) | (TensorAxis::Any, _) => continue,
        };
        if got >= 0 && usize::try_from(got) != Ok(expected) {
            return Err(format!(
                "its {kind} `{name}` has {got} {}, expected {expected} {}",
                first_word(what),
                what
            ));
        }
    }
    Ok(())
}

fn first_word(words: &str) -> &str {
    words.split(',').next().unwrap_or(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remains_of_a_failed_download_are_named() {
        let named = |bytes: &[u8]| stand_in(bytes).unwrap_or_default();
        assert!(named(b"version https://git-lfs.github.com/spec/v1\n").contains("git lfs pull"));
        assert!(named(b"\n<!DOCTYPE html><html>").contains("web page"));
        assert_eq!(stand_in(&[8, 7, 18, 0]), None);
    }
}
