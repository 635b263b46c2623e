//! What sightings say of a camera beside the poses of all: its shift in time, how far off it is, and whether it shows those
//! who are there.
//!
//! Whoever is in its picture by where people are, and is not shown, while it shows somebody who is nowhere, is missed. Of a
//! camera that is right few are, whatever hides them.

use super::super::geometry::SightLines;
use super::super::samples::{MAX_BODIES, PassSample, PosedTick, Samples};
use super::KeypointHalf;
use super::pose_shift::{PoseShift, Projected, Search, Sighted};
use super::silent::SeenPass;

/// Least mean cost of a sighting that is nobody there.
const ELSEWHERE: f64 = 0.5;
/// Share of the keypoints of somebody who is in the picture.
const IN_PICTURE: f64 = 0.9;
/// How many must be missed, or met, in how many passes, and how many times as many as are met, or missed. Cameras that are
/// right miss 0.16 times as many as they meet, at the most, on the recordings and in fifty runs of scenes.
const MIN_PEOPLE: usize = 6;
const MIN_PASSES: usize = 3;
const FACTOR: usize = 2;

/// How many people a camera met.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::camera_agreement) struct Met {
    shown: usize,
    missed: usize,
    /// Passes in which somebody was missed.
    passes: usize,
}

impl Met {
    /// Whether the camera shows people, and others than are there.
    pub(in crate::camera_agreement) fn shows_others(&self) -> bool {
        self.missed >= MIN_PEOPLE.max(FACTOR * self.shown) && self.passes >= MIN_PASSES
    }

    /// Whether it shows those who are there.
    pub(in crate::camera_agreement) fn shows_them(&self) -> bool {
        self.shown >= MIN_PEOPLE.max(FACTOR * self.missed)
    }
}

/// What sightings say of a camera beside the poses of all.
#[derive(Debug, Clone, Default)]
pub(in crate::camera_agreement) struct PoseFit {
    /// Its shift; `None` where people moved too little before it, or too few were sighted.
    pub(in crate::camera_agreement) shift: Option<PoseShift>,
    /// Who is met.
    pub(in crate::camera_agreement) met: Met,
    /// What it shows, by detection pass.
    pub(in crate::camera_agreement) seen: Vec<SeenPass>,
}

/// That of every camera.
pub(in crate::camera_agreement) fn pose_fits(
    samples: &Samples,
    lines: &[SightLines],
    rate_hz: f64,
) -> Vec<PoseFit> {
    let poses: Vec<&PosedTick> = samples.poses.iter().map(AsRef::as_ref).collect();
    let passes: Vec<&PassSample> = samples.passes.iter().map(AsRef::as_ref).collect();
    let every = samples.pose_every_ticks();
    let of = |(camera, lines): (usize, &SightLines)| {
        let search = Search::of((camera, lines), &poses, (&passes, every));
        PoseFit {
            shift: search.shift(rate_hz),
            met: search.met(),
            seen: search.seen_passes(),
        }
    };
    lines.iter().enumerate().map(of).collect()
}

