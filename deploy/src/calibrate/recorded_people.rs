//! People as a recording of fusion's own messages has them: what edges said of each camera at each tick, and nothing that
//! fusion made of it. Sightings are what a detector found by itself; patches are what a network saw in the crop of a person.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_calibration::people::{
    DetectedFrame, Detection, Keypoint, MOST_BODIES, PeopleCamera, PeopleRequest, Thinning,
};
use farfield_calibration::points::Timing;
use farfield_fusion::node::recorded_venue;
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::is_ours;
use farfield_fusion::recording::reader::{AnySet, Recording};
use farfield_node::process::say;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Pixel;
use farfield_proto::id::{CameraIndex, SessionId};
use farfield_proto::message::{PersonPatch, Sighting};
use farfield_proto::patch::{Decoder, Encoder, Maps};
use farfield_proto::venue::Venue;

use super::lenses::Lens;

/// Bytes by which a recording is known.
const HEAD_BYTES: u64 = 64;
/// Least height of a peak that counts, 0 to 1: where there is nothing, networks answer up to a little less.
const LEAST_PEAK: f32 = 0.1;
/// How far a sighting may be from a patch of the same picture to be the same body, as a share of how large it is.
const SAME_SHARE: f64 = 0.2;
/// Capture offsets up to which cameras count as synchronised, seconds.
const SAME_MOMENT_S: f64 = 0.001;
/// Times that frames are thinned for one more tick: each takes half of what is left of them.
const MOST_COARSENINGS: usize = 64;

/// Whether the file at `path` is a recording of ours.
pub(super) fn is_recording(path: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| file.take(HEAD_BYTES).read_to_end(&mut head));
    read.is_ok() && is_ours(&head)
}

/// All bodies of the recording at `path`, with the lenses of its calibration, or of `lenses` where these have others, as a
/// request that asks for nothing else. `timing` is what is believed of the venue's clock.
///
/// # Errors
/// When it cannot be read, or nobody is in it.
pub(super) fn request(
    path: &Path,
    lenses: &BTreeMap<String, Lens>,
    timing: Timing,
) -> anyhow::Result<PeopleRequest> {
    let shown = path.display();
    let file = File::open(path).with_context(|| format!("opening the recording {shown}"))?;
    let opened = Recording::open(BufReader::new(file));
    let mut recording = opened.map_err(|error| anyhow!("{shown}: {error}"))?;
    if !recording.end().whole {
        say(format_args!(
            "{shown}: the recording was cut off: what can be read is taken"
        ));
    }
    let session = recording.sessions().first().map(|it| it.session);
    let session = session.ok_or_else(|| anyhow!("{shown}: nothing that edges sent is in it"))?;
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
    let mut bodies = Bodies::new(&venue, timing);
    for tick in recording.ticks(session) {
        let sets = recording.sets(session, tick);
        let sets = sets.map_err(|error| anyhow!("{shown}: {error}"))?;
        bodies.add(tick.0 as f64, &sets, &venue);
    }
    bodies.say_thinned();
    let synchronised = bodies.are_synchronised();
    let timing = match timing {
        Timing::Unknown => Timing::Unknown,
        Timing::Synchronised | Timing::Clocks if synchronised => Timing::Synchronised,
        Timing::Synchronised | Timing::Clocks => Timing::Clocks,
    };
    let cameras = bodies.cameras(&venue, lenses, timing)?;
    ensure!(
        !cameras.is_empty(),
        "{shown}: no camera of it saw anybody: record while people walk"
    );
    Ok(PeopleRequest {
        timing,
        keypoints,
        ..PeopleRequest::new(cameras, venue.rate_hz)
    })
}

/// Bodies by camera, as they come tick by tick.
struct Bodies {
    rate_hz: f64,
    cameras: BTreeMap<CameraIndex, OneCamera>,
    thinning: Thinning,
    /// Ticks that were met, whatever was kept of them.
    span: Option<[f64; 2]>,
    kept: usize,
    decoder: Decoder,
    encoder: Encoder,
    maps: Maps,
}

/// What one camera saw.
#[derive(Default)]
struct OneCamera {
    frames: Vec<DetectedFrame>,
    /// Sum of the capture offsets of its patches, seconds, and their number.
    offset_s: f64,
    offsets: u32,
}

impl OneCamera {
    fn mean_offset_s(&self) -> f64 {
        self.offset_s / f64::from(self.offsets.max(1))
    }
}

