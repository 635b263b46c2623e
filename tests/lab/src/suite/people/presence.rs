//! From the truth of a scene: which people count in scores, which gaps nothing excuses, and how often people meet.
//!
//! People count while they are inside the field and in the images of two viewpoints. Otherwise they need no pose, and their
//! poses do not count as false.

use std::collections::{BTreeMap, BTreeSet};

use farfield_fusion::body::skeleton::Joint;
use farfield_proto::frames::Point;
use farfield_proto::tick::Tick;
use farfield_score::lines::PoseLines;
use farfield_score::matches_at;
use farfield_score::points::PointSet;
use farfield_sim::scene::{PersonTruth, Scene};

use crate::suite::people::{People, true_body};

/// Keypoints of a person that an image must contain, as many as a detector needs.
const LEAST_KEYPOINTS: usize = 6;
/// Viewpoints that a position needs.
const LEAST_VIEWPOINTS: usize = 2;

/// The people of a scene who count in scores, by tick.
pub struct ScenePresence {
    /// The truth of all people.
    everywhere: PoseLines,
    /// The truth of the people who count.
    pub truth: PoseLines,
    /// First tick of each in `truth`.
    pub since: BTreeMap<u32, Tick>,
}

impl ScenePresence {
    /// Computed from the truth of `scene`.
    pub fn new(scene: &Scene) -> Self {
        let (mut everywhere, mut present) = (People::new(), People::new());
        let mut since = BTreeMap::new();
        for tick in (scene.ticks().start.0..scene.ticks().end.0).map(Tick) {
            for (person, who) in scene.people().iter().enumerate() {
                let Some(truth) = scene.truth_at(person, tick) else {
                    continue;
                };
                let body = true_body(&truth);
                if is_present(scene, &truth) {
                    since.entry(who.number).or_insert(tick);
                    let at_tick = present.entry(tick).or_default();
                    at_tick.insert(who.number, body.clone());
                }
                everywhere.entry(tick).or_default().insert(who.number, body);
            }
        }
        let recording = |people| PoseLines::from_people(PointSet::Joints, people);
        Self {
            everywhere: recording(everywhere),
            truth: recording(present),
            since,
        }
    }

    /// `poses` without those of people who do not count at that tick.
    pub fn scorable(&self, poses: &PoseLines) -> PoseLines {
        let mut counted = People::new();
        for tick in poses.ticks() {
            let owners = matches_at(tick, poses, &self.everywhere);
            let present = self.truth.people_at(tick);
            let excused: Vec<u32> = owners
                .into_iter()
                .filter(|(actor, _)| present.is_none_or(|people| !people.contains_key(actor)))
                .map(|(_, id)| id)
                .collect();
            let people = poses.people_at(tick).into_iter().flatten();
            let people = people.filter(|(id, _)| !excused.contains(id));
            let people: BTreeMap<_, _> = people.map(|(id, body)| (*id, body.clone())).collect();
            if !people.is_empty() {
                counted.insert(tick, people);
            }
        }
        PoseLines::from_people(PointSet::Joints, counted)
    }
}

/// Whether the pelvis is inside the field, and enough keypoints are in the images of two viewpoints; occlusion by bodies does
/// not count.
fn is_present(scene: &Scene, truth: &PersonTruth) -> bool {
    let [min_m, max_m] = scene.field_bounds_m();
    let pelvis_m = truth.joint_m(Joint::Pelvis);
    let inside = |axis: usize| (min_m[axis]..=max_m[axis]).contains(&pelvis_m[axis]);
    if !(0..2).all(inside) {
        return false;
    }
    let sees = |camera: &usize| {
        let model = &scene.cameras()[*camera];
        let sites = truth.sites_m.iter().filter(|site_m| {
            let px = model.project(Point::new((**site_m).into()));
            px.is_some_and(|px| model.sees(px))
        });
        sites.count() >= LEAST_KEYPOINTS
    };
    let viewpoints = scene.viewpoints().iter();
    let seeing = viewpoints.filter(|viewpoint| viewpoint.cameras.iter().any(sees));
    seeing.count() >= LEAST_VIEWPOINTS
}

/// Viewpoints that a position needs.
const MIN_VIEWPOINTS: u32 = 2;

/// Ticks and numbers of the people of `scene` that `truth` contains without a pose in `poses`. People who are lost or
/// `returning` are excused.
pub fn unexcused(
    scene: &Scene,
    poses: &PoseLines,
    truth: &PoseLines,
    returning: &BTreeSet<(Tick, u32)>,
) -> BTreeSet<(Tick, u32)> {
    let people = scene.people().iter().enumerate();
    let places: BTreeMap<u32, usize> = people.map(|(i, who)| (who.number, i)).collect();
    let is_lost = |tick: Tick, actor: u32| {
        let seen_by = places.get(&actor);
        let seen_by = seen_by.map(|&person| scene.seen_by(person, scene.time_s(tick)));
        seen_by.is_some_and(|viewpoints| viewpoints.count_ones() < MIN_VIEWPOINTS)
    };
    let mut gaps = BTreeSet::new();
    for tick in truth.ticks() {
        let matches = matches_at(tick, poses, truth);
        let there = truth.people_at(tick).into_iter().flat_map(BTreeMap::keys);
        let missing = there.filter(|actor| !matches.contains_key(*actor));
        gaps.extend(
            missing
                .map(|&actor| (tick, actor))
                .filter(|gap| !returning.contains(gap) && !is_lost(tick, gap.1)),
        );
    }
    gaps
}

