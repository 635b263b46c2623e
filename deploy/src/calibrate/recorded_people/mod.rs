//! People as a recording of fusion's own messages has them: what edges said of each camera at each tick, and nothing that
//! fusion made of it. Sightings are what a detector found by itself; patches are what a network saw in the crop of a person.

mod seen_frame;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_calibration::people::{
    Detection, Keypoint, MOST_KEYPOINTS, PeopleCamera, PeopleRequest, Thinning,
};
use farfield_calibration::points::Timing;
use farfield_fusion::node::{recorded_venue, without_end};
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::is_ours;
use farfield_fusion::recording::reader::{AnySet, Recording};
use farfield_node::process::say;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use farfield_proto::id::{CameraIndex, SessionId};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::{PersonPatch, Sighting};
use farfield_proto::patch::{Decoder, Encoder, Maps};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;

use self::seen_frame::{SeenFrame, apart_s, by_capture, by_tick, push_new};
use super::lenses::Lens;
use super::thin_files::{FramesLeft, keypoints_of, thin_to};

/// Bytes by which a recording is known.
const HEAD_BYTES: u64 = 64;
/// Least height of a peak that counts, 0 to 1: where there is nothing, networks answer up to a little less.
const LEAST_PEAK: f32 = 0.1;
/// How far the pictures of a tick may be taken from each other in cameras that are synchronised, seconds.
const SAME_MOMENT_S: f64 = 0.001;

/// Whether the file at `path` is a recording of ours.
pub(super) fn is_recording(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut head));
    read.is_ok() && is_ours(&head)
}

/// The part of a recording that is taken, seconds from its beginning.
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

/// A recording of fusion's own messages.
pub(super) struct PeopleRecording {
    shown: String,
    recording: Recording<BufReader<File>>,
    session: SessionId,
    /// Its first tick.
    first: Tick,
    venue: Venue,
    keypoints: KeypointSet,
}

impl PeopleRecording {
    /// Opens the recording at `path`.
    ///
    /// # Errors
    /// When it cannot be read, or nothing is in it.
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
            longest.ok_or_else(|| anyhow!("{shown}: nothing that edges sent is in it"))?;
        if recording.sessions().len() > 1 {
            say(format_args!(
                "{shown}: fusion was restarted while it was recorded: of its {} lives the longest is taken",
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

    /// The cameras of its venue, whether they saw anybody or not.
    pub(super) fn names(&self) -> Vec<&str> {
        let cameras = self.venue.cameras.iter();
        cameras.map(|it| it.model.name()).collect()
    }

    /// All bodies of `part` of it, with the lenses of its calibration, or of `lenses` where these have others, as a request
    /// that asks for nothing else. `timing` is what is believed of the venue's clock.
    ///
    /// # Errors
    /// When it cannot be read, or nobody is in it.
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
        bodies.say_thinned();
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
            "{shown}: no camera of it saw anybody: record while people walk"
        );
        Ok(PeopleRequest {
            timing,
            keypoints: self.keypoints,
            ..PeopleRequest::new(cameras, rate_hz)
        })
    }
}

/// Bodies by camera, as they come tick by tick.
struct Bodies {
    rate_hz: f64,
    cameras: BTreeMap<CameraIndex, Vec<SeenFrame>>,
    thinning: Thinning,
    has_begun: bool,
    /// Keypoints that were kept.
    kept: usize,
    /// How far the pictures of one tick were taken from each other, at most, seconds.
    apart_s: f64,
    /// Whether cameras were live: else pictures are of their ticks, and nothing else can be said of them.
    is_live: bool,
    decoder: Decoder,
    encoder: Encoder,
    maps: Maps,
}

impl Bodies {
    fn new(rate_hz: f64, timing: Timing) -> Self {
        // Whether cameras are synchronised shows only at the end: until then as much is kept as is needed where they are not.
        let timing = match timing {
            Timing::Unknown => Timing::Unknown,
            Timing::Synchronised | Timing::Clocks => Timing::Clocks,
        };
        Self {
            rate_hz,
            cameras: BTreeMap::new(),
            thinning: Thinning::new(rate_hz, 0.0, timing),
            has_begun: false,
            kept: 0,
            apart_s: 0.0,
            is_live: false,
            decoder: Decoder::new(),
            encoder: Encoder::new(),
            maps: Maps::new(1, 1, 1),
        }
    }

    /// Adds what edges said of a tick.
    ///
    /// # Errors
    /// When more was seen in a moment than fits into memory.
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
            if let Some(body) = camera.and_then(|it| self.of_patch(patch, &it.model)) {
                push_new(found.entry(patch.camera).or_default(), body);
            }
        }
        for sighting in sets.iter().flat_map(sightings) {
            if let Some(camera) = venue.camera(sighting.camera) {
                let body = of_sighting(sighting, &camera.model);
                push_new(found.entry(sighting.camera).or_default(), body);
            }
        }
        for (camera, bodies) in found.into_iter().filter(|(_, bodies)| !bodies.is_empty()) {
            self.kept += keypoints_of(&bodies);
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
                FramesLeft::of(frames.iter().map(|it| (it.tick, it.bodies.as_slice())))
            });
            each.fold(FramesLeft::default(), |all, one| all.and(&one))
        };
        self.kept = thin_to(MOST_KEYPOINTS, self.kept, &mut self.thinning, retain)?;
        Ok(())
    }

    fn say_thinned(&self) {
        if let Some(words) = self.thinning.in_words() {
            say(format_args!(
                "keeping {words} of the recording, so that all fit into memory"
            ));
        }
    }

    /// The peaks of a person's maps; `None` where they cannot be decoded.
    fn of_patch(&mut self, patch: &PersonPatch, model: &CameraModel) -> Option<Detection> {
        self.decoder.decode(&patch.maps, &mut self.maps).ok()?;
        let peaks = self.encoder.peaks(&self.maps).into_iter();
        let keypoints = peaks.zip(&patch.crop_of_keypoint).map(|(peak, crop)| {
            let ([column, row], height) = peak?;
            let score = height / 255.0;
            let grid = patch.crops.get(usize::from(*crop))?;
            let at = grid.pixel(column.into(), row.into());
            // Beyond the picture a network guesses.
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
                    "camera `{name}`: nothing in the recording says when its pictures were taken: they count as of their \
                     ticks; where it is not synchronised, give --clocks unknown"
                ));
            }
            let lens = lenses.get(name);
            if let Some(other) = lens.filter(|lens| lens.size_px != size_px) {
                bail!(
                    "the lens of camera `{name}` is of pictures of {:?} pixels, those of the recording are of {size_px:?}",
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

/// When the pictures of a tick were taken, seconds after it, by camera, as far as patches say.
fn offsets_s(sets: &[AnySet]) -> BTreeMap<CameraIndex, f64> {
    let patches = sets.iter().flat_map(patches);
    let each = patches.map(|it| (it.camera, f64::from(it.capture_offset_us) * 1e-6));
    each.collect()
}

/// Whether an edge sent it while cameras were live.
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

/// A sighting as the lens drew it.
fn of_sighting(sighting: &Sighting, model: &CameraModel) -> Detection {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_recording_is_not_taken_for_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        assert!(!is_recording(&path));
        std::fs::write(&path, b"{\"tick\": 1}").unwrap();
        assert!(!is_recording(&path));
    }
}
