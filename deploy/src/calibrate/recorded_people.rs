//! People in a recording of fusion's messages: the data that edges sent for each camera and tick, without results of
//! fusion. Sightings come from a detector; patches come from a network on the crop of a person.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_calibration::people::{
    DetectedFrame, Detection, Keypoint, MOST_KEYPOINTS, PeopleCamera, PeopleRequest, Thinning,
};
use farfield_calibration::points::Timing;
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::is_ours;
use farfield_fusion::recording::reader::{AnySet, Recording};
use farfield_fusion_node::{recorded_venue, without_end};
use farfield_node::process::say;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use farfield_proto::id::{CameraIndex, SessionId};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::{PersonPatch, Sighting};
use farfield_proto::patch::{Decoder, Encoder, Maps};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

use super::lenses::Lens;
use super::thin_files::{RemainingFrames, keypoints_of, thin_to};

/// Bytes to read to recognise a recording.
const HEAD_BYTES: u64 = 64;
/// Minimum height of a peak, 0 to 1: without a keypoint, networks answer up to slightly less.
const LEAST_PEAK: f32 = 0.1;
/// Largest difference of capture times within a tick in synchronised cameras, seconds.
const SAME_MOMENT_S: f64 = 0.001;

/// Whether the file at `path` is a Farfield recording.
pub(super) fn is_recording(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut head));
    read.is_ok() && is_ours(&head)
}

/// The part of a recording to use, seconds from its beginning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Part {
    pub(super) from_s: f64,
    pub(super) until_s: f64,
}

impl Part {
    fn has(&self, time_s: f64) -> bool {
        (self.from_s..self.until_s).contains(&time_s)
    }
}

/// A recording of fusion's messages.
pub(super) struct PeopleRecording {
    shown: String,
    recording: Recording<BufReader<File>>,
    session: SessionId,
    first: Tick,
    venue: Venue,
    keypoints: KeypointSet,
}

impl PeopleRecording {
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// When it cannot be read, or is empty.
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let shown = path.display().to_string();
        let file = File::open(path).with_context(|| format!("opening the recording {shown}"))?;
        let opened = Recording::open(BufReader::new(file));
        let recording = opened.map_err(|error| anyhow!("{shown}: {error}"))?;
        let end = recording.end();
        if !end.whole {
            let why = without_end(path, [end.read_bytes, end.file_bytes]);
            say(format_args!("{shown}: {why}"));
        }
        let longest = recording.sessions().first();
        let longest = longest.map(|it| (it.session, it.ticks[0]));
        let (session, first) =
            longest.ok_or_else(|| anyhow!("{shown}: found no data of edges in it"))?;
        if recording.sessions().len() > 1 {
            say(format_args!(
                "{shown}: fusion was restarted during the recording: the longest of its {} sessions is used",
                recording.sessions().len()
            ));
        }
        let (venue, card) = recorded_venue(path, recording.attached())?;
        let keypoints = Pipeline::new(&venue, card.as_ref(), SessionId(0))
            .keypoints()
            .clone();
        Ok(Self {
            shown,
            recording,
            session,
            first,
            venue,
            keypoints,
        })
    }

    /// All cameras of its venue.
    pub(super) fn names(&self) -> Vec<&str> {
        let cameras = self.venue.cameras.iter();
        cameras.map(|it| it.model.name()).collect()
    }

    /// A request with all bodies of `part`, with the lenses in the recording unless `lenses` has others. `timing` is
    /// the assumed timing of the cameras.
    ///
    /// # Errors
    /// When it cannot be read, or contains no people.
    pub(super) fn request(
        mut self,
        lenses: &BTreeMap<String, Lens>,
        timing: Timing,
        part: Part,
    ) -> anyhow::Result<PeopleRequest> {
        let (shown, rate_hz) = (self.shown, self.venue.rate_hz);
        let mut bodies = Bodies::new(rate_hz, timing);
        for tick in self.recording.ticks(self.session) {
            if !part.has((tick - self.first) as f64 / rate_hz) {
                continue;
            }
            let sets = self.recording.sets(self.session, tick);
            let sets = sets.map_err(|error| anyhow!("{shown}: {error}"))?;
            let added = bodies.add(tick.0 as f64, &sets, &self.venue);
            added.with_context(|| shown.clone())?;
        }
        bodies.report_thinning();
        let timing = match timing {
            Timing::Unknown => Timing::Unknown,
            Timing::Synchronised | Timing::Clocks if bodies.apart_s <= SAME_MOMENT_S => {
                Timing::Synchronised
            }
            Timing::Synchronised | Timing::Clocks => Timing::Clocks,
        };
        let cameras = bodies.cameras(&self.venue, lenses, timing)?;
        ensure!(
            !cameras.is_empty(),
            "{shown}: no camera detected people: record while people walk"
        );
        Ok(PeopleRequest {
            timing,
            keypoints: self.keypoints,
            ..PeopleRequest::new(cameras, rate_hz)
        })
    }
}

