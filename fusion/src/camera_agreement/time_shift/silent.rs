//! Cameras without sightings while people are in their pictures: black, covered, or files that end.
//!
//! A person counts as present if there is a pose, and two other cameras show the person at the same
//! time. A wall can hide people from a camera, too. So a person counts only where the camera has
//! shown people before. A camera without any sightings is reported only if nearly all others show
//! nearly all people in their pictures.

use farfield_proto::tick::Tick;
use nalgebra::Vector2;

use super::super::samples::{PassSample, Samples};
use super::KeypointHalf;
use super::pose_shift::{PoseSearch, Projected, Sighted};

/// Least number of missed passes (with a person where the camera showed people before) per camera
/// of its viewpoint, and least time between the first and the last, seconds. The number is per
/// camera because a pass may have run in another camera of the viewpoint.
const MIN_PASSES: usize = 4;
const MIN_S: f64 = 2.0;
/// The same for a camera without any kept sightings.
const MIN_PASSES_IF_NEVER: usize = 10;
const MIN_S_IF_NEVER: f64 = 5.0;
/// Largest distance between two people at the same place: metres across, and as a share of depth.
const SAME_PLACE_M: f64 = 0.6;
const SAME_DEPTH_RATIO: f64 = 0.25;
/// Number of other cameras that must show a person who counts as present.
const MIN_OTHER_CAMERAS: usize = 2;
/// Least height of a person that a detector can find, pixels.
const MIN_HEIGHT_PX: f64 = 80.0;
/// Number of passes with known people that a camera must have had before it became silent.
const MIN_SHOWING: usize = 3;
/// A view is open if the camera shows at least this share of the people in its picture.
const MIN_OPEN_SHARE: f64 = 0.8;
/// Least number of people in the pictures of a camera with an open view, and of such cameras.
const MIN_IN_PICTURE: usize = 8;
const MIN_OPEN: usize = 2;
/// Mean cost below which a sighting is of a person.
const MAX_SAME_PERSON_COST: f64 = 0.5;

/// The time since which a camera has no sightings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::camera_agreement) struct Silence {
    /// The first detection pass without sightings; `None` if the camera never had any.
    pub(in crate::camera_agreement) since: Option<Tick>,
}

/// The tracked people that a camera shows at a detection pass.
#[derive(Debug, Clone, Default)]
pub(in crate::camera_agreement) struct SeenPass {
    /// Whether it has any sighting.
    shows: bool,
    /// Number of sightings, and of those that are of a tracked person.
    pub(in crate::camera_agreement) sightings: usize,
    pub(in crate::camera_agreement) used: usize,
    /// People in its picture who are large enough.
    here: Vec<Place>,
    /// People who are shown.
    shown: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
struct Place {
    person: u32,
    middle_px: Vector2<f64>,
    pixel_m: f64,
    focal_px: f64,
}

impl Place {
    fn is_near(&self, other: &Self) -> bool {
        let depths_m = [self, other].map(|place| place.pixel_m * place.focal_px);
        let off_m = (self.middle_px - other.middle_px).norm() * self.pixel_m;
        off_m <= SAME_PLACE_M && (depths_m[0] - depths_m[1]).abs() <= SAME_DEPTH_RATIO * depths_m[0]
    }
}

impl PoseSearch<'_> {
    pub(super) fn seen_passes(&self) -> Vec<SeenPass> {
        self.passes.iter().map(|pass| self.seen_at(pass)).collect()
    }

    fn seen_at(&self, pass: &PassSample) -> SeenPass {
        let bodies = pass.of_camera[self.camera].iter();
        let seen = bodies.filter_map(|body| Sighted::new(body, KeypointHalf::All));
        let seen: Vec<Sighted> = seen.collect();
        let people = self.people_at(pass, 0).unwrap_or_default();
        let is_shown = |person: &&Projected| {
            let one = std::slice::from_ref(*person);
            seen.iter()
                .any(|seen| seen.cost(one, self.focal_px) < MAX_SAME_PERSON_COST)
        };
        let here = people
            .iter()
            .filter(|person| self.is_in_picture(person) && height_px(person) >= MIN_HEIGHT_PX);
        let is_used = |seen: &&Sighted| seen.cost(people, self.focal_px) < MAX_SAME_PERSON_COST;
        SeenPass {
            shows: !seen.is_empty(),
            // Without tracked people, no sighting could be used.
            sightings: if people.is_empty() { 0 } else { seen.len() },
            used: seen.iter().filter(is_used).count(),
            here: here
                .map(|person| Place {
                    person: person.person,
                    middle_px: person.middle_px,
                    pixel_m: person.pixel_m,
                    focal_px: self.focal_px,
                })
                .collect(),
            shown: people.iter().filter(is_shown).map(|p| p.person).collect(),
        }
    }
}

