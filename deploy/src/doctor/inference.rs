//! Inference: the library that runs networks on this machine, and the speed of keypoint networks and detectors.

use std::path::Path;

use farfield_edge::detector::OnnxDetector;
use farfield_edge::inference::{DetectorInput, DetectorWindow, NetworkError, PersonDetector as _};
use farfield_edge::live::rate::PLANNED;
use farfield_edge::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};
use farfield_edge::node::{Acceleration, Workers, accelerate, find_workers};
use farfield_edge::pipeline::Batch;
use farfield_node::clock;
use farfield_proto::model_card::ModelCard;
use farfield_proto::venue::{Provider, Venue};
use farfield_sim::embedded;
use image::RgbImage;

use crate::report_lines::ReportLines;

const INFERENCE: &str = "inference";
const INSTALL: &str = "pip install --upgrade onnxruntime, or set ORT_DYLIB_PATH to the library";
/// Remedy for a library that does not run here.
const LIBRARY: &str = "pip install --upgrade onnxruntime, then unset ORT_DYLIB_PATH, or set it to a libonnxruntime.so of that package";
/// Remedy for a library that is skipped.
const REFUSED: &str = "remove the library that cannot be used, or install it again";
/// Remedies for a network or detector of the venue file.
const NETWORK: &str = "correct `network` in the venue file, or its card";
const DETECTOR: &str = "correct `detector` in the venue file, or its card";

/// Remedy for a provider that cannot be used.
const PROVIDERS: &str = "install an ONNX Runtime that has it (`onnxruntime-openvino`, `onnxruntime-gpu`), or remove it from `providers`";
/// Remedy for a machine that is too slow for one person.
const TOO_SLOW: &str = "lower `rate_hz`, use a smaller `network`, set `[inference] providers`, or run the edges on a faster computer";
/// Remedy for a folder in which the embedded networks cannot be written.
const TEMPORARY: &str = "set TMPDIR to a writable folder with some megabytes of free space";

/// Starts the backend and runs the networks of the venue; without any, the embedded ones.
pub(super) fn check_inference(venue: Option<&Venue>, report: &mut ReportLines) {
    if check_backend(report) {
        check_networks(venue, report);
    }
}

/// Starts the backend and runs the network of `card`.
pub(crate) fn check_card(card: &Path, kind: &ModelCard, remedy: &str, report: &mut ReportLines) {
    if !check_backend(report) {
        return;
    }
    let what = card.display().to_string();
    match kind {
        ModelCard::Heatmap(_) => drop(check_network(card, (&what, remedy), report)),
        ModelCard::Detector(_) => check_detector(card, (&what, remedy), report),
    }
}

/// Starts the backend; `false` if there is none.
fn check_backend(report: &mut ReportLines) -> bool {
    let backend = match InferenceBackend::start(BackendChoice::Best) {
        Ok(backend) => backend,
        Err(error) => {
            report.fail(INFERENCE, error.to_string(), LIBRARY);
            return false;
        }
    };
    if backend.is_tract() {
        report.warn(INFERENCE, backend.describe(), INSTALL);
    } else {
        let providers = backend.providers().join(", ");
        let text = format!("{}, built with {providers}", backend.describe());
        if backend.has_refused() {
            report.warn(INFERENCE, text, REFUSED);
        } else {
            report.ok(INFERENCE, text);
        }
    }
    true
}

/// Runs the networks of the venue; without any, the embedded ones.
fn check_networks(venue: Option<&Venue>, report: &mut ReportLines) {
    let network = venue.and_then(|venue| venue.network.as_deref());
    let detector = venue.and_then(|venue| venue.detector.as_deref());
    if let (Some(card), Some(venue)) = (network, venue) {
        let what = card.display().to_string();
        let on_processor = check_network(card, (what.as_str(), NETWORK), report);
        let on_providers = check_providers(card, venue, report);
        if let Some(crops_per_s) = on_processor.map(|it| on_providers.unwrap_or(0.0).max(it)) {
            judge_people(venue, crops_per_s, report);
        }
    }
    if let Some(card) = detector {
        let what = card.display().to_string();
        check_detector(card, (what.as_str(), DETECTOR), report);
    }
    if network.or(detector).is_none() {
        check_embedded(report);
    }
}

/// Runs the embedded networks, which a backend reads from files.
fn check_embedded(report: &mut ReportLines) {
    let folder = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => {
            let problem = format!("cannot create a temporary folder: {error}");
            report.fail(INFERENCE, problem, TEMPORARY);
            return;
        }
    };
    let folder = folder.path();
    let written = embedded::write_network(folder)
        .and_then(|network| Ok([network, embedded::write_detector(folder)?]));
    match written {
        Ok([network, detector]) => {
            let what = ("the network of the demo", LIBRARY);
            check_network(&folder.join(network), what, report);
            let what = ("the detector of the demo", LIBRARY);
            check_detector(&folder.join(detector), what, report);
        }
        Err(error) => report.fail(INFERENCE, error.to_string(), TEMPORARY),
    }
}

