//! People in videos: a detector and a keypoint network process some frames of each camera, as in edges, and write
//! keypoint files. The poses of the cameras are still unknown.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use clap::Args;
use farfield_calibration::people::{LEAST_RATE_HZ, PeopleRequest};
use farfield_calibration::points::Timing;
use farfield_edge::detector::OnnxDetector;
use farfield_edge::inference::KeypointNetwork as _;
use farfield_edge::network::OnnxKeypointNetwork;
use farfield_edge::picture::Picture;
use farfield_edge::pipeline::{EdgePipeline, StepRequest};
use farfield_edge::source::{Frame, FrameContent};
use farfield_node::process::NodeError;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use farfield_proto::id::{CameraIndex, SessionId, ViewpointIndex};
use farfield_proto::keypoints::{COCO17, KeypointSet};
use farfield_proto::message::{BoxSet, Order, Sighting};
use farfield_proto::tick::Tick;
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::cached::{Cached, fingerprint};
use super::lenses::{Lens, lens_of};
use super::recorded::OwnVenue;
use super::recorded::ScanProgress;
use super::{refuse_existing, write};
use crate::init::recordings::{self, Recording, RecordingKind, files_of};
use crate::networks::card_path;

/// Minimum height of a peak, 0 to 1: without a keypoint, networks answer up to slightly less.
const LEAST_SCORE: f64 = 0.1;
/// Increase it whenever the same images and networks give other keypoints.
const REVISION: &str = "1";
/// Valid range of processed frames per second; more than there are means all frames.
const LOOKS_HZ: [f64; 2] = [0.1, 1000.0];
/// Required COCO keypoints of a network; without feet people cannot be placed on the floor.
const NEEDED: [&str; 6] = [
    "left_shoulder",
    "right_shoulder",
    "left_hip",
    "right_hip",
    "left_ankle",
    "right_ankle",
];

/// How people are detected in videos.
#[derive(Debug, Args)]
pub(super) struct FilmedArgs {
    /// Card of the keypoint network, for videos.
    #[arg(long, value_name = "CARD")]
    network: Option<PathBuf>,
    /// Card of the detector, for videos.
    #[arg(long, value_name = "CARD")]
    detector: Option<PathBuf>,
    /// Frames of a video to process per second; rounded to a whole fraction of its rate.
    #[arg(long, value_name = "HZ", default_value_t = 5.0, hide_short_help = true)]
    looks_hz: f64,
    /// Folder for NAME.jsonl: detected people, by camera.
    ///
    /// Each is written after its video was processed. An existing one of the same video, lens, networks and rate is
    /// reused: after an interruption only missing ones are processed.
    #[arg(
        id = "seen_folder",
        long = "seen",
        value_name = "DIR",
        default_value = "seen",
        hide_short_help = true
    )]
    seen: PathBuf,
}

/// Counts that are stored next to a file of keypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct ScanCounts {
    frames: u64,
    /// Processed frames.
    looks: u64,
    /// Detected bodies in all processed frames.
    bodies: u64,
}

/// The videos and folders of images among `paths`; `None` if these are keypoint files, or a recording of fusion.
///
/// # Errors
/// A mix of both, other files among videos, folders of keypoints, unreadable files, two of one camera.
pub(super) fn filmed(paths: &[PathBuf]) -> anyhow::Result<Option<Vec<Recording>>> {
    let mut all = Vec::new();
    let mut other = None;
    for path in paths {
        match recordings::recording(path)? {
            Some(recording) => all.push(recording),
            None if path.is_dir() => {
                let inside = recordings::find(path, None, recordings::OTHER_FOLDER)?;
                if inside.iter().all(has_keypoints) {
                    bail!(
                        "{}: found a folder of keypoint files, expected the files themselves: {}",
                        path.display(),
                        path.join("*.jsonl").display()
                    );
                }
                all.extend(inside);
            }
            None => other = other.or(Some(path)),
        }
    }
    if all.iter().all(has_keypoints) {
        return Ok(None);
    }
    if let Some(other) = other {
        bail!(
            "{}: found neither a video nor a folder of numbered images, expected only those, with one of the extensions {}",
            other.display(),
            recordings::VIDEOS.join(", ")
        );
    }
    if let Some(file) = all.iter().find(|it| has_keypoints(it)) {
        bail!(
            "{}: found keypoints as well as videos, expected only one of the two",
            file.path.display()
        );
    }
    recordings::refuse_same_names(&all)?;
    Ok(Some(all))
}