fn height_px(person: &Projected) -> f64 {
    let rows = person.keypoints.iter().flatten().map(|(px, _)| px.y);
    let (top, bottom) = rows.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
        (low.min(y), high.max(y))
    });
    bottom - top
}

/// Per camera, the time since which it has no sightings although people are in its picture. `seen`
/// has the passes of each camera, `per_viewpoint` the number of cameras of its viewpoint.
pub(in crate::camera_agreement) fn silences(
    seen: &[Vec<SeenPass>],
    per_viewpoint: &[usize],
    samples: &Samples,
    rate_hz: f64,
) -> Vec<Option<Silence>> {
    let all = AllSeen {
        seen,
        per_viewpoint,
        samples,
        rate_hz,
    };
    let silence = |(camera, n): (usize, &usize)| all.silence(camera, *n);
    per_viewpoint.iter().enumerate().map(silence).collect()
}

struct AllSeen<'a> {
    seen: &'a [Vec<SeenPass>],
    per_viewpoint: &'a [usize],
    samples: &'a Samples,
    rate_hz: f64,
}

impl AllSeen<'_> {
    fn silence(&self, camera: usize, per_viewpoint: usize) -> Option<Silence> {
        let own = self.seen.get(camera)?;
        let begin = own.iter().rposition(|pass| pass.shows);
        let shown = || own[..begin.map_or(0, |at| at + 1)].iter();
        let first = begin.map_or(0, |at| at + 1);
        let after = (first..own.len()).filter(|&at| !self.samples.is_absent(camera, self.tick(at)));
        let after: Vec<usize> = after.collect();
        let showing = shown().filter(|pass| !pass.shown.is_empty()).count();
        let before: Vec<Place> = shown()
            .flat_map(|pass| {
                let is_shown = |place: &&Place| pass.shown.contains(&place.person);
                pass.here.iter().filter(is_shown).copied()
            })
            .collect();
        let present = |at: usize| self.present_people(camera, at);
        let is_missed = |place: Place| before.iter().any(|shown| place.is_near(shown));
        let missed = after.iter().filter(|&&at| present(at).any(is_missed));
        let missed: Vec<usize> = missed.copied().collect();
        if showing >= MIN_SHOWING
            && missed.len() >= MIN_PASSES * per_viewpoint
            && self.lasts(&missed, MIN_S)
        {
            let since = after.first().map(|&at| self.tick(at));
            return Some(Silence { since });
        }
        let with_people: Vec<usize> = after
            .into_iter()
            .filter(|&at| present(at).next().is_some())
            .collect();
        let is_never = begin.is_none()
            && with_people.len() >= MIN_PASSES_IF_NEVER * per_viewpoint
            && self.lasts(&with_people, MIN_S_IF_NEVER);
        (is_never && self.are_others_open(camera)).then(|| Silence {
            since: self.samples.last_shown(camera),
        })
    }

    fn tick(&self, pass: usize) -> Tick {
        self.samples.passes[pass].tick
    }

    fn lasts(&self, passes: &[usize], seconds: f64) -> bool {
        let (first, last) = (passes.first(), passes.last());
        let ends = first.zip(last);
        ends.is_some_and(|(&first, &last)| {
            (self.tick(last) - self.tick(first)) as f64 >= seconds * self.rate_hz
        })
    }

    /// The people in the picture of a camera at a pass that enough other cameras show.
    fn present_people(&self, camera: usize, pass: usize) -> impl Iterator<Item = Place> {
        let shown_by_others = move |person: u32| {
            let others = (0..self.seen.len()).filter(|&other| other != camera);
            let showing = others.filter(|&other| self.seen[other][pass].shown.contains(&person));
            showing.take(MIN_OTHER_CAMERAS).count() == MIN_OTHER_CAMERAS
        };
        let here = self.seen[camera][pass].here.iter().copied();
        here.filter(move |place| shown_by_others(place.person))
    }

    /// Whether nearly all other cameras show nearly all people in their pictures.
    fn are_others_open(&self, camera: usize) -> bool {
        let others = (0..self.seen.len()).filter(|&other| other != camera);
        let shares = others.filter_map(|other| {
            let (mut shown, mut all) = (0, 0);
            for (at, pass) in self.seen[other].iter().enumerate() {
                // A pass without sightings may not have run in this camera.
                let has_run = pass.shows
                    || self.per_viewpoint[other] == 1
                        && !self.samples.is_absent(other, self.tick(at));
                for place in self.present_people(other, at).filter(|_| has_run) {
                    all += 1;
                    shown += usize::from(pass.shown.contains(&place.person));
                }
            }
            (all >= MIN_IN_PICTURE).then_some(shown as f64 >= MIN_OPEN_SHARE * all as f64)
        });
        let are_open: Vec<bool> = shares.collect();
        let n_open = are_open.iter().filter(|is| **is).count();
        n_open >= MIN_OPEN && n_open as f64 >= MIN_OPEN_SHARE * are_open.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 30.0;

    /// The silence of the first of four cameras. A person walks to and fro in the pictures of all,
    /// with a pass every half second. The arguments are whether the first camera shows the person
    /// at a pass, and whether the third and the fourth do; the second always does.
    fn silence(
        passes: usize,
        first_shows: impl Fn(usize) -> bool,
        others_show: impl Fn(usize, usize) -> bool,
    ) -> Option<Silence> {
        let mut samples = Samples::new(RATE_HZ, 4);
        let pass_of = |camera: usize, at: usize| {
            let x = 600.0 + 100.0 * (at % 4) as f64;
            let is_shown = match camera {
                0 => first_shows(at),
                1 => true,
                _ => others_show(camera, at),
            };
            SeenPass {
                shows: is_shown,
                sightings: usize::from(is_shown),
                used: usize::from(is_shown),
                here: vec![Place {
                    person: 7,
                    middle_px: Vector2::new(x, 500.0),
                    pixel_m: 0.005,
                    focal_px: 1000.0,
                }],
                shown: if is_shown { vec![7] } else { Vec::new() },
            }
        };
        for at in 0..passes {
            samples.passes.push_back(
                PassSample {
                    tick: Tick(15 * at.cast_signed() as i64),
                    of_camera: vec![Vec::new(); 4],
                    unsure: vec![Vec::new(); 4],
                }
                .into(),
            );
        }
        let passes_of = |camera: usize| (0..passes).map(|at| pass_of(camera, at)).collect();
        let seen: Vec<Vec<SeenPass>> = (0..4).map(passes_of).collect();
        silences(&seen, &[1; 4], &samples, RATE_HZ)[0]
    }

    #[test]
    fn a_camera_that_goes_black_is_silent_since_its_first_empty_pass() {
        let black = silence(16, |at| at < 6, |_, _| true);
        let since = Some(Tick(90));
        assert_eq!(black, Some(Silence { since }));
    }

    #[test]
    fn a_camera_without_any_sightings_is_silent_if_others_have_open_views() {
        let black = silence(16, |_| false, |_, _| true);
        assert_eq!(black, Some(Silence { since: None }));
        assert_eq!(silence(8, |_| false, |_, _| true), None, "too short");
        // Walls: the others show the person only now and then.
        assert_eq!(
            silence(16, |_| false, |camera, at| at % 3 != camera - 2),
            None
        );
    }

    #[test]
    fn a_camera_with_some_sightings_is_not_silent() {
        for every in [2, 3, 5] {
            assert_eq!(silence(16, |at| at % every == 0, |_, _| true), None);
        }
        assert_eq!(silence(16, |at| at < 13, |_, _| true), None, "a moment");
        assert_eq!(
            silence(16, |at| at < 6, |_, _| false),
            None,
            "too few other cameras"
        );
    }
}
