//! From the truth of a scene: which people count in scores, which gaps nothing excuses, and how often people meet.
//!
//! People count while they are inside the field and in the images of two viewpoints. Otherwise they need no pose, and their
//! poses do not count as false.

use std::collections::BTreeMap;

use farfield_fusion::body::skeleton::Joint;
use farfield_proto::frames::Point;
use farfield_proto::tick::Tick;
use farfield_score::lines::PoseLines;
use farfield_score::matches_at;
use farfield_score::points::PointSet;

use crate::suite::people::bodies::{People, true_body};
use farfield_sim::scene::{PersonTruth, Scene};

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
    pub fn of(scene: &Scene) -> Self {
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
        let mut kept = People::new();
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
                kept.insert(tick, people);
            }
        }
        PoseLines::from_people(PointSet::Joints, kept)
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

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_sim::embedded;

    #[test]
    fn people_outside_the_field_do_not_count() {
        let scene = embedded::scene("return").unwrap();
        let presence = ScenePresence::of(&scene);
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
        let kept = presence.scorable(&presence.everywhere);
        assert_eq!(kept.ticks().count(), presence.truth.ticks().count());
        for tick in kept.ticks() {
            let [a, b] = [&kept, &presence.truth].map(|r| r.people_at(tick).unwrap().len());
            assert_eq!(a, b, "tick {tick}");
        }
    }
}