fn has_keypoints(recording: &Recording) -> bool {
    recording.kind == RecordingKind::Keypoints
}

/// Rates of the videos, by camera.
///
/// # Errors
/// When a video has none.
pub(super) fn rates_hz(recordings: &[Recording]) -> anyhow::Result<BTreeMap<String, f64>> {
    let mut rates_hz = BTreeMap::new();
    for recording in recordings {
        if let Some(rate_hz) = recordings::rate_of_videos(std::slice::from_ref(recording))? {
            rates_hz.insert(recording.name.clone(), rate_hz);
        }
    }
    Ok(rates_hz)
}

/// Number of frames of the longest recording.
///
/// # Errors
/// An unreadable recording, or a camera without a lens.
pub(super) fn most_frames(
    recordings: &[Recording],
    lenses: &BTreeMap<String, Lens>,
) -> anyhow::Result<f64> {
    let mut most = 0;
    for recording in recordings {
        let lens = lens_of(lenses, &recording.name)?;
        most = most.max(OwnVenue::over_a_floor(recording, lens)?.frames()?);
    }
    Ok(most as f64)
}

/// A camera with its recording.
struct FilmedCamera {
    name: String,
    own: OwnVenue,
    frames: u64,
    /// One of so many frames is processed.
    every: u64,
    /// Its lens, as text that differs for every lens.
    lens_text: String,
    file: PathBuf,
}

/// A camera with its earlier result, if that is still valid.
struct CachedCamera {
    camera: FilmedCamera,
    made_of: String,
    cached: Option<ScanCounts>,
}

impl FilmedArgs {
    /// Refuses network options without videos.
    ///
    /// # Errors
    /// Names the options.
    pub(super) fn refuse_without_videos(&self) -> anyhow::Result<()> {
        ensure!(
            self.network.is_none() && self.detector.is_none(),
            "--network and --detector need videos; found keypoint files"
        );
        Ok(())
    }

    /// The keypoint file of each camera; missing ones are created. `rate_hz` is the rate of a camera.
    ///
    /// # Errors
    /// [`NodeError::Refused`] where networks, recordings or lenses cannot be used, or no person is detected;
    /// [`NodeError::Failed`] for errors of the disk.
    pub(super) fn scan(
        &self,
        recordings: &[Recording],
        lenses: &BTreeMap<String, Lens>,
        rate_of: impl Fn(&str) -> Option<f64>,
        replace: bool,
    ) -> Result<BTreeMap<String, PathBuf>, NodeError> {
        let networks = self.load().map_err(NodeError::Refused)?;
        let hashes = [networks.0.model_hash(), networks.1.model_hash()].map(str::to_owned);
        drop(networks);
        let each = recordings.iter().map(|recording| {
            let lens = lens_of(lenses, &recording.name)?;
            let rate_hz = rate_of(&recording.name).with_context(|| {
                format!(
                    "no rate of camera `{}`: set it with --rate-hz",
                    recording.name
                )
            })?;
            self.camera(recording, lens, rate_hz)
        });
        let cameras: anyhow::Result<Vec<FilmedCamera>> = each.collect();
        let cameras = cameras.map_err(NodeError::Refused)?;
        // Hashing whole recordings takes time, so it comes after all other checks.
        let each = cameras.into_iter().zip(recordings);
        let each = each.map(|(camera, recording)| camera.with_cache(recording, &hashes));
        let cameras: anyhow::Result<Vec<CachedCamera>> = each.collect();
        let cameras = cameras.map_err(NodeError::Refused)?;
        let mut images = 0;
        for it in cameras.iter().filter(|it| it.cached.is_none()) {
            refuse_existing(&it.camera.file, replace)?;
            images += it.camera.frames;
        }
        let progress = ScanProgress::new(images);
        let mut files = BTreeMap::new();
        let mut bodies = 0;
        for it in cameras {
            let counts = self.scan_camera(&it, &progress)?;
            let camera = it.camera;
            bodies += counts.bodies;
            progress.say(format_args!(
                "camera {}: {} bodies in {} of {} frames, {}{}",
                camera.name,
                counts.bodies,
                counts.looks,
                counts.frames,
                camera.file.display(),
                if it.cached.is_some() {
                    ", from an earlier scan"
                } else {
                    ""
                }
            ));
            files.insert(camera.name, camera.file);
        }
        if bodies == 0 {
            return Err(NodeError::Refused(anyhow!(
                "no person was detected in any recording: use another detector or network, or let people walk closer to the cameras"
            )));
        }
        Ok(files)
    }

