//! Cameras that show nobody while people are in their pictures: black, covered, or files in which nobody is any more.
//!
//! That people are there is told by poses, and by two other cameras that show the same people at the same time. A wall hides people
//! from a camera, too. So somebody counts where this camera has shown people before; a camera that never showed anybody is told of only
//! where nearly all others show nearly everybody who is in their pictures.

use farfield_proto::tick::Tick;
use nalgebra::Vector2;

use super::super::samples::{PassSample, Samples};
use super::KeypointHalf;
use super::pose_shift::{Projected, Search, Sighted};

/// Least detection passes with somebody where the camera showed people before, per camera of its viewpoint (fusion may have looked
/// through another one), and for how long, seconds.
const MIN_PASSES: usize = 4;
const MIN_S: f64 = 2.0;
/// The same of a camera that showed nobody as long as is known.
const MIN_PASSES_OF_NEVER: usize = 10;
const MIN_S_OF_NEVER: f64 = 5.0;
/// How near somebody must be to where people were shown, metres across and as a share of the depth.
const SAME_PLACE_M: f64 = 0.6;
const SAME_DEPTH: f64 = 0.25;
/// Other cameras that must show somebody who is said to be there.
const SHOWN_BY: usize = 2;
/// Least height of somebody who must be seen, pixels: detectors need some.
const LEAST_PX: f64 = 80.0;
/// Passes in which the camera must have shown people, to be one that shows them.
const MIN_SHOWING: usize = 3;
/// Which share of those in their pictures other cameras show where nothing hides people.
const OPEN: f64 = 0.8;
/// Least people in the pictures of a camera that tells of that, and least such cameras.
const MIN_IN_PICTURE: usize = 8;
const MIN_OPEN: usize = 2;
/// What a sighting costs at the most that is somebody.
const IS_SOMEBODY: f64 = 0.5;

/// Since when a camera shows nobody.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::camera_agreement) struct Silence {
    /// The first detection pass without anybody; `None` where it never showed anybody.
    pub(in crate::camera_agreement) since: Option<Tick>,
}

/// What a camera shows of those who are there, at a detection pass.
#[derive(Debug, Clone, Default)]
pub(in crate::camera_agreement) struct SeenPass {
    /// Whether it shows anybody, wherever.
    shows: bool,
    /// How many sightings it has, and how many of these are of somebody who is there.
    pub(in crate::camera_agreement) sightings: usize,
    pub(in crate::camera_agreement) used: usize,
    /// Who is in its picture, large enough.
    here: Vec<Place>,
    /// Those who are shown.
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
        off_m <= SAME_PLACE_M && (depths_m[0] - depths_m[1]).abs() <= SAME_DEPTH * depths_m[0]
    }
}