impl Bodies {
    fn new(venue: &Venue, timing: Timing) -> Self {
        Self {
            rate_hz: venue.rate_hz,
            cameras: BTreeMap::new(),
            thinning: Thinning::new(venue.rate_hz, 0.0, timing),
            span: None,
            kept: 0,
            decoder: Decoder::new(),
            encoder: Encoder::new(),
            maps: Maps::new(1, 1, 1),
        }
    }

    /// Adds what edges said of a tick.
    fn add(&mut self, tick: f64, sets: &[AnySet], venue: &Venue) {
        let first = self.span.map_or(tick, |[first, _]| first);
        if self.span.is_none() {
            self.thinning.begin(tick);
        }
        self.span = Some([first, tick]);
        if !self.thinning.keeps(tick) {
            return;
        }
        let mut found: BTreeMap<CameraIndex, Vec<Detection>> = BTreeMap::new();
        for patch in sets.iter().flat_map(patches) {
            let Some(camera) = venue.camera(patch.camera) else {
                continue;
            };
            let own = self.cameras.entry(patch.camera).or_default();
            own.offset_s += f64::from(patch.capture_offset_us) * 1e-6;
            own.offsets = own.offsets.saturating_add(1);
            if let Some(body) = self.of_patch(patch, &camera.model) {
                found.entry(patch.camera).or_default().push(body);
            }
        }
        for sighting in sets.iter().flat_map(sightings) {
            let Some(camera) = venue.camera(sighting.camera) else {
                continue;
            };
            let body = of_sighting(sighting, &camera.model);
            let others = found.entry(sighting.camera).or_default();
            if others.iter().all(|other| !is_same(other, &body)) {
                others.push(body);
            }
        }
        for (camera, bodies) in found {
            let is_somebody = |body: &Detection| body.keypoints.iter().any(Option::is_some);
            let bodies: Vec<Detection> = bodies.into_iter().filter(is_somebody).collect();
            if !bodies.is_empty() {
                self.kept += bodies.len();
                let own = self.cameras.entry(camera).or_default();
                own.frames.push(DetectedFrame {
                    frame: tick,
                    bodies,
                });
            }
        }
        self.thin(first, tick);
    }

    /// Keeps less, where there is more than fits into memory.
    fn thin(&mut self, first: f64, last: f64) {
        for _ in 0..MOST_COARSENINGS {
            if self.kept <= MOST_BODIES {
                return;
            }
            self.thinning.coarsen(first, last);
            self.kept = 0;
            for camera in self.cameras.values_mut() {
                camera.frames.retain(|it| self.thinning.keeps(it.frame));
                let bodies = camera.frames.iter().map(|it| it.bodies.len());
                self.kept += bodies.sum::<usize>();
            }
        }
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

    fn are_synchronised(&self) -> bool {
        let offsets = self.cameras.values().map(OneCamera::mean_offset_s);
        let (least, most) = offsets
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, most), it| {
                (least.min(it), most.max(it))
            });
        most - least <= SAME_MOMENT_S
    }

    fn cameras(
        self,
        venue: &Venue,
        lenses: &BTreeMap<String, Lens>,
        timing: Timing,
    ) -> anyhow::Result<Vec<PeopleCamera>> {
        let rate_hz = self.rate_hz;
        let seeing = self.cameras.into_iter();
        let seeing = seeing.filter(|(_, own)| !own.frames.is_empty());
        let cameras = seeing.filter_map(|(index, own)| Some((&venue.camera(index)?.model, own)));
        let cameras = cameras.map(|(model, own)| {
            let (name, size_px) = (model.name(), model.size_px());
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
                distortion: lens.map_or(*model.distortion(), |lens| lens.distortion),
                rate_hz: Some(rate_hz),
                offset_s: (timing == Timing::Clocks).then(|| own.mean_offset_s()),
                frames: own.frames,
            })
        });
        cameras.collect()
    }
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

/// Whether two bodies of one picture are one: half of the keypoints that both have are at about the same place.
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

/// From the uppermost keypoint to the lowest.
fn height_px(body: &Detection) -> f64 {
    let rows = body.keypoints.iter().flatten().map(|it| it.px[1]);
    let least = rows.clone().fold(f64::INFINITY, f64::min);
    (rows.fold(f64::NEG_INFINITY, f64::max) - least).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn a_body_that_was_sighted_and_followed_is_one() {
        assert!(is_same(&body(100.0), &body(110.0)));
        assert!(!is_same(&body(100.0), &body(150.0)));
        assert!(!is_same(&Detection::default(), &body(100.0)));
    }

    #[test]
    fn what_is_no_recording_is_not_taken_for_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        assert!(!is_recording(&path));
        std::fs::write(&path, b"{\"tick\": 1}").unwrap();
        assert!(!is_recording(&path));
    }
}
