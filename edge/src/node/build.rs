//! The parts of an edge that can fail before the first tick: sources, networks, the pipeline.

use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_node::clock;
use farfield_node::process::{Managed, NodeError, say};
use farfield_proto::message::Status;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Provider, Venue, VenueCamera};
use farfield_proto::wire;

use super::acceleration::{Acceleration, Workers, accelerate};
use super::config::EdgeConfig;
use super::worker::{EdgeWork, Parts};
use crate::detector::OnnxDetector;
use crate::inference::{InputTensor, KeypointNetwork, NetworkError, PersonDetector};
use crate::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};
use crate::pipeline::EdgePipeline;
use crate::source::{self, SourceError, SourceInfo, Sources};

/// An edge ready to connect.
pub(super) struct Built {
    pub(super) work: EdgeWork,
    /// Its first status.
    pub(super) status: Status,
}

/// The networks of a venue, loaded and checked against their cards.
pub struct Networks {
    keypoints: Option<OnnxKeypointNetwork>,
    detector: Option<OnnxDetector>,
    /// Fingerprint of both networks and the backend; empty without a network.
    pub hash: String,
    /// A line about the backend and its consequences; empty without a network.
    pub backend: String,
    /// Whether the slow fall-back runs.
    pub is_slow: bool,
}

impl Networks {
    /// Time of the keypoint network for one crop on this machine; `None` without a network.
    ///
    /// # Errors
    /// If the backend fails.
    pub fn crop_time(&mut self) -> Result<Option<Duration>, NetworkError> {
        let Some(network) = &mut self.keypoints else {
            return Ok(None);
        };
        let input = &network.card().input;
        let input = InputTensor {
            values: vec![0.0; 3 * input.width as usize * input.height as usize],
        };
        // The first run of a backend also allocates its buffers.
        network.infer(std::slice::from_ref(&input))?;
        let start = clock::now();
        network.infer(std::slice::from_ref(&input))?;
        Ok(Some(clock::now().duration_since(start)))
    }
}

/// Loads the networks of `venue`, or none if none of `cameras` delivers pictures.
///
/// # Errors
/// If no backend starts, or a file is missing, is not ONNX or does not fit its card.
pub fn load_networks<'a>(
    venue: &Venue,
    cameras: impl IntoIterator<Item = &'a VenueCamera>,
) -> Result<Networks, NetworkError> {
    let pictures = cameras
        .into_iter()
        .any(|camera| camera.source.gives_pictures());
    if !pictures {
        return Ok(Networks {
            keypoints: None,
            detector: None,
            hash: String::new(),
            backend: String::new(),
            is_slow: false,
        });
    }
    let backend = InferenceBackend::start(BackendChoice::Best)?;
    let keypoints = venue
        .network
        .as_deref()
        .map(OnnxKeypointNetwork::load)
        .transpose()?;
    let detector = venue
        .detector
        .as_deref()
        .map(OnnxDetector::load)
        .transpose()?;
    let hashes = [
        keypoints.as_ref().map(OnnxKeypointNetwork::model_hash),
        detector.as_ref().map(OnnxDetector::model_hash),
    ];
    // Runtime and tract agree to 1e-7, but not bit for bit.
    let kind = if backend.is_tract() {
        "tract"
    } else {
        "onnxruntime"
    };
    let parts: Vec<&str> = hashes.into_iter().flatten().chain([kind]).collect();
    let hash = parts.join("+");
    Ok(Networks {
        keypoints,
        detector,
        hash,
        backend: backend.describe().to_owned(),
        is_slow: backend.is_tract(),
    })
}

/// Probes the sources of `cameras` with `sources`; returns the results by camera name.
///
/// # Errors
/// For the first camera whose source does not match the venue or the calibration.
pub fn probe_sources<'a>(
    sources: &dyn Sources,
    venue: &Venue,
    cameras: impl IntoIterator<Item = &'a VenueCamera>,
) -> Result<Vec<(String, SourceInfo)>, SourceError> {
    let probe = |camera: &VenueCamera| {
        let info = sources.probe(camera, venue)?;
        Ok((camera.model.name().to_owned(), info))
    };
    cameras.into_iter().map(probe).collect()
}

/// The same at the start of an edge. A missing live camera is opened when it appears, and the
/// others do not wait for it.
fn probe_what_is_there<'a>(
    sources: &dyn Sources,
    venue: &Venue,
    cameras: impl IntoIterator<Item = &'a VenueCamera>,
) -> Result<Vec<(String, SourceInfo)>, SourceError> {
    let probe = |camera: &VenueCamera| match sources.probe(camera, venue) {
        Err(error @ SourceError::NotThere { .. }) if camera.source.is_live() => {
            say(format_args!("{error}; it is opened when it comes"));
            Ok((camera.model.name().to_owned(), SourceInfo::default()))
        }
        info => Ok((camera.model.name().to_owned(), info?)),
    };
    cameras.into_iter().map(probe).collect()
}