impl Search<'_> {
    /// What the camera shows at every pass.
    pub(super) fn seen_passes(&self) -> Vec<SeenPass> {
        self.passes.iter().map(|pass| self.seen_at(pass)).collect()
    }

    fn seen_at(&self, pass: &PassSample) -> SeenPass {
        let bodies = pass.of_camera[self.camera].iter();
        let seen = bodies.filter_map(|body| Sighted::of(body, KeypointHalf::All));
        let seen: Vec<Sighted> = seen.collect();
        let people = self.people_at(pass, 0).unwrap_or_default();
        let is_shown = |person: &&Projected| {
            let one = std::slice::from_ref(*person);
            seen.iter()
                .any(|seen| seen.cost(one, self.focal_px) < IS_SOMEBODY)
        };
        let here = people
            .iter()
            .filter(|person| self.is_in_picture(person) && height_px(person) >= LEAST_PX);
        let is_used = |seen: &&Sighted| seen.cost(people, self.focal_px) < IS_SOMEBODY;
        SeenPass {
            shows: !seen.is_empty(),
            // Where nobody is followed none could be used.
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

/// Per camera since when it shows nobody although people are in its picture. `seen` is what each shows, by pass; `per_viewpoint`
/// how many cameras its viewpoint has.
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
    let of = |(camera, n): (usize, &usize)| all.silence(camera, *n);
    per_viewpoint.iter().enumerate().map(of).collect()
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
        let there = |at: usize| self.surely_here(camera, at);
        let is_missed = |place: Place| before.iter().any(|shown| place.is_near(shown));
        let missed = after.iter().filter(|&&at| there(at).any(is_missed));
        let missed: Vec<usize> = missed.copied().collect();
        if showing >= MIN_SHOWING
            && missed.len() >= MIN_PASSES * per_viewpoint
            && self.lasts(&missed, MIN_S)
        {
            let since = after.first().map(|&at| self.tick(at));
            return Some(Silence { since });
        }
        let there: Vec<usize> = after
            .into_iter()
            .filter(|&at| there(at).next().is_some())
            .collect();
        let is_never = begin.is_none()
            && there.len() >= MIN_PASSES_OF_NEVER * per_viewpoint
            && self.lasts(&there, MIN_S_OF_NEVER);
        (is_never && self.is_open(camera)).then(|| Silence {
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

    /// Those in the picture of a camera at a pass whom others show.
    fn surely_here(&self, camera: usize, pass: usize) -> impl Iterator<Item = Place> {
        let shown_by_others = move |person: u32| {
            let others = (0..self.seen.len()).filter(|&other| other != camera);
            let showing = others.filter(|&other| self.seen[other][pass].shown.contains(&person));
            showing.take(SHOWN_BY).count() == SHOWN_BY
        };
        let here = self.seen[camera][pass].here.iter().copied();
        here.filter(move |place| shown_by_others(place.person))
    }

    /// Whether nearly all other cameras show nearly everybody who is in their pictures.
    fn is_open(&self, camera: usize) -> bool {
        let others = (0..self.seen.len()).filter(|&other| other != camera);
        let shares = others.filter_map(|other| {
            let (mut shown, mut all) = (0, 0);
            for (at, pass) in self.seen[other].iter().enumerate() {
                // Of a pass in which it shows nobody it may not have been asked.
                let was_asked = pass.shows
                    || self.per_viewpoint[other] == 1
                        && !self.samples.is_absent(other, self.tick(at));
                for place in self.surely_here(other, at).filter(|_| was_asked) {
                    all += 1;
                    shown += usize::from(pass.shown.contains(&place.person));
                }
            }
            (all >= MIN_IN_PICTURE).then_some(shown as f64 >= OPEN * all as f64)
        });
        let are_open: Vec<bool> = shares.collect();
        let n_open = are_open.iter().filter(|is| **is).count();
        n_open >= MIN_OPEN && n_open as f64 >= OPEN * are_open.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 30.0;

    /// Passes every half second of four cameras that all have one person in their pictures, who walks to and fro; whether the first
    /// shows her, and the third and fourth.
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
        let of = |camera: usize| (0..passes).map(|at| pass_of(camera, at)).collect();
        let seen: Vec<Vec<SeenPass>> = (0..4).map(of).collect();
        silences(&seen, &[1; 4], &samples, RATE_HZ)[0]
    }

    #[test]
    fn a_camera_that_goes_black_is_told_of_since_its_first_empty_pass() {
        let told = silence(16, |at| at < 6, |_, _| true);
        let since = Some(Tick(90));
        assert_eq!(told, Some(Silence { since }));
    }

    #[test]
    fn a_camera_that_never_showed_anybody_is_told_of_where_nothing_hides_people_from_the_others() {
        let told = silence(16, |_| false, |_, _| true);
        assert_eq!(told, Some(Silence { since: None }));
        assert_eq!(silence(8, |_| false, |_, _| true), None, "too short");
        // Walls: the others show somebody now and then.
        assert_eq!(
            silence(16, |_| false, |camera, at| at % 3 != camera - 2),
            None
        );
    }

    #[test]
    fn a_camera_that_shows_people_sometimes_is_no_fault() {
        for every in [2, 3, 5] {
            assert_eq!(silence(16, |at| at % every == 0, |_, _| true), None);
        }
        assert_eq!(silence(16, |at| at < 13, |_, _| true), None, "a moment");
        assert_eq!(
            silence(16, |at| at < 6, |_, _| false),
            None,
            "who is there?"
        );
    }
}