/// Bodies by camera, collected tick by tick.
struct Bodies {
    rate_hz: f64,
    cameras: BTreeMap<CameraIndex, Vec<SeenFrame>>,
    thinning: Thinning,
    has_begun: bool,
    /// Number of stored keypoints.
    stored: usize,
    /// Largest difference of capture times within a tick, seconds.
    apart_s: f64,
    /// Whether cameras were live; otherwise images belong exactly to their ticks.
    is_live: bool,
    decoder: Decoder,
    encoder: Encoder,
    maps: Maps,
}

impl Bodies {
    fn new(rate_hz: f64, timing: Timing) -> Self {
        // Only the end shows whether cameras are synchronised; until then the data for unsynchronised ones is stored.
        let timing = match timing {
            Timing::Unknown => Timing::Unknown,
            Timing::Synchronised | Timing::Clocks => Timing::Clocks,
        };
        Self {
            rate_hz,
            cameras: BTreeMap::new(),
            thinning: Thinning::new(rate_hz, 0.0, timing),
            has_begun: false,
            stored: 0,
            apart_s: 0.0,
            is_live: false,
            decoder: Decoder::new(),
            encoder: Encoder::new(),
            maps: Maps::new(1, 1, 1),
        }
    }

    /// Adds the data of a tick.
    ///
    /// # Errors
    /// When one moment has more keypoints than fit into memory.
    fn add(&mut self, tick: f64, sets: &[AnySet], venue: &Venue) -> anyhow::Result<()> {
        if !self.has_begun {
            self.thinning.begin(tick);
            self.has_begun = true;
        }
        if !self.thinning.keeps(tick) {
            return Ok(());
        }
        self.is_live |= sets.iter().any(is_live);
        let offsets_s = offsets_s(sets);
        self.apart_s = self.apart_s.max(apart_s(offsets_s.values()));
        let mut found: BTreeMap<CameraIndex, Vec<Detection>> = BTreeMap::new();
        for patch in sets.iter().flat_map(patches) {
            let camera = venue.camera(patch.camera);
            if let Some(body) = camera.and_then(|it| self.detection_of_patch(patch, &it.model)) {
                push_new(found.entry(patch.camera).or_default(), body);
            }
        }
        for sighting in sets.iter().flat_map(sightings) {
            if let Some(camera) = venue.camera(sighting.camera) {
                let body = detection_of_sighting(sighting, &camera.model);
                push_new(found.entry(sighting.camera).or_default(), body);
            }
        }
        for (camera, bodies) in found.into_iter().filter(|(_, bodies)| !bodies.is_empty()) {
            self.stored += keypoints_of(&bodies);
            let own = self.cameras.entry(camera).or_default();
            own.push(SeenFrame {
                tick,
                offset_s: offsets_s.get(&camera).copied(),
                bodies,
            });
        }
        let cameras = &mut self.cameras;
        let retain = |thinning: &Thinning| {
            let each = cameras.values_mut().map(|frames| {
                frames.retain(|it| thinning.keeps(it.tick));
                RemainingFrames::count(frames.iter().map(|it| (it.tick, it.bodies.as_slice())))
            });
            each.fold(RemainingFrames::default(), |all, one| all.and(&one))
        };
        self.stored = thin_to(MOST_KEYPOINTS, self.stored, &mut self.thinning, retain)?;
        Ok(())
    }

    fn report_thinning(&self) {
        if let Some(words) = self.thinning.in_words() {
            say(format_args!(
                "using {words} of the recording, to fit into memory"
            ));
        }
    }

    /// The peaks of a person's maps; `None` if they cannot be decoded.
    fn detection_of_patch(
        &mut self,
        patch: &PersonPatch,
        model: &CameraModel,
    ) -> Option<Detection> {
        self.decoder.decode(&patch.maps, &mut self.maps).ok()?;
        let peaks = self.encoder.peaks(&self.maps).into_iter();
        let keypoints = peaks.zip(&patch.crop_of_keypoint).map(|(peak, crop)| {
            let ([column, row], height) = peak?;
            let score = height / 255.0;
            let grid = patch.crops.get(usize::from(*crop))?;
            let at = grid.pixel(column.into(), row.into());
            // Outside the image a network only guesses.
            let at = Some(at).filter(|at| model.sees(*at))?;
            let drawn = model.distort(at).filter(|_| score >= LEAST_PEAK)?;
            Some(Keypoint {
                px: [drawn.x(), drawn.y()],
                score: f64::from(score).clamp(0.0, 1.0),
            })
        });
        Some(Detection {
            keypoints: keypoints.collect(),
        })
    }

