//! Inference: which library runs networks here, and how fast.

use std::path::PathBuf;
use std::time::Duration;

use farfield_edge::inference::{InputTensor, KeypointNetwork as _, NetworkError};
use farfield_edge::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};
use farfield_node::clock;
use farfield_proto::venue::Venue;
use farfield_sim::embedded;

use crate::report_lines::ReportLines;

const INFERENCE: &str = "inference";
const INSTALL: &str = "pip install onnxruntime, or set ORT_DYLIB_PATH to the library";
/// Crops are run for so long, and so many at most.
const PATIENCE: Duration = Duration::from_millis(600);
const MOST_CROPS: u32 = 50;

/// Starts the backend and runs the venue's network, or the one that the program carries.
pub(super) fn look_at_inference(venue: Option<&Venue>, report: &mut ReportLines) {
    let backend = match InferenceBackend::start(BackendChoice::Best) {
        Ok(backend) => backend,
        Err(error) => {
            report.fail(
                INFERENCE,
                error.to_string(),
                "unset ORT_DYLIB_PATH, or set it to a libonnxruntime.so of the Python package `onnxruntime`",
            );
            return;
        }
    };
    if backend.is_tract() {
        report.warn(INFERENCE, backend.describe(), INSTALL);
    } else {
        let providers = backend.providers().join(", ");
        let text = format!(
            "{}, built with {providers}; the processor is used",
            backend.describe()
        );
        report.ok(INFERENCE, text);
    }
    let card = venue.and_then(|venue| venue.network.clone());
    match crops_per_s(card.clone()) {
        Ok(rate) => {
            let what = card.map_or_else(
                || "the network of the demo".to_owned(),
                |card| card.display().to_string(),
            );
            report.ok(
                INFERENCE,
                format!("{what}: {rate:.0} crops per second on one thread"),
            );
        }
        Err(error) => report.fail(
            INFERENCE,
            error,
            "correct `network` in the venue file, or its card",
        ),
    }
}

/// How many crops the network of `card` takes in a second; without a card, that of the demo.
fn crops_per_s(card: Option<PathBuf>) -> Result<f64, String> {
    let folder =
        tempfile::tempdir().map_err(|error| format!("no temporary folder can be made: {error}"))?;
    let card = if let Some(card) = card {
        card
    } else {
        let name = embedded::write_network(folder.path()).map_err(|error| error.to_string())?;
        folder.path().join(name)
    };
    let mut network = OnnxKeypointNetwork::load(&card).map_err(|error| error.to_string())?;
    run(&mut network).map_err(|error| error.to_string())
}

fn run(network: &mut OnnxKeypointNetwork) -> Result<f64, NetworkError> {
    let input = &network.card().input;
    let crop = InputTensor {
        values: vec![0.0; 3 * input.width as usize * input.height as usize],
    };
    // Loading has run one already, which made the buffers.
    let start = clock::now();
    let mut crops = 0;
    while crops < MOST_CROPS {
        network.infer(std::slice::from_ref(&crop))?;
        crops += 1;
        if clock::now().duration_since(start) > PATIENCE {
            break;
        }
    }
    Ok(f64::from(crops) / clock::now().duration_since(start).as_secs_f64().max(1e-6))
}
