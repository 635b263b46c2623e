//! People in videos: a detector and a keypoint network look at some frames of each camera, as those of edges do, and whom they
//! saw is a file of keypoints. Nobody knows yet where the cameras stand.

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

use super::kept::{Kept, fingerprint};
use super::lenses::{Lens, lens_of};
use super::progress::LookProgress;
use super::recorded::OwnVenue;
use super::{refuse_existing, write};
use crate::init::rate;
use crate::init::recordings::{self, Recording, RecordingKind, files_of};

/// Least height of a peak that counts, 0 to 1: where there is nothing, networks answer up to a little less.
const LEAST_SCORE: f64 = 0.1;
/// Raise it whenever other keypoints come of the same pictures and networks.
const REVISION: &str = "1";
/// Looks a second that are taken: more than there are frames is all of them.
const LOOKS_HZ: [f64; 2] = [0.1, 1000.0];
/// Keypoints of COCO that a network must know: without feet nobody stands on a floor.
const NEEDED: [&str; 6] = [
    "left_shoulder",
    "right_shoulder",
    "left_hip",
    "right_hip",
    "left_ankle",
    "right_ankle",
];

/// How people are looked for in videos.
#[derive(Debug, Args)]
pub(super) struct FilmedArgs {
    /// Card of the keypoint network, for videos.
    #[arg(long, value_name = "CARD")]
    network: Option<PathBuf>,
    /// Card of the detector, for videos.
    #[arg(long, value_name = "CARD")]
    detector: Option<PathBuf>,
    /// Frames of a video that are looked at, per second; the nearest whole part of its rate.
    #[arg(long, value_name = "HZ", default_value_t = 5.0, hide_short_help = true)]
    looks_hz: f64,
    /// Folder for NAME.jsonl: whom each camera saw.
    ///
    /// Each is written when its video is looked through. One that is there already, of the same video, lens, networks and rate, is
    /// taken as it is: after an interruption only what is missing is looked at.
    #[arg(
        id = "seen_folder",
        long = "seen",
        value_name = "DIR",
        default_value = "seen",
        hide_short_help = true
    )]
    seen: PathBuf,
}

/// What is said beside a file of keypoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Looked {
    /// Frames that there were.
    frames: u64,
    /// Frames that were looked at.
    looks: u64,
    /// Bodies in them, of all frames.
    bodies: u64,
}

/// The videos and folders of pictures that are meant; `None` where these are files of keypoints, or a recording of fusion's.
///
/// # Errors
/// Both together, what is neither beside videos, folders of keypoints, what cannot be read, two of one camera.
pub(super) fn filmed(paths: &[PathBuf]) -> anyhow::Result<Option<Vec<Recording>>> {
    let mut all = Vec::new();
    let mut other = None;
    for path in paths {
        match recordings::recording(path)? {
            Some(recording) => all.push(recording),
            None if path.is_dir() => {
                let inside = recordings::find(path, None, recordings::OTHER_FOLDER)?;
                if inside.iter().all(is_of_keypoints) {
                    bail!(
                        "{}: found a folder of keypoint files, expected these themselves: {}",
                        path.display(),
                        path.join("*.jsonl").display()
                    );
                }
                all.extend(inside);
            }
            None => other = other.or(Some(path)),
        }
    }
    if all.iter().all(is_of_keypoints) {
        return Ok(None);
    }
    if let Some(other) = other {
        bail!(
            "{}: found no video and no folder of numbered pictures, beside videos, expected a name that ends in one of {}",
            other.display(),
            recordings::VIDEOS.join(", ")
        );
    }
    if let Some(file) = all.iter().find(|it| is_of_keypoints(it)) {
        bail!(
            "{}: found keypoints beside videos, expected one or the other",
            file.path.display()
        );
    }
    recordings::refuse_same_names(&all)?;
    Ok(Some(all))
}

fn is_of_keypoints(recording: &Recording) -> bool {
    recording.kind == RecordingKind::Keypoints
}

/// Rates of videos by camera, as they say themselves.
///
/// # Errors
/// When one does not say.
pub(super) fn rates_hz(recordings: &[Recording]) -> anyhow::Result<BTreeMap<String, f64>> {
    let mut rates_hz = BTreeMap::new();
    for recording in recordings {
        if let Some(rate_hz) = rate::of_videos(std::slice::from_ref(recording))? {
            rates_hz.insert(recording.name.clone(), rate_hz);
        }
    }
    Ok(rates_hz)
}

