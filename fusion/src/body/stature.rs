//! Stature of a person from a pose.

use nalgebra::Vector3;

use super::skeleton::{Joint, Proportions};

/// The links from the ankle to the middle of the head of an upright person; hips are as high as the
/// pelvis.
const UPWARD: [[Joint; 2]; 5] = [
    [Joint::LeftAnkle, Joint::LeftKnee],
    [Joint::LeftKnee, Joint::LeftHip],
    [Joint::Pelvis, Joint::Spine],
    [Joint::Spine, Joint::Neck],
    [Joint::Neck, Joint::Head],
];

/// Body height of a person with these joints (world, metres, in the order of [`Joint`]), from the
/// soles to the top of the head when upright, metres, without shoes and hair. `None` if joints are
/// missing.
///
/// ```text
///   stature = Σ lᵢ / Σ rᵢ,   lᵢ: shank, thigh, lumbar, trunk and neck, metres,   rᵢ: those of the average body, in statures
/// ```
///
/// The ankle above the sole and the top of the head above its middle have no keypoints: they are
/// those of the average.
pub(crate) fn stature_m(joints_m: &[[f32; 3]]) -> Option<f64> {
    let at_m = |joint: Joint| {
        let at_m = joints_m.get(joint.index())?;
        Some(Vector3::from(at_m.map(f64::from)))
    };
    let mut sum_m = 0.0;
    for [below, above] in UPWARD {
        sum_m += (at_m(above)? - at_m(below)?).norm();
    }
    let average = Proportions::from_stature(1.0);
    let share =
        average.shank_m + average.thigh_m + average.lumbar_m + average.trunk_m + average.head_m;
    Some(sum_m / share).filter(|stature_m| stature_m.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::fixture::{Noise, postures};
    use crate::body::skeleton::{Kinematics, Skeleton};

    /// What single precision leaves, metres.
    const ROUNDING_M: f64 = 1e-5;

    fn stature_of(body: &Proportions) -> Vec<f64> {
        let skeleton = Skeleton::new(body);
        let postures = postures(10, &mut Noise(4));
        let statures = postures.iter().map(|pose| {
            let mut kinematics = Kinematics::default();
            skeleton.forward(pose, &mut kinematics);
            let joints_m = kinematics
                .joints_m
                .map(|at_m| [at_m.x as f32, at_m.y as f32, at_m.z as f32]);
            stature_m(&joints_m).unwrap()
        });
        statures.collect()
    }

    #[test]
    fn the_average_body_keeps_its_stature_in_any_pose() {
        for made_m in [1.2, 1.75, 1.95] {
            for stature_m in stature_of(&Proportions::from_stature(made_m)) {
                assert!((stature_m - made_m).abs() < ROUNDING_M, "{stature_m}");
            }
        }
    }

    #[test]
    fn long_legs_make_tall_and_long_arms_do_not() {
        let average = Proportions::from_stature(1.7);
        let legs = Proportions {
            thigh_m: average.thigh_m + 0.05,
            ..average
        };
        let arms = Proportions {
            forearm_m: average.forearm_m + 0.05,
            ..average
        };
        assert!(stature_of(&legs).iter().all(|&m| (1.74..1.77).contains(&m)));
        assert!(
            stature_of(&arms)
                .iter()
                .all(|m| (m - 1.7).abs() < ROUNDING_M)
        );
    }

    #[test]
    fn without_all_joints_there_is_no_stature() {
        assert_eq!(stature_m(&[[0.0; 3]; 5]), None);
    }
}
