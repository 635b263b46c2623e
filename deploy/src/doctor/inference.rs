//! Inference: which library runs networks here, and how fast those that see crops and those that find people.

use std::path::Path;

use farfield_edge::detector::OnnxDetector;
use farfield_edge::inference::{DetectorInput, DetectorWindow, NetworkError, PersonDetector as _};
use farfield_edge::live::rate::PLANNED;
use farfield_edge::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};
use farfield_edge::node::{Acceleration, Workers, accelerate, find_workers};
use farfield_edge::pipeline::Batch;
use farfield_node::clock;
use farfield_proto::venue::{Provider, Venue};
use farfield_sim::embedded;
use image::RgbImage;

use crate::report_lines::ReportLines;

const INFERENCE: &str = "inference";
const INSTALL: &str = "pip install --upgrade onnxruntime, or set ORT_DYLIB_PATH to the library";
/// What mends a library that does not run here.
const LIBRARY: &str = "pip install --upgrade onnxruntime, then unset ORT_DYLIB_PATH, or set it to a libonnxruntime.so of that package";
/// What mends a library that is passed over.
const REFUSED: &str = "remove the library that cannot be used, or install it again";
/// What mends a network that the venue file names.
const NETWORK: &str = "correct `network` in the venue file, or its card";
const DETECTOR: &str = "correct `detector` in the venue file, or its card";

/// What mends a provider that cannot be used.
const PROVIDERS: &str = "install an ONNX Runtime that has it (`onnxruntime-openvino`, `onnxruntime-gpu`), or take it out of `providers`";
/// What mends a machine that is too slow for one person.
const TOO_SLOW: &str = "lower `rate_hz`, take a smaller `network`, name `[inference] providers`, or run the edges on a faster computer";
/// What mends a folder in which the carried networks cannot be written.
const TEMPORARY: &str = "set TMPDIR to a folder that can be written and has some megabytes of room";

/// Starts the backend and runs the venue's networks, or where it names none those that the program carries.
pub(super) fn look_at_inference(venue: Option<&Venue>, report: &mut ReportLines) {
    let backend = match InferenceBackend::start(BackendChoice::Best) {
        Ok(backend) => backend,
        Err(error) => {
            report.fail(INFERENCE, error.to_string(), LIBRARY);
            return;
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
    let network = venue.and_then(|venue| venue.network.as_deref());
    let detector = venue.and_then(|venue| venue.detector.as_deref());
    if let (Some(card), Some(venue)) = (network, venue) {
        let what = card.display().to_string();
        let on_processor = look_at_network(card, (what.as_str(), NETWORK), report);
        let on_providers = look_at_providers(card, venue, report);
        if let Some(crops_per_s) = on_processor.map(|it| on_providers.unwrap_or(0.0).max(it)) {
            judge_people(venue, crops_per_s, report);
        }
    }
    if let Some(card) = detector {
        let what = card.display().to_string();
        look_at_detector(card, (what.as_str(), DETECTOR), report);
    }
    if network.or(detector).is_none() {
        look_at_carried(report);
    }
}

/// Runs the networks that the program carries, which a backend reads from files.
fn look_at_carried(report: &mut ReportLines) {
    let folder = match tempfile::tempdir() {
        Ok(folder) => folder,
        Err(error) => {
            let problem = format!("no temporary folder can be made: {error}");
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
            look_at_network(&folder.join(network), what, report);
            let what = ("the detector of the demo", LIBRARY);
            look_at_detector(&folder.join(detector), what, report);
        }
        Err(error) => report.fail(INFERENCE, error.to_string(), TEMPORARY),
    }
}

/// Adds how many crops the network of `card` takes in a second: what it is called, and what mends it. Returns the most.
fn look_at_network(
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

/// Adds how many people an edge of `venue` on this machine carries, and fails where a live camera of it asks for more.
pub(super) fn judge_people(venue: &Venue, crops_per_s: f64, report: &mut ReportLines) {
    let rate_hz = venue.rate_hz;
    let people = people_at(rate_hz, crops_per_s);
    let is_live = venue.cameras.iter().any(|camera| camera.source.is_live());
    if people > 0 || !is_live {
        let text =
            format!("an edge here carries {people} people of a viewpoint at {rate_hz} Hz, live");
        return report.ok(INFERENCE, text);
    }
    let text = format!(
        "an edge here makes {crops_per_s:.0} crops per second, of which {:.0} are planned with: one person at {rate_hz} Hz takes {rate_hz}",
        PLANNED * crops_per_s
    );
    report.fail(INFERENCE, text, TOO_SLOW);
}

/// How many people of one viewpoint an edge carries that makes so many crops per second.
pub(crate) fn people_at(rate_hz: f64, crops_per_s: f64) -> u32 {
    (PLANNED * crops_per_s / rate_hz) as u32
}

/// Adds what else than the processor runs the network of `card`, where an edge asks for it. Returns the most crops per second.
fn look_at_providers(card: &Path, venue: &Venue, report: &mut ReportLines) -> Option<f64> {
    let mut most = None;
    let asked = venue.viewpoints.iter().map(|it| &it.providers);
    let mut asked: Vec<_> = asked.filter(|it| !it.is_empty()).collect();
    asked.dedup();
    for providers in asked {
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

/// What each number of workers does with the network of `card`, up to the fastest.
///
/// # Errors
/// When the network cannot be loaded or run.
pub(crate) fn measured_workers(card: &Path) -> Result<Vec<Workers>, NetworkError> {
    let network = OnnxKeypointNetwork::load(card)?;
    find_workers(&mut Batch::new(Box::new(network)))
}

/// Adds how long the detector of `card` takes for a picture: what it is called, and what mends it.
fn look_at_detector(card: &Path, (what, remedy): (&str, &str), report: &mut ReportLines) {
    match OnnxDetector::load(card).and_then(|mut detector| picture_s(&mut detector)) {
        Ok((took_s, [width, height])) => report.ok(
            INFERENCE,
            format!(
                "{what}: {:.1} ms per picture of {width} x {height} on one thread",
                1000.0 * took_s
            ),
        ),
        Err(error) => report.fail(INFERENCE, error.to_string(), remedy),
    }
}

/// How long the detector takes for a picture as large as its input, seconds, and how large that is, pixels.
fn picture_s(detector: &mut OnnxDetector) -> Result<(f64, [u32; 2]), NetworkError> {
    let DetectorInput { size_px, letterbox } = detector.input();
    let [width, height] = size_px;
    let picture = RgbImage::new(width, height).into();
    let window = DetectorWindow::whole(size_px, size_px, letterbox);
    // Loading has run one already; once more is enough, as large ones take their time.
    let start = clock::now();
    detector.detect(&picture, &window)?;
    Ok((clock::now().duration_since(start).as_secs_f64(), size_px))
}
