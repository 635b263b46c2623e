//! Gaps that nothing excuses: truths without a pose.
//!
//! Two kinds are excused. While a scene loses a person to all viewpoints but one, the position cannot be measured. And a
//! person who returns has no pose until found again, which another figure measures.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::tick::Tick;
use farfield_score::lines::PoseLines;
use farfield_score::matches_at;

use farfield_sim::scene::Scene;

/// Viewpoints that a position needs.
const LEAST_VIEWPOINTS: u32 = 2;

/// Ticks and numbers of the people of `scene` that `truth` contains without a pose in `poses`, except those who are lost and
/// those who are `returning`.
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
        seen_by.is_some_and(|viewpoints| viewpoints.count_ones() < LEAST_VIEWPOINTS)
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

#[cfg(test)]
mod tests {
    use farfield_score::points::{PointSet, ScoredBody};
    use nalgebra::Vector3;

    use super::*;
    use crate::suite::people::bodies::People;
    use farfield_sim::embedded;

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
}
