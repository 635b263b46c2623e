//! How often people of a scene meet, from its truth.

use farfield_fusion::body::skeleton::Joint;
use farfield_proto::tick::Tick;

use farfield_sim::scene::Scene;

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
    use super::*;
    use farfield_sim::embedded;

    #[test]
    fn each_pass_of_two_who_walk_up_and_down_is_a_meeting() {
        // 6 m at about 1.3 m/s each: they pass each other every four seconds and a half.
        let cross = embedded::scene("cross").unwrap();
        let passes = meetings(&cross) as f64;
        assert!((8.0..=10.0).contains(&passes), "{passes}");
        assert_eq!(meetings(&embedded::scene("one").unwrap()), 0);
    }
}
