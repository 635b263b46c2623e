//! How the sightings of a camera fit the poses of all people: its shift in time, and whether it
//! shows the tracked people.
//!
//! A person is missed if the pose is in the picture without a sighting, while the camera has a
//! sighting without a pose. A right camera misses few people, also behind obstacles.

use super::super::geometry::SightLines;
use super::super::samples::{MAX_BODIES, PassSample, PosedTick, Samples};
use super::KeypointHalf;
use super::pose_shift::{PoseSearch, PoseShift, Projected, Sighted};
use super::silent::SeenPass;

/// Mean cost below which a sighting is of a person.
const MAX_SAME_PERSON_COST: f64 = 0.5;
/// Least share of the keypoints in the picture of a person who is in it.
const MIN_SHARE_IN_PICTURE: f64 = 0.9;
/// Least number of shown, or missed, people; least number of passes; least ratio between the two
/// numbers. On the recordings and in fifty runs of scenes, right cameras missed at most 0.16 times
/// as many people as they showed.
const MIN_PEOPLE: usize = 6;
const MIN_PASSES: usize = 3;
const MIN_RATIO: usize = 2;

/// How many tracked people a camera shows and misses, summed over passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(in crate::camera_agreement) struct ShownPeople {
    shown: usize,
    missed: usize,
    /// Passes with missed people.
    passes: usize,
}

impl ShownPeople {
    /// Whether the camera shows other people than the tracked ones.
    pub(in crate::camera_agreement) fn shows_other_people(&self) -> bool {
        self.missed >= MIN_PEOPLE.max(MIN_RATIO * self.shown) && self.passes >= MIN_PASSES
    }

    /// Whether it shows the tracked people.
    pub(in crate::camera_agreement) fn shows_tracked(&self) -> bool {
        self.shown >= MIN_PEOPLE.max(MIN_RATIO * self.missed)
    }
}

/// How the sightings of a camera fit the poses of all people.
#[derive(Debug, Clone, Default)]
pub(in crate::camera_agreement) struct PoseFit {
    /// Its shift; `None` if people moved too little before it, or too few were sighted.
    pub(in crate::camera_agreement) shift: Option<PoseShift>,
    pub(in crate::camera_agreement) people: ShownPeople,
    /// The shown people by detection pass.
    pub(in crate::camera_agreement) seen: Vec<SeenPass>,
}

/// The fit of every camera.
pub(in crate::camera_agreement) fn pose_fits(
    samples: &Samples,
    lines: &[SightLines],
    rate_hz: f64,
) -> Vec<PoseFit> {
    let poses: Vec<&PosedTick> = samples.poses.iter().map(AsRef::as_ref).collect();
    let passes: Vec<&PassSample> = samples.passes.iter().map(AsRef::as_ref).collect();
    let every = samples.pose_every_ticks();
    let fit = |(camera, lines): (usize, &SightLines)| {
        let search = PoseSearch::new(camera, lines, &poses, &passes, every);
        PoseFit {
            shift: search.shift(rate_hz),
            people: search.shown_people(),
            seen: search.seen_passes(),
        }
    };
    lines.iter().enumerate().map(fit).collect()
}

impl PoseSearch<'_> {
    pub(super) fn shown_people(&self) -> ShownPeople {
        let mut all = ShownPeople::default();
        for pass in self.passes {
            let Some(people) = self.people_at(pass, 0) else {
                continue;
            };
            let bodies = &pass.of_camera[self.camera];
            // Sightings and people beyond the maximum are not kept, so any may be missing.
            if bodies.len() >= MAX_BODIES || !self.has_all_people_at(pass) {
                continue;
            }
            let seen = bodies
                .iter()
                .filter_map(|body| Sighted::new(body, KeypointHalf::All));
            let seen: Vec<Sighted> = seen.collect();
            let fits = |seen: &Sighted, person: &Projected| {
                let one = std::slice::from_ref(person);
                seen.cost(one, self.focal_px) < MAX_SAME_PERSON_COST
            };
            let is_shown = |person: &Projected| seen.iter().any(|seen| fits(seen, person));
            let is_known = |seen: &&Sighted| people.iter().any(|person| fits(seen, person));
            let expected = people.iter().filter(|person| self.is_in_picture(person));
            let (shown, hidden): (Vec<_>, Vec<_>) = expected.partition(|person| is_shown(person));
            let strangers = seen.iter().filter(|seen| !is_known(seen)).count();
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
        inside.count() as f64 >= MIN_SHARE_IN_PICTURE * person.keypoints.len() as f64
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

    /// The counts of a camera that sights people at `shown_m` (x, y) in each of `passes` passes,
    /// while the poses are at `people_m`.
    fn shown(passes: i64, people_m: &[[f32; 2]], shown_m: &[[f32; 2]]) -> ShownPeople {
        let lines = SightLines::from_camera(&hall().cameras[0].1);
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
        PoseSearch::new(0, &lines, &posed, &shown, EVERY_TICKS).shown_people()
    }

    #[test]
    fn a_camera_that_shows_other_people_differs_from_a_right_one() {
        let people = [[-1.0, 0.0], [1.0, 0.5]];
        let right = shown(8, &people, &people);
        assert!(
            right.shows_tracked() && !right.shows_other_people(),
            "{right:?}"
        );
        let wrong = shown(8, &people, &[[0.0, -0.6], [0.2, 0.9]]);
        assert!(
            wrong.shows_other_people() && !wrong.shows_tracked(),
            "{wrong:?}"
        );
    }

    #[test]
    fn a_camera_without_sightings_misses_no_people() {
        let silent = shown(8, &[[-1.0, 0.0]], &[]);
        assert!(
            !silent.shows_other_people() && !silent.shows_tracked(),
            "{silent:?}"
        );
        let short = shown(2, &[[-1.0, 0.0], [1.0, 0.5]], &[[0.0, -0.6], [0.2, 0.9]]);
        assert!(!short.shows_other_people(), "{short:?}");
    }

    #[test]
    fn no_people_are_missed_beyond_the_maximum() {
        let people: Vec<[f32; 2]> = (0..MAX_POSED).map(|i| [0.05 * i as f32, 0.0]).collect();
        let others = [[-1.4, 0.0], [-1.4, 1.0]];
        assert!(shown(8, &people[1..], &others).shows_other_people());
        assert_eq!(shown(8, &people, &others), ShownPeople::default());
        let crowd = vec![others[0]; MAX_BODIES];
        assert_eq!(shown(8, &people[1..], &crowd), ShownPeople::default());
    }
}