    /// Of a video of `rate_hz`, one of so many frames is processed.
    fn every(&self, rate_hz: f64) -> u64 {
        (rate_hz / self.looks_hz).round().max(1.0) as u64
    }

    /// Refuses a rate at which people move too far between processed frames, if the cameras are not synchronised.
    ///
    /// # Errors
    /// Names the camera and its rate of processed frames.
    pub(super) fn check_scan_rate(&self, request: &PeopleRequest) -> anyhow::Result<()> {
        let cameras = request.cameras.iter();
        for camera in cameras.filter(|_| request.timing != Timing::Synchronised) {
            let rate_hz = camera.rate_hz.unwrap_or(request.rate_hz);
            let looks_hz = rate_hz / self.every(rate_hz) as f64;
            ensure!(
                looks_hz >= LEAST_RATE_HZ,
                "--looks-hz: found {looks_hz:.3} processed frames per second at camera `{}`, expected {LEAST_RATE_HZ} or more, as the \
                 cameras are not synchronised: people move too far in between",
                camera.name
            );
        }
        Ok(())
    }

    fn load(&self) -> anyhow::Result<(OnnxKeypointNetwork, OnnxDetector)> {
        ensure!(
            (LOOKS_HZ[0]..=LOOKS_HZ[1]).contains(&self.looks_hz),
            "--looks-hz: found {}, expected {} to {}",
            self.looks_hz,
            LOOKS_HZ[0],
            LOOKS_HZ[1]
        );
        let (Some(network), Some(detector)) = (&self.network, &self.detector) else {
            bail!(
                "videos need networks: set their cards with --network CARD and --detector CARD, or give keypoint files \
                 instead of videos"
            );
        };
        let network = OnnxKeypointNetwork::load(&card_path(network))?;
        let known = &network.card().output.keypoints;
        if let Some(missing) = NEEDED.iter().find(|name| known.index_of(name).is_none()) {
            bail!(
                "--network: found no keypoint `{missing}` among its {}, expected the names of COCO",
                known.len()
            );
        }
        Ok((network, OnnxDetector::load(&card_path(detector))?))
    }

    fn camera(
        &self,
        recording: &Recording,
        lens: &Lens,
        rate_hz: f64,
    ) -> anyhow::Result<FilmedCamera> {
        let name = &recording.name;
        let own = OwnVenue::over_a_floor(recording, lens)?;
        Ok(FilmedCamera {
            frames: own.frames_to_scan()?,
            own,
            every: self.every(rate_hz),
            lens_text: lens.calibration(name)?,
            file: self.seen.join(format!("{name}.jsonl")),
            name: name.clone(),
        })
    }

    /// The counts of its file, which is created unless it is cached.
    fn scan_camera(
        &self,
        it: &CachedCamera,
        progress: &ScanProgress,
    ) -> Result<ScanCounts, NodeError> {
        if let Some(cached) = &it.cached {
            return Ok(cached.clone());
        }
        let camera = &it.camera;
        let scan = || {
            let (network, detector) = self.load()?;
            VideoScan::new(&camera.own, network, detector)?.run(camera.every, progress)
        };
        let scanned = scan().with_context(|| format!("camera `{}`", camera.name));
        let (counts, text) = scanned.map_err(NodeError::Refused)?;
        // The cache entry comes first: after an interruption between the two writes the scan is repeated.
        let entry = Cached::separate_text(&text, counts.clone(), &it.made_of);
        write(&cache_path(&camera.file), &entry)?;
        write(&camera.file, &text)?;
        Ok(counts)
    }
}

impl FilmedCamera {
    /// Adds the cached result, if it was made by networks with these `hashes`.
    fn with_cache(
        self,
        recording: &Recording,
        hashes: &[String; 2],
    ) -> anyhow::Result<CachedCamera> {
        let every = self.every.to_string();
        let [network, detector] = hashes.each_ref().map(String::as_str);
        let words = [REVISION, network, detector, &self.lens_text, &every];
        let made_of = fingerprint(&words, &files_of(recording)?)?;
        Ok(CachedCamera {
            cached: Cached::find_separate(&cache_path(&self.file), &self.file, &made_of),
            made_of,
            camera: self,
        })
    }
}