/// Frames of the longest of the recordings.
///
/// # Errors
/// What cannot be read, and a camera without a lens.
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

/// A camera, and how it is looked through.
struct FilmedCamera {
    name: String,
    own: OwnVenue,
    frames: u64,
    /// Of so many frames one is looked at.
    every: u64,
    /// Its lens, in words that tell it from every other.
    lens_text: String,
    file: PathBuf,
}

/// What is there of a camera, and of what it would be made now.
struct KeptCamera {
    camera: FilmedCamera,
    made_of: String,
    kept: Option<Looked>,
}

impl FilmedArgs {
    /// Refuses networks where there is nothing to look at.
    ///
    /// # Errors
    /// The option that says nothing.
    pub(super) fn refuse_without_videos(&self) -> anyhow::Result<()> {
        ensure!(
            self.network.is_none() && self.detector.is_none(),
            "--network and --detector look at videos; found files of keypoints"
        );
        Ok(())
    }

    /// Whom each camera saw, by its name: looked for, and written, where that is not there yet. `rate_hz` is that of a camera.
    ///
    /// # Errors
    /// [`NodeError::Refused`] where networks, recordings or lenses cannot be used, or nobody is seen;
    /// [`NodeError::Failed`] where the disk is in the way.
    pub(super) fn look(
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
                    "no rate of camera `{}`: give it by --rate-hz",
                    recording.name
                )
            })?;
            self.camera(recording, lens, rate_hz)
        });
        let cameras: anyhow::Result<Vec<FilmedCamera>> = each.collect();
        let cameras = cameras.map_err(NodeError::Refused)?;
        // Whole recordings are hashed only where all of them can be looked through.
        let each = cameras.into_iter().zip(recordings);
        let each = each.map(|(camera, recording)| camera.with_kept(recording, &hashes));
        let cameras: anyhow::Result<Vec<KeptCamera>> = each.collect();
        let cameras = cameras.map_err(NodeError::Refused)?;
        let mut pictures = 0;
        for it in cameras.iter().filter(|it| it.kept.is_none()) {
            refuse_existing(&it.camera.file, replace)?;
            pictures += it.camera.frames;
        }
        let progress = LookProgress::new(pictures);
        let mut files = BTreeMap::new();
        let mut bodies = 0;
        for it in cameras {
            let looked = self.see(&it, &progress)?;
            let camera = it.camera;
            bodies += looked.bodies;
            progress.say(format_args!(
                "camera {}: {} bodies in {} of {} frames, {}{}",
                camera.name,
                looked.bodies,
                looked.looks,
                looked.frames,
                camera.file.display(),
                if it.kept.is_some() {
                    ", where they were found earlier"
                } else {
                    ""
                }
            ));
            files.insert(camera.name, camera.file);
        }
        if bodies == 0 {
            return Err(NodeError::Refused(anyhow!(
                "nobody was seen in any recording: look with another detector or network, or let people walk nearer to the cameras"
            )));
        }
        Ok(files)
    }

    /// Of so many frames of a video of `rate_hz` one is looked at.
    fn every(&self, rate_hz: f64) -> u64 {
        (rate_hz / self.looks_hz).round().max(1.0) as u64
    }

    /// Refuses so few looks that people go too far between them, where nothing says which are of one moment.
    ///
    /// # Errors
    /// The camera, and what is looked at of it.
    pub(super) fn check_looks(&self, request: &PeopleRequest) -> anyhow::Result<()> {
        let cameras = request.cameras.iter();
        for camera in cameras.filter(|_| request.timing != Timing::Synchronised) {
            let rate_hz = camera.rate_hz.unwrap_or(request.rate_hz);
            let looks_hz = rate_hz / self.every(rate_hz) as f64;
            ensure!(
                looks_hz >= LEAST_RATE_HZ,
                "--looks-hz: found {looks_hz:.3} looks per second at camera `{}`, expected {LEAST_RATE_HZ} or more of cameras that \
                 are not synchronised: between them people go too far",
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
                "people in videos are seen by networks: give their cards by --network CARD and --detector CARD, or files of \
                 keypoints in place of videos"
            );
        };
        let network = OnnxKeypointNetwork::load(network)?;
        let known = &network.card().output.keypoints;
        if let Some(missing) = NEEDED.iter().find(|name| known.index_of(name).is_none()) {
            bail!(
                "--network: found no keypoint `{missing}` among its {}, expected COCO's names",
                known.len()
            );
        }
        Ok((network, OnnxDetector::load(detector)?))
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
            frames: own.frames_to_look_at()?,
            own,
            every: self.every(rate_hz),
            lens_text: lens.calibration(name)?,
            file: self.seen.join(format!("{name}.jsonl")),
            name: name.clone(),
        })
    }

    /// What is in its file: looked for, and written, where that is not there yet.
    fn see(&self, it: &KeptCamera, progress: &LookProgress) -> Result<Looked, NodeError> {
        if let Some(kept) = &it.kept {
            return Ok(kept.clone());
        }
        let camera = &it.camera;
        let looking = || {
            let (network, detector) = self.load()?;
            Looking::new(&camera.own, network, detector)?.all(camera.every, progress)
        };
        let looked = looking().with_context(|| format!("camera `{}`", camera.name));
        let (looked, text) = looked.map_err(NodeError::Refused)?;
        // First what says of what it is: who is stopped between the two looks again.
        let said = Kept::beside(&text, looked.clone(), &it.made_of);
        write(&beside(&camera.file), &said)?;
        write(&camera.file, &text)?;
        Ok(looked)
    }
}