/// Pelvises within this distance have met, metres: shoulder to shoulder.
const NEAR_M: f64 = 0.7;
/// At this distance they have parted, metres.
const APART_M: f64 = 1.5;

/// Number of times that two people of `scene` have come near each other and parted again, over all pairs.
pub fn meetings(scene: &Scene) -> u64 {
    let people = scene.people().len();
    let mut near = vec![false; people * people];
    let mut parted = 0;
    for tick in (scene.ticks().start.0..scene.ticks().end.0).map(Tick) {
        let pelvis_m = |person: usize| {
            let truth = scene.truth_at(person, tick)?;
            Some(truth.joint_m(Joint::Pelvis).xy())
        };
        let pelvises_m: Vec<_> = (0..people).map(pelvis_m).collect();
        for (a, at_m) in pelvises_m.iter().enumerate() {
            for (b, other_m) in pelvises_m.iter().enumerate().skip(a + 1) {
                let (Some(at_m), Some(other_m)) = (at_m, other_m) else {
                    continue;
                };
                let apart_m = (at_m - other_m).norm();
                let is_near = &mut near[a * people + b];
                parted += u64::from(*is_near && apart_m > APART_M);
                *is_near = apart_m < NEAR_M || *is_near && apart_m <= APART_M;
            }
        }
    }
    parted
}

#[cfg(test)]
mod tests {
    use farfield_score::points::{PointSet, ScoredBody};
    use farfield_sim::embedded;
    use nalgebra::Vector3;

    use super::*;
    use crate::suite::people::People;

    #[test]
    fn people_outside_the_field_do_not_count() {
        let scene = embedded::scene("return").unwrap();
        let presence = ScenePresence::new(&scene);
        let ticks = |actor: u32| -> Vec<i64> {
            let there = |tick: &Tick| {
                presence
                    .truth
                    .people_at(*tick)
                    .unwrap()
                    .contains_key(&actor)
            };
            presence
                .truth
                .ticks()
                .filter(there)
                .map(|tick| tick.0)
                .collect()
        };
        assert_eq!(ticks(1), (0..scene.ticks().end.0).collect::<Vec<_>>());
        for actor in [2, 3] {
            let ticks = ticks(actor);
            let away = ticks
                .windows(2)
                .map(|pair| pair[1] - pair[0])
                .max()
                .unwrap();
            assert!(away > 90, "person {actor} is away for {away} ticks");
        }
        // Perfect poses of all people, wherever they are, are reduced to the people who count.
        let counted = presence.scorable(&presence.everywhere);
        assert_eq!(counted.ticks().count(), presence.truth.ticks().count());
        for tick in counted.ticks() {
            let [a, b] = [&counted, &presence.truth].map(|r| r.people_at(tick).unwrap().len());
            assert_eq!(a, b, "tick {tick}");
        }
    }

    /// Persons 1 to 3, each 3 m from the next.
    fn recording(at: impl Iterator<Item = (i64, u32)>) -> PoseLines {
        let mut people = People::new();
        for (tick, person) in at {
            let mut body = ScoredBody::default();
            body.points_m[0] = Some(Vector3::new(3.0 * f64::from(person), 0.0, 1.0));
            people.entry(Tick(tick)).or_default().insert(person, body);
        }
        PoseLines::from_people(PointSet::Joints, people)
    }

    #[test]
    fn an_excuse_covers_one_person_at_one_tick_only() {
        // The scene loses its first person to all viewpoints but one from 2 s to 3 s.
        let scene = embedded::scene("lost").unwrap();
        let tick = |time_s: f64| (time_s * scene.rate_hz()).round() as i64;
        let all = || (0..tick(4.0)).flat_map(|tick| [1, 2, 3].map(|person| (tick, person)));
        let missing = [
            (tick(1.9), 1),
            (tick(2.5), 1),
            (tick(2.5), 2),
            (tick(3.0), 1),
            (tick(2.5), 3),
            (tick(3.5), 3),
        ];
        let truth = recording(all());
        let poses = recording(all().filter(|at| !missing.contains(at)));
        // One tick of the first is both lost and a return: it excuses no other.
        let returning = [(tick(2.5), 3), (tick(2.5), 1)].map(|(tick, who)| (Tick(tick), who));
        let gaps = unexcused(&scene, &poses, &truth, &BTreeSet::from(returning));
        let expected = [
            (tick(1.9), 1),
            (tick(2.5), 2),
            (tick(3.0), 1),
            (tick(3.5), 3),
        ];
        let expected = expected.map(|(tick, who)| (Tick(tick), who));
        assert_eq!(gaps, BTreeSet::from(expected));
    }

    #[test]
    fn each_pass_of_two_who_walk_up_and_down_is_a_meeting() {
        // 6 m at about 1.3 m/s each: they pass each other every four seconds and a half.
        let cross = embedded::scene("cross").unwrap();
        let passes = meetings(&cross) as f64;
        assert!((8.0..=10.0).contains(&passes), "{passes}");
        assert_eq!(meetings(&embedded::scene("one").unwrap()), 0);
    }
}
