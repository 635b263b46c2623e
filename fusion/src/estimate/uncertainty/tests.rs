//! Laws that hold for any values of the constants.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::observation::SIGHTED_M;
use super::*;
use crate::body::skeleton::{Pose, Proportions, Skeleton};

const DT_S: f64 = 1.0 / 60.0;
/// Error of a keypoint that is seen well, metres per axis.
const SIGMA_M: f64 = 0.01;

/// The keypoints of a network with one keypoint per listed joint, and their body.
struct SimulatedView {
    body: Kinematics,
    joints: Vec<Joint>,
    estimates: Vec<KeypointEstimate>,
    velocity_m_s: Joints,
}

const KEYPOINTS: [Joint; 13] = [
    Joint::Nose,
    Joint::LeftShoulder,
    Joint::RightShoulder,
    Joint::LeftElbow,
    Joint::RightElbow,
    Joint::LeftWrist,
    Joint::RightWrist,
    Joint::LeftHip,
    Joint::RightHip,
    Joint::LeftKnee,
    Joint::RightKnee,
    Joint::LeftAnkle,
    Joint::RightAnkle,
];

impl SimulatedView {
    fn well() -> Self {
        let skeleton = Skeleton::new(&Proportions::from_stature(1.75));
        let pose = Pose::neutral(Vector3::new(1.0, 2.0, 0.93), UnitQuaternion::identity());
        let mut body = Kinematics::default();
        skeleton.forward(&pose, &mut body);
        let joints = KEYPOINTS.to_vec();
        let estimate = |joint: &Joint| KeypointEstimate {
            weight: 1.0,
            views: 4,
            information: Matrix3::identity() / (SIGMA_M * SIGMA_M),
            ..KeypointEstimate::unsupported(body.joint_m(*joint), 1.0)
        };
        Self {
            estimates: joints.iter().map(estimate).collect(),
            joints,
            body,
            velocity_m_s: [Vector3::new(1.0, 0.0, 0.0); N_JOINTS],
        }
    }

    fn lose(&mut self, lost: Joint) {
        for (joint, estimate) in self.joints.iter().zip(&mut self.estimates) {
            if *joint == lost {
                *estimate = KeypointEstimate::unsupported(estimate.position_m, 0.0);
            }
        }
    }

    fn step(&self, uncertainty: &mut Uncertainty, made_of: MadeOf) -> [f64; N_JOINTS] {
        let sites: Vec<Option<Site>> = (self.joints.iter())
            .map(|&joint| {
                Some(Site {
                    joint,
                    offset_m: Vector3::zeros(),
                })
            })
            .collect();
        uncertainty.step(&TickEvidence {
            estimates: &self.estimates,
            sites: &sites,
            body: &self.body,
            velocity_m_s: &self.velocity_m_s,
            variance_factor: None,
            made_of,
            dt_s: DT_S,
            coast_decay_s: 0.25,
        });
        uncertainty.sigma_m().unwrap_or([f64::NAN; N_JOINTS])
    }
}

#[test]
fn a_person_never_seen_has_no_sigma() {
    let mut uncertainty = Uncertainty::default();
    SimulatedView::well().step(&mut uncertainty, MadeOf::Motion);
    assert_eq!(uncertainty.sigma_m(), None);
    SimulatedView::well().step(&mut uncertainty, MadeOf::Views);
    assert!(uncertainty.sigma_m().is_some());
    uncertainty.reset();
    assert_eq!(uncertainty.sigma_m(), None);
}

#[test]
fn a_seen_joint_has_the_sigma_of_its_keypoint() {
    let sigma_m = SimulatedView::well().step(&mut Uncertainty::default(), MadeOf::Views);
    for joint in [Joint::LeftWrist, Joint::RightElbow, Joint::LeftAnkle] {
        let sigma_m = sigma_m[joint.index()];
        assert!(
            (0.5 * SIGMA_M..=1.01 * SIGMA_M).contains(&sigma_m),
            "{sigma_m}"
        );
    }
    assert!(
        sigma_m[Joint::LeftToe.index()] > 2.0 * SIGMA_M,
        "{sigma_m:?}"
    );
}

#[test]
fn a_lost_hand_grows_unsure_up_to_its_reach() {
    let (mut seen, mut uncertainty) = (SimulatedView::well(), Uncertainty::default());
    let before_m = seen.step(&mut uncertainty, MadeOf::Views);
    seen.lose(Joint::LeftWrist);
    let soon_m = seen.step(&mut uncertainty, MadeOf::Views);
    let mut late_m = soon_m;
    for _ in 0..600 {
        late_m = seen.step(&mut uncertainty, MadeOf::Views);
    }
    let (wrist, hip) = (Joint::LeftWrist.index(), Joint::LeftHip.index());
    assert!(before_m[wrist] < soon_m[wrist] && soon_m[wrist] < 2.0 * before_m[wrist]);
    assert!(
        late_m[wrist] > 0.05 && late_m[wrist] < 0.4,
        "{}",
        late_m[wrist]
    );
    assert!((late_m[hip] - before_m[hip]).abs() < 0.002);
}