impl FilmedCamera {
    /// With what is there of it, by the networks' `hashes`.
    fn with_kept(self, recording: &Recording, hashes: &[String; 2]) -> anyhow::Result<KeptCamera> {
        let every = self.every.to_string();
        let [network, detector] = hashes.each_ref().map(String::as_str);
        let words = [REVISION, network, detector, &self.lens_text, &every];
        let made_of = fingerprint(&words, &files_of(recording)?)?;
        Ok(KeptCamera {
            kept: Kept::find_beside(&beside(&self.file), &self.file, &made_of),
            made_of,
            camera: self,
        })
    }
}

/// The file that says of what `file` was made.
fn beside(file: &Path) -> PathBuf {
    file.with_extension("kept.json")
}

/// The networks on the pictures of one camera.
struct Looking<'a> {
    own: &'a OwnVenue,
    model: &'a CameraModel,
    keypoints: KeypointSet,
    pipeline: EdgePipeline,
}

impl<'a> Looking<'a> {
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

    /// Whom they see in one of so many frames, a line for each that is looked at.
    fn all(mut self, every: u64, progress: &LookProgress) -> anyhow::Result<(Looked, String)> {
        let (mut text, mut looks, mut bodies) = (String::new(), 0, 0);
        let own = self.own;
        let frames = own.show(usize::MAX, |number, picture| {
            if number % every == 0 {
                let seen = self.seen(number, picture)?;
                looks += 1;
                bodies += seen.len() as u64;
                writeln!(text, "{}", json!({"tick": number, "persons": seen}))?;
            }
            progress.one();
            Ok(())
        })?;
        let looked = Looked {
            frames,
            looks,
            bodies,
        };
        Ok((looked, text))
    }

    fn seen(&mut self, number: u64, picture: Picture) -> anyhow::Result<Vec<serde_json::Value>> {
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

    /// A body as files of keypoints have it: COCO's order, distorted pixels.
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
    fn what_is_no_video_is_named_beside_videos() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("seen")).unwrap();
        for name in ["a.mp4", "b.mpeg", "c.jsonl", "run.mcap", "seen/d.jsonl"] {
            std::fs::write(at(name), "").unwrap();
        }
        let videos = |names: &[&str]| filmed(&names.iter().map(|it| at(it)).collect::<Vec<_>>());
        for names in [&["a.mp4", "b.mpeg"], &["b.mpeg", "a.mp4"]] {
            let said = videos(names).unwrap_err().to_string();
            assert!(said.contains("b.mpeg: found no video"), "{said}");
            assert!(said.contains("mp4, mov"), "{said}");
        }
        let said = videos(&["seen"]).unwrap_err().to_string();
        assert!(said.contains("seen/*.jsonl"), "{said}");
        let said = videos(&["a.mp4", "c.jsonl"]).unwrap_err().to_string();
        assert!(said.contains("c.jsonl: found keypoints"), "{said}");
        for others in ["c.jsonl", "run.mcap"] {
            assert!(videos(&[others]).unwrap().is_none(), "{others}");
        }
        let one = videos(&["a.mp4"]).unwrap().unwrap();
        assert_eq!(one.len(), 1);
    }
}