/// The cache entry of `file`.
fn cache_path(file: &Path) -> PathBuf {
    file.with_extension("kept.json")
}

/// Runs the networks on the images of one camera.
struct VideoScan<'a> {
    own: &'a OwnVenue,
    model: &'a CameraModel,
    keypoints: KeypointSet,
    pipeline: EdgePipeline,
}

impl<'a> VideoScan<'a> {
    fn new(
        own: &'a OwnVenue,
        network: OnnxKeypointNetwork,
        detector: OnnxDetector,
    ) -> anyhow::Result<Self> {
        let keypoints = network.card().output.keypoints.clone();
        let (network, detector) = (Box::new(network), Box::new(detector));
        let viewpoint = ViewpointIndex(0);
        Ok(Self {
            own,
            model: &own.camera()?.model,
            keypoints,
            pipeline: EdgePipeline::new(own.venue(), viewpoint, Some(network), Some(detector))?,
        })
    }

    /// Detects people in one of `every` frames, with a line for each processed frame.
    fn run(mut self, every: u64, progress: &ScanProgress) -> anyhow::Result<(ScanCounts, String)> {
        let (mut text, mut looks, mut bodies) = (String::new(), 0, 0);
        let own = self.own;
        let frames = own.show(usize::MAX, |number, picture| {
            if number % every == 0 {
                let seen = self.people(number, picture)?;
                looks += 1;
                bodies += seen.len() as u64;
                writeln!(text, "{}", json!({"tick": number, "persons": seen}))?;
            }
            progress.one();
            Ok(())
        })?;
        let counts = ScanCounts {
            frames,
            looks,
            bodies,
        };
        Ok((counts, text))
    }

    fn people(&mut self, number: u64, picture: Picture) -> anyhow::Result<Vec<serde_json::Value>> {
        let tick = Tick(i64::try_from(number)?);
        let boxes = BoxSet {
            session: SessionId(0),
            tick,
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: None,
            detection_cameras: vec![CameraIndex(0)],
            persons: Vec::new(),
        };
        let frame = Frame {
            tick,
            capture_offset_us: 0,
            content: FrameContent::Image(picture),
        };
        let request = StepRequest::of(&boxes);
        let output = self.pipeline.step(&[Some(frame)], &request, &mut |_| {})?;
        let sightings = output.sighting_sets.iter().flat_map(|it| &it.sightings);
        Ok(sightings.map(|it| self.body(it)).collect())
    }

    /// A body in the format of keypoint files: COCO order, distorted pixels.
    fn body(&self, sighting: &Sighting) -> serde_json::Value {
        let each = COCO17.iter().map(|name| {
            let index = self.keypoints.index_of(name)?;
            let peak = sighting.keypoints.get(index)?.as_ref()?;
            let score = f64::from(peak.score);
            let [x, y] = peak.position_px.map(f64::from);
            let drawn = self.model.distort(Pixel::new(x, y))?;
            let rounded = |value: f64, parts: f64| (parts * value).round() / parts;
            (score >= LEAST_SCORE).then(|| {
                [
                    rounded(drawn.x(), 100.0),
                    rounded(drawn.y(), 100.0),
                    rounded(score, 1000.0),
                ]
            })
        });
        json!({"keypoints": each.collect::<Vec<Option<[f64; 3]>>>()})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_files_among_videos_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("seen")).unwrap();
        for name in ["a.mp4", "b.mpeg", "c.jsonl", "run.mcap", "seen/d.jsonl"] {
            std::fs::write(at(name), "").unwrap();
        }
        let videos = |names: &[&str]| filmed(&names.iter().map(|it| at(it)).collect::<Vec<_>>());
        for names in [&["a.mp4", "b.mpeg"], &["b.mpeg", "a.mp4"]] {
            let error = videos(names).unwrap_err().to_string();
            assert!(error.contains("b.mpeg: "), "{error}");
        }
        let error = videos(&["seen"]).unwrap_err().to_string();
        assert!(error.contains("seen/*.jsonl"), "{error}");
        let error = videos(&["a.mp4", "c.jsonl"]).unwrap_err().to_string();
        assert!(error.contains("c.jsonl: "), "{error}");
        for others in ["c.jsonl", "run.mcap"] {
            assert!(videos(&[others]).unwrap().is_none(), "{others}");
        }
        let one = videos(&["a.mp4"]).unwrap().unwrap();
        assert_eq!(one.len(), 1);
    }
}