/// Opens everything except the network connection.
pub(super) fn build(config: &EdgeConfig) -> Result<Built, NodeError> {
    let venue = &config.venue;
    let sources = &config.sources;
    let infos = probe_what_is_there(sources.as_ref(), venue, config.cameras());
    let infos = infos.map_err(NodeError::refused)?;
    let ticks = shared_ticks(&infos, config.ticks.as_ref()).map_err(NodeError::refused)?;
    let networks = load_networks(venue, config.cameras()).map_err(NodeError::refused)?;
    let Networks {
        keypoints,
        detector,
        hash,
        backend,
        ..
    } = networks;
    let keypoints = keypoints.map(|network| Box::new(network) as Box<dyn KeypointNetwork>);
    let detector = detector.map(|detector| Box::new(detector) as Box<dyn PersonDetector>);
    let pipeline = EdgePipeline::new(venue, config.viewpoint, keypoints, detector);
    let mut pipeline = pipeline
        .with_context(|| format!("viewpoint {}", config.name))
        .map_err(NodeError::Refused)?;
    let viewpoint = venue.viewpoints.get(usize::from(config.viewpoint.0));
    let requested = viewpoint.map_or(&[][..], |it| &it.providers);
    let (mut backend, mut health) = (backend, NodeHealth::default());
    let measured = if config.may_run_live {
        measure(&mut pipeline, venue, requested).map_err(NodeError::refused)?
    } else {
        None
    };
    let workers = measured.map(|it| note_acceleration(it, config, &mut backend, &mut health));
    let cameras = viewpoint.map(|v| v.cameras.clone()).unwrap_or_default();
    let mut work = EdgeWork::new(Parts {
        venue: Arc::new(venue.clone()),
        viewpoint: config.viewpoint,
        cameras,
        sources: Arc::clone(sources),
        pipeline,
        workers,
    });
    if let Some(from) = config.ticks.as_ref().map(|ticks| ticks.start) {
        work.open(from).map_err(NodeError::Refused)?;
    }
    let status = Status {
        node: config.name.clone(),
        process: RandomState::new().build_hasher().finish(),
        viewpoint: Some(config.viewpoint),
        release: env!("CARGO_PKG_VERSION").to_owned(),
        ready: false,
        venue_hash: venue.hashes.venue.clone(),
        calibration_hash: venue.hashes.calibration.clone(),
        network_hash: hash,
        // The text contains the library's file name.
        backend: wire::cut_text(backend),
        ticks: ticks.map(|ticks| [ticks.start, ticks.end]),
        tick: None,
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: None,
        health: NodeHealth {
            certificate_ends_s: config
                .reach
                .validity
                .and_then(|validity| u64::try_from(validity.until_s).ok()),
            ..health
        },
        agreement: Vec::new(),
    };
    Ok(Built { work, status })
}

/// Adds the backend to `backend` for the operator, and rejected providers to the notices of
/// `health`.
fn note_acceleration(
    acceleration: Acceleration,
    config: &EdgeConfig,
    backend: &mut String,
    health: &mut NodeHealth,
) -> Workers {
    let words = acceleration.describe();
    if !words.is_empty() {
        *backend = format!("{backend}; {words}");
        if config.managed == Managed::Yes {
            say(format_args!("{words}"));
        }
    }
    for refused in acceleration.refused {
        health.notice(refused);
    }
    acceleration.workers
}

/// Chooses the fastest of `requested` and the CPU, with the best number of workers, and configures
/// `pipeline` with it.
fn measure(
    pipeline: &mut EdgePipeline,
    venue: &Venue,
    requested: &[Provider],
) -> Result<Option<Acceleration>, NetworkError> {
    let (Some(batch), Some(card)) = (pipeline.batch(), &venue.network) else {
        return Ok(None);
    };
    accelerate(batch, card, requested).map(Some)
}

/// The ticks that all recordings have, which fusion can request; `None` if all sources are live.
fn shared_ticks(
    infos: &[(String, SourceInfo)],
    requested: Option<&Range<Tick>>,
) -> Result<Option<Range<Tick>>, SourceError> {
    if infos.iter().all(|(_, info)| info.ticks.is_none()) {
        return Ok(None);
    }
    if let Some(requested) = requested {
        source::common_ticks(infos, Some(requested.clone()))?;
    }
    match source::common_ticks(infos, None) {
        // Fusion may have a `--ticks` range. Otherwise it refuses the run for the same reason.
        Err(SourceError::Lengths {
            shared: Some(shared),
            ..
        }) => Ok(Some(shared)),
        Err(error) => Err(error),
        Ok(ticks) => Ok(Some(ticks)),
    }
}