    fn cameras(
        self,
        venue: &Venue,
        lenses: &BTreeMap<String, Lens>,
        timing: Timing,
    ) -> anyhow::Result<Vec<PeopleCamera>> {
        let (rate_hz, is_live) = (self.rate_hz, self.is_live);
        let seeing = self.cameras.into_iter();
        let seeing = seeing.filter(|(_, frames)| !frames.is_empty());
        let cameras =
            seeing.filter_map(|(index, frames)| Some((&venue.camera(index)?.model, frames)));
        let cameras = cameras.map(|(model, frames)| {
            let (name, size_px) = (model.name(), model.size_px());
            if is_live && frames.iter().all(|it| it.offset_s.is_none()) {
                say(format_args!(
                    "camera `{name}`: the recording has no capture times of its images: they count as captured at their \
                     ticks; if the camera is not synchronised, set --clocks unknown"
                ));
            }
            let lens = lenses.get(name);
            if let Some(other) = lens.filter(|lens| lens.size_px != size_px) {
                bail!(
                    "the lens of camera `{name}` is for images of {:?} pixels, expected {size_px:?} as in the recording",
                    other.size_px
                );
            }
            Ok(PeopleCamera {
                name: name.to_owned(),
                size_px,
                intrinsics: lens.map_or(*model.intrinsics(), |lens| lens.intrinsics),
                lens: lens.map_or(*model.lens(), |lens| lens.model),
                rate_hz: Some(rate_hz),
                offset_s: (timing == Timing::Clocks).then_some(0.0),
                frames: if timing == Timing::Synchronised {
                    by_tick(frames)
                } else {
                    by_capture(frames, rate_hz)
                },
            })
        });
        cameras.collect()
    }
}

/// Capture times of the images of a tick, seconds after it, by camera, as far as patches contain them.
fn offsets_s(sets: &[AnySet]) -> BTreeMap<CameraIndex, f64> {
    let patches = sets.iter().flat_map(patches);
    let each = patches.map(|it| (it.camera, f64::from(it.capture_offset_us) * 1e-6));
    each.collect()
}

/// Whether an edge sent it from live cameras.
fn is_live(set: &AnySet) -> bool {
    matches!(set, AnySet::Patches(set) if set.timing.is_some())
}

fn patches(set: &AnySet) -> &[PersonPatch] {
    match set {
        AnySet::Patches(set) => &set.persons,
        AnySet::Sightings(_) => &[],
    }
}

fn sightings(set: &AnySet) -> &[Sighting] {
    match set {
        AnySet::Patches(_) => &[],
        AnySet::Sightings(set) => &set.sightings,
    }
}

/// A sighting in distorted pixels.
fn detection_of_sighting(sighting: &Sighting, model: &CameraModel) -> Detection {
    let keypoints = sighting.keypoints.iter().map(|peak| {
        let peak = peak.as_ref().filter(|peak| peak.score >= LEAST_PEAK)?;
        let [x, y] = peak.position_px.map(f64::from);
        let drawn = model.distort(Pixel::new(x, y))?;
        Some(Keypoint {
            px: [drawn.x(), drawn.y()],
            score: f64::from(peak.score).clamp(0.0, 1.0),
        })
    });
    Detection {
        keypoints: keypoints.collect(),
    }
}

/// Bodies of one image closer than this share of their height are the same.
const SAME_SHARE: f64 = 0.2;

/// The bodies of one camera at a tick.
pub(super) struct SeenFrame {
    pub(super) tick: f64,
    /// Capture time, seconds after the tick; `None` if there are only sightings, which have none.
    pub(super) offset_s: Option<f64>,
    pub(super) bodies: Vec<Detection>,
}

/// Frames numbered by their ticks.
pub(super) fn by_tick(frames: Vec<SeenFrame>) -> Vec<DetectedFrame> {
    let each = frames.into_iter().map(|it| DetectedFrame {
        frame: it.tick,
        bodies: it.bodies,
    });
    each.collect()
}

/// Frames numbered by capture times, in ticks. A frame without one gets the offset of the nearest frame of the same
/// camera that has one.
pub(super) fn by_capture(frames: Vec<SeenFrame>, rate_hz: f64) -> Vec<DetectedFrame> {
    let known = frames.iter().filter_map(|it| Some((it.tick, it.offset_s?)));
    let known: Vec<(f64, f64)> = known.collect();
    let nearest_s = |tick: f64| {
        let after = known.partition_point(|(it, _)| *it < tick);
        let around = [after.checked_sub(1), Some(after)];
        let around = around.into_iter().filter_map(|it| known.get(it?));
        let nearest = around.min_by(|(a, _), (b, _)| (a - tick).abs().total_cmp(&(b - tick).abs()));
        nearest.map_or(0.0, |(_, offset_s)| *offset_s)
    };
    let mut last = f64::NEG_INFINITY;
    let each = frames.into_iter().filter_map(|it| {
        let frame = it.tick + it.offset_s.unwrap_or_else(|| nearest_s(it.tick)) * rate_hz;
        // An image that is not later than the one before: a clock that jumped.
        let is_later = frame > last;
        last = last.max(frame);
        is_later.then_some(DetectedFrame {
            frame,
            bodies: it.bodies,
        })
    });
    each.collect()
}