/// Reports how many crops per second the network of `card` processes. Takes its display name and a remedy. Returns the
/// highest rate.
fn check_network(
    card: &Path,
    (what, remedy): (&str, &str),
    report: &mut ReportLines,
) -> Option<f64> {
    match measured_workers(card) {
        Ok(found) => {
            let rates = found.iter().map(|it| match it.workers {
                1 => format!("{:.0} crops per second on one thread", it.crops_per_s),
                workers => format!("{:.0} on {workers}", it.crops_per_s),
            });
            let rates: Vec<String> = rates.collect();
            report.ok(INFERENCE, format!("{what}: {}", rates.join(", ")));
            found.last().map(|best| best.crops_per_s)
        }
        Err(error) => {
            report.fail(INFERENCE, error.to_string(), remedy);
            None
        }
    }
}

/// Reports how many people an edge of `venue` can track on this machine. Fails if a live camera needs more.
pub(super) fn judge_people(venue: &Venue, crops_per_s: f64, report: &mut ReportLines) {
    let rate_hz = venue.rate_hz;
    let people = people_at(rate_hz, crops_per_s);
    let is_live = venue.cameras.iter().any(|camera| camera.source.is_live());
    if people > 0 || !is_live {
        let text = format!(
            "an edge on this machine can track {people} people of a viewpoint at {rate_hz} Hz, live"
        );
        return report.ok(INFERENCE, text);
    }
    let text = format!(
        "an edge on this machine processes {crops_per_s:.0} crops per second and plans with {:.0} of them: one person at {rate_hz} Hz needs {rate_hz}",
        PLANNED * crops_per_s
    );
    report.fail(INFERENCE, text, TOO_SLOW);
}

/// How many people of one viewpoint an edge can track that processes so many crops per second.
pub(crate) fn people_at(rate_hz: f64, crops_per_s: f64) -> u32 {
    (PLANNED * crops_per_s / rate_hz) as u32
}

/// Reports the execution providers that run the network of `card`, where the venue names any. Returns the most crops
/// per second.
fn check_providers(card: &Path, venue: &Venue, report: &mut ReportLines) -> Option<f64> {
    let mut most = None;
    let requested = venue.viewpoints.iter().map(|it| &it.providers);
    let mut requested: Vec<_> = requested.filter(|it| !it.is_empty()).collect();
    requested.dedup();
    for providers in requested {
        match accelerated(card, providers) {
            Ok(found) => {
                most = Some(found.workers.crops_per_s.max(most.unwrap_or(0.0)));
                if found.refused.is_empty() {
                    report.ok(INFERENCE, found.describe());
                } else {
                    report.warn(INFERENCE, found.describe(), PROVIDERS);
                }
            }
            Err(error) => report.fail(INFERENCE, error.to_string(), NETWORK),
        }
    }
    most
}

fn accelerated(card: &Path, providers: &[Provider]) -> Result<Acceleration, NetworkError> {
    let mut batch = Batch::new(Box::new(OnnxKeypointNetwork::load(card)?));
    accelerate(&mut batch, card, providers)
}

/// The speed of the network of `card` with each number of workers, up to the fastest.
///
/// # Errors
/// When the network cannot be loaded or run.
pub(crate) fn measured_workers(card: &Path) -> Result<Vec<Workers>, NetworkError> {
    let network = OnnxKeypointNetwork::load(card)?;
    find_workers(&mut Batch::new(Box::new(network)))
}

/// Reports how long the detector of `card` takes for an image. Takes its display name and a remedy.
fn check_detector(card: &Path, (what, remedy): (&str, &str), report: &mut ReportLines) {
    match OnnxDetector::load(card).and_then(|mut detector| image_s(&mut detector)) {
        Ok((took_s, [width, height])) => report.ok(
            INFERENCE,
            format!(
                "{what}: {:.1} ms per image of {width} x {height} on one thread",
                1000.0 * took_s
            ),
        ),
        Err(error) => report.fail(INFERENCE, error.to_string(), remedy),
    }
}

/// Time of the detector for an image of its input size, seconds, and that size, pixels.
fn image_s(detector: &mut OnnxDetector) -> Result<(f64, [u32; 2]), NetworkError> {
    let DetectorInput { size_px, letterbox } = detector.input();
    let [width, height] = size_px;
    let picture = RgbImage::new(width, height).into();
    let window = DetectorWindow::whole(size_px, size_px, letterbox);
    // Loading has run one already; one more is enough, as large detectors are slow.
    let start = clock::now();
    detector.detect(&picture, &window)?;
    Ok((clock::now().duration_since(start).as_secs_f64(), size_px))
}