impl Search<'_> {
    pub(super) fn met(&self) -> Met {
        let mut all = Met::default();
        for pass in self.passes {
            let Some(people) = self.people_at(pass, 0) else {
                continue;
            };
            let bodies = &pass.of_camera[self.camera];
            // Of more than are kept nobody knows who is missing.
            if bodies.len() >= MAX_BODIES || !self.knows_everybody_at(pass) {
                continue;
            }
            let seen = bodies
                .iter()
                .filter_map(|body| Sighted::of(body, KeypointHalf::All));
            let seen: Vec<Sighted> = seen.collect();
            let fits = |seen: &Sighted, person: &Projected| {
                let one = std::slice::from_ref(person);
                seen.cost(one, self.focal_px) < ELSEWHERE
            };
            let is_shown = |person: &Projected| seen.iter().any(|seen| fits(seen, person));
            let is_somebody = |seen: &&Sighted| people.iter().any(|person| fits(seen, person));
            let expected = people.iter().filter(|person| self.is_in_picture(person));
            let (shown, hidden): (Vec<_>, Vec<_>) = expected.partition(|person| is_shown(person));
            let strangers = seen.iter().filter(|seen| !is_somebody(seen)).count();
            let missed = hidden.len().min(strangers);
            all.shown += shown.len();
            all.missed += missed;
            all.passes += usize::from(missed > 0);
        }
        all
    }

    pub(super) fn is_in_picture(&self, person: &Projected) -> bool {
        let inside = person.keypoints.iter().flatten().filter(|(px, _)| {
            (0.0..self.size_px.x).contains(&px.x) && (0.0..self.size_px.y).contains(&px.y)
        });
        inside.count() as f64 >= IN_PICTURE * person.keypoints.len() as f64
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::super::samples::{MAX_POSED, SeenKeypoint};
    use super::*;
    use crate::sightings::fixture::hall;
    use farfield_proto::tick::Tick;

    const EVERY_TICKS: i64 = 6;

    /// What the camera shows at `passes` passes of somebody at `shown_m`, while people are at `people_m` (x, y).
    fn met(passes: i64, people_m: &[[f32; 2]], shown_m: &[[f32; 2]]) -> Met {
        let lines = SightLines::of(&hall().cameras[0].1);
        let body = |at: &[f32; 2]| -> Vec<[f32; 3]> {
            let place = |k: u8| [at[0] + 0.02 * f32::from(k), at[1], 0.1 * f32::from(k)];
            (0..17).map(place).collect()
        };
        let seen = |at: &[f32; 2]| {
            let pixel = |m: [f32; 3]| {
                let (px, _) = lines.project(&Vector3::from(m.map(f64::from)))?;
                let pixel = [px.x as f32, px.y as f32];
                Some(SeenKeypoint { pixel, score: 0.9 })
            };
            body(at).into_iter().map(pixel).collect()
        };
        let ticks = || (0..passes).map(|pass| Tick(pass * EVERY_TICKS));
        let posed: Vec<PosedTick> = ticks()
            .map(|tick| PosedTick {
                tick,
                people: people_m
                    .iter()
                    .zip(1..)
                    .map(|(at, id)| (id, body(at)))
                    .collect(),
            })
            .collect();
        let shown: Vec<PassSample> = ticks()
            .map(|tick| PassSample {
                tick,
                of_camera: vec![shown_m.iter().map(seen).collect()],
                unsure: vec![Vec::new()],
            })
            .collect();
        let posed: Vec<&PosedTick> = posed.iter().collect();
        let shown: Vec<&PassSample> = shown.iter().collect();
        Search::of((0, &lines), &posed, (&shown, EVERY_TICKS)).met()
    }

    #[test]
    fn a_camera_that_shows_others_than_are_there_is_told_from_one_that_shows_them() {
        let people = [[-1.0, 0.0], [1.0, 0.5]];
        let right = met(8, &people, &people);
        assert!(right.shows_them() && !right.shows_others(), "{right:?}");
        let wrong = met(8, &people, &[[0.0, -0.6], [0.2, 0.9]]);
        assert!(wrong.shows_others() && !wrong.shows_them(), "{wrong:?}");
    }

    #[test]
    fn a_camera_that_shows_nobody_misses_nobody() {
        let silent = met(8, &[[-1.0, 0.0]], &[]);
        assert!(!silent.shows_others() && !silent.shows_them(), "{silent:?}");
        let short = met(2, &[[-1.0, 0.0], [1.0, 0.5]], &[[0.0, -0.6], [0.2, 0.9]]);
        assert!(!short.shows_others(), "{short:?}");
    }

    #[test]
    fn of_more_people_than_are_kept_nobody_is_missed() {
        let people: Vec<[f32; 2]> = (0..MAX_POSED).map(|i| [0.05 * i as f32, 0.0]).collect();
        let others = [[-1.4, 0.0], [-1.4, 1.0]];
        assert!(met(8, &people[1..], &others).shows_others());
        assert_eq!(met(8, &people, &others), Met::default());
        let crowd = vec![others[0]; MAX_BODIES];
        assert_eq!(met(8, &people[1..], &crowd), Met::default());
    }
}