/// The range of the offsets.
pub(super) fn apart_s<'a>(offsets_s: impl Iterator<Item = &'a f64>) -> f64 {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    let (least, most) = offsets_s.fold(none, |(least, most), it| (least.min(*it), most.max(*it)));
    (most - least).max(0.0)
}

/// Adds a body, unless it is empty or already present.
pub(super) fn push_new(bodies: &mut Vec<Detection>, body: Detection) {
    let has_keypoints = body.keypoints.iter().any(Option::is_some);
    if has_keypoints && bodies.iter().all(|other| !is_same(other, &body)) {
        bodies.push(body);
    }
}

/// Whether two bodies of one image are the same: half of their common keypoints are close.
fn is_same(a: &Detection, b: &Detection) -> bool {
    let both = a.keypoints.iter().zip(&b.keypoints);
    let both = both.filter_map(|(a, b)| Some((a.as_ref()?.px, b.as_ref()?.px)));
    let mut apart_px: Vec<f64> = both
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
        .collect();
    apart_px.sort_by(f64::total_cmp);
    let middle = apart_px.get(apart_px.len() / 2);
    middle.is_some_and(|apart_px| *apart_px < SAME_SHARE * height_px(a).max(height_px(b)))
}

/// From the highest to the lowest keypoint.
fn height_px(body: &Detection) -> f64 {
    let rows = body.keypoints.iter().flatten().map(|it| it.px[1]);
    let least = rows.clone().fold(f64::INFINITY, f64::min);
    (rows.fold(f64::NEG_INFINITY, f64::max) - least).max(1.0)
}

#[cfg(test)]
mod tests {
    use farfield_calibration::people::Keypoint;

    use super::*;

    #[test]
    fn other_files_are_no_recordings() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        assert!(!is_recording(&path));
        std::fs::write(&path, b"{\"tick\": 1}").unwrap();
        assert!(!is_recording(&path));
    }

    fn body(left_px: f64) -> Detection {
        let keypoints = (0..17).map(|i| {
            Some(Keypoint {
                px: [left_px, 10.0 * f64::from(i)],
                score: 0.9,
            })
        });
        Detection {
            keypoints: keypoints.collect(),
        }
    }

    #[test]
    fn a_body_in_a_sighting_and_in_a_patch_is_the_same() {
        assert!(is_same(&body(100.0), &body(110.0)));
        assert!(!is_same(&body(100.0), &body(150.0)));
        assert!(!is_same(&Detection::default(), &body(100.0)));
    }

    #[test]
    fn a_body_of_two_tracks_is_stored_once() {
        let mut bodies = Vec::new();
        for left_px in [100.0, 103.0, 200.0] {
            push_new(&mut bodies, body(left_px));
        }
        push_new(&mut bodies, Detection::default());
        assert_eq!(bodies, [body(100.0), body(200.0)]);
    }

    #[test]
    fn frames_are_numbered_by_their_capture_times() {
        let frame = |tick: f64, offset_s: Option<f64>| SeenFrame {
            tick,
            offset_s,
            bodies: vec![body(tick)],
        };
        // A free-running camera: its offset goes from one half of a tick to the other, and is zero on average.
        let frames = vec![
            frame(10.0, None),
            frame(11.0, Some(0.01)),
            frame(12.0, Some(0.02)),
            frame(13.0, Some(-0.02)),
            frame(14.0, Some(-0.01)),
            frame(16.0, None),
        ];
        let numbers: Vec<f64> = by_capture(frames, 20.0).iter().map(|it| it.frame).collect();
        let expected = [10.2, 11.2, 12.4, 12.6, 13.8, 15.8];
        assert_eq!(numbers.len(), expected.len());
        for (found, expected) in numbers.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{numbers:?}");
        }
        // An image from before a clock jump is not placed before the earlier one.
        let jumped = vec![frame(1.0, Some(0.09)), frame(2.0, Some(-0.09))];
        assert_eq!(by_capture(jumped, 20.0).len(), 1);
        assert!((apart_s([0.02, -0.02, 0.0].iter()) - 0.04).abs() < 1e-12);
        assert!(apart_s([].iter()) <= 0.0);
    }
}