#[test]
fn a_coasting_person_grows_unsure_until_it_is_seen() {
    let (seen, mut uncertainty) = (SimulatedView::well(), Uncertainty::default());
    let before_m = seen.step(&mut uncertainty, MadeOf::Views);
    let mut last_m = before_m;
    for _ in 0..30 {
        let sigma_m = seen.step(&mut uncertainty, MadeOf::Motion);
        assert!(sigma_m.iter().zip(&last_m).all(|(now, last)| now > last));
        last_m = sigma_m;
    }
    assert!(last_m[Joint::Pelvis.index()] > 0.1, "{last_m:?}");
    let back_m = seen.step(&mut uncertainty, MadeOf::Views);
    assert!(back_m.iter().zip(&last_m).all(|(now, last)| now < last));
    let mut again_m = back_m;
    for _ in 0..30 {
        again_m = seen.step(&mut uncertainty, MadeOf::Views);
    }
    assert!(
        again_m
            .iter()
            .zip(&before_m)
            .all(|(now, first)| (now - first).abs() < 1e-3)
    );
}

#[test]
fn a_pose_away_from_its_keypoints_is_less_sure() {
    let (mut seen, mut uncertainty) = (SimulatedView::well(), Uncertainty::default());
    let before_m = seen.step(&mut uncertainty, MadeOf::Views);
    for (joint, estimate) in seen.joints.iter().zip(&mut seen.estimates) {
        if *joint == Joint::RightShoulder {
            estimate.position_m.z += 0.1;
        }
    }
    let mut after_m = before_m;
    for _ in 0..60 {
        after_m = seen.step(&mut uncertainty, MadeOf::Views);
    }
    let [left, right] = [Joint::LeftShoulder, Joint::RightShoulder].map(Joint::index);
    assert!(after_m[right] > 2.0 * before_m[right], "{}", after_m[right]);
    assert!((after_m[left] - before_m[left]).abs() < 1e-6);
}

#[test]
fn two_views_at_a_sharp_angle_leave_depth_unsure() {
    let (mut seen, mut uncertainty) = (SimulatedView::well(), Uncertainty::default());
    let square_m = seen.step(&mut uncertainty, MadeOf::Views);
    for estimate in &mut seen.estimates {
        estimate.information[(0, 0)] *= 0.05;
    }
    let sharp_m = seen.step(&mut Uncertainty::default(), MadeOf::Views);
    assert!(
        sharp_m
            .iter()
            .zip(&square_m)
            .all(|(sharp, square)| sharp > square)
    );
}

#[test]
fn with_one_view_the_distance_grows_unsure() {
    let (mut seen, mut uncertainty) = (SimulatedView::well(), Uncertainty::default());
    let before_m = seen.step(&mut uncertainty, MadeOf::Views);
    for estimate in &mut seen.estimates {
        estimate.information[(0, 0)] = 0.0;
        estimate.views = 1;
    }
    let mut last_m = before_m;
    for _ in 0..10 {
        let sigma_m = seen.step(&mut uncertainty, MadeOf::OneView);
        let pelvis = Joint::Pelvis.index();
        assert!(sigma_m[pelvis] > last_m[pelvis]);
        last_m = sigma_m;
    }
    seen.step(&mut uncertainty, MadeOf::Motion);
    let carried_m = seen.step(&mut uncertainty, MadeOf::Motion);
    assert!(
        carried_m
            .iter()
            .zip(&last_m)
            .all(|(carried, one)| carried > one)
    );
}

#[test]
fn flickering_between_one_view_and_none_is_as_unsure_as_one() {
    let pelvis_m_after_a_second = |of_tick: fn(u32) -> MadeOf| {
        let (mut seen, mut uncertainty) = (SimulatedView::well(), Uncertainty::default());
        seen.step(&mut uncertainty, MadeOf::Views);
        for estimate in &mut seen.estimates {
            estimate.information[(0, 0)] = 0.0;
            estimate.views = 1;
        }
        let mut sigma_m = [0.0; N_JOINTS];
        for tick in 0..60 {
            sigma_m = seen.step(&mut uncertainty, of_tick(tick));
        }
        sigma_m[Joint::Pelvis.index()]
    };
    let steady_m = pelvis_m_after_a_second(|_| MadeOf::OneView);
    for of_tick in [
        |tick| [MadeOf::OneView, MadeOf::Motion][tick as usize % 2],
        |tick| [MadeOf::Motion, MadeOf::OneView][tick as usize % 2],
        |tick| [MadeOf::OneView, MadeOf::Motion][tick as usize / 3 % 2],
    ] {
        let flickering_m = pelvis_m_after_a_second(of_tick);
        assert!(
            flickering_m >= steady_m,
            "{flickering_m} m, steady {steady_m} m"
        );
    }
}

#[test]
fn a_sighting_counts_by_its_views() {
    let sigma_of = |views: u16| {
        let mut seen = SimulatedView::well();
        for estimate in &mut seen.estimates {
            (estimate.views, estimate.information) = (views, Matrix3::zeros());
        }
        seen.step(&mut Uncertainty::default(), MadeOf::Views)[Joint::LeftElbow.index()]
    };
    assert!(sigma_of(4) < sigma_of(2) && sigma_of(2) < SIGHTED_M);
}

#[test]
fn non_finite_information_is_ignored() {
    let mut seen = SimulatedView::well();
    seen.estimates[5].information[(1, 1)] = f64::NAN;
    let sigma_m = seen.step(&mut Uncertainty::default(), MadeOf::Views);
    assert!(sigma_m.iter().all(|s| s.is_finite()));
}
