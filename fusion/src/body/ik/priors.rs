//! Priors of a pose: the rest pose and the last pose.
//!
//! Keypoints do not determine the ankles, how scapula and shoulder share a raised arm, the pelvis'
//! tilt relative to the spine, or the twist of a straight limb. These go to the rest pose and stay
//! near their last value. [`super`] describes how the priors yield to targets.

use std::sync::LazyLock;

use farfield_proto::venue::parameters::IkParameters;
use nalgebra::{UnitQuaternion, Vector3};

use crate::body::skeleton::dof::{DofGroup, LUMBAR, NECK, first_of};
use crate::body::skeleton::{N_DOF, N_JOINT_DOF, Pose, Side};

/// Rate for which `change_sigma_rad` is defined, hertz.
const STATED_RATE_HZ: f64 = 60.0;
/// Sigma of the pelvis' position between two ticks at that rate, metres (9 m/s).
const ROOT_CHANGE_SIGMA_M: f64 = 0.15;

/// Sigma of the rest pose per DoF, in units of `rest_sigma_rad`: trunk and neck, then one side.
/// Joints that keypoints always determine are nearly free.
const TRUNK_AND_NECK_SIGMA: [f64; 6] = [1.0; 6];
const SIDE_SIGMA: [f64; 14] = [
    1.0, 1.0, 0.5, // scapula: elevation, protraction, tilt
    3.0, 3.0, 2.0, // shoulder: swings, twist
    3.0, // elbow
    3.0, 1.5, 1.0, // hip: flexion, adduction, rotation
    3.0, // knee
    0.7, 0.5, 0.3, // ankle
];

/// Twist of a relaxed arm, radians (20 degrees): near the middle of the clinical rotations in every
/// direction of the arm.
const ARM_TWIST_REST_RAD: f64 = 0.35;
/// A relaxed elbow, radians (10 degrees).
const ELBOW_REST_RAD: f64 = 0.17;

/// Elevation of the arm up to which the scapula rests, radians (30 degrees).
const RHYTHM_FROM_RAD: f64 = 0.524;
/// Elevation of our scapula per elevation of the arm beyond. Half of the scapula's third (rhythm
/// 2:1) happens at the sternoclavicular joint, about which our scapula turns, so 30 of 150 degrees
/// (Neumann, see [`crate::body::skeleton::range_of_motion`]).
const RHYTHM_SHARE: f64 = 0.2;

/// The DoF of the neutral pose.
static NEUTRAL: LazyLock<[f64; N_JOINT_DOF]> =
    LazyLock::new(|| Pose::neutral(Vector3::zeros(), UnitQuaternion::identity()).dof);

/// The two priors of one solve.
#[derive(Debug, Clone, PartialEq)]
pub struct Priors {
    /// Rest value per joint DoF, radians.
    pub rest: [f64; N_JOINT_DOF],
    /// Its standard deviation, radians.
    pub rest_sigma_rad: [f64; N_JOINT_DOF],
    /// The last pose, or a prediction from it.
    pub last: Pose,
    /// Standard deviation of the change from it per DoF: metres for the root's translation, else
    /// radians.
    pub change_sigma: [f64; N_DOF],
}

impl Priors {
    /// The priors of a solve `elapsed_s` seconds after `last`. The scapulas rest at the
    /// scapulohumeral rhythm of the last pose's arms.
    pub fn new(parameters: &IkParameters, last: &Pose, elapsed_s: f64) -> Self {
        let ticks = (elapsed_s * STATED_RATE_HZ).abs().max(1.0);
        let mut change_sigma = [parameters.change_sigma_rad * ticks; N_DOF];
        change_sigma[..3].fill(ROOT_CHANGE_SIGMA_M * ticks);
        let mut priors = Self {
            rest: *NEUTRAL,
            rest_sigma_rad: [parameters.rest_sigma_rad; N_JOINT_DOF],
            last: *last,
            change_sigma,
        };
        scale(
            &mut priors.rest_sigma_rad[LUMBAR..NECK + 3],
            &TRUNK_AND_NECK_SIGMA,
        );
        for side in Side::BOTH {
            let first = first_of(side, DofGroup::Scapula);
            scale(
                &mut priors.rest_sigma_rad[first..first + SIDE_SIGMA.len()],
                &SIDE_SIGMA,
            );
            priors.rest[first_of(side, DofGroup::Elbow)] = ELBOW_REST_RAD;
            priors.rest[first_of(side, DofGroup::Shoulder) + 2] = ARM_TWIST_REST_RAD;
        }
        priors.follow_arms();
        priors
    }

    /// Sets the rest elevation of the scapulas to the rhythm's for the last pose's arms.
    fn follow_arms(&mut self) {
        for side in Side::BOTH {
            let raised = self.last.arm_elevation_rad(side);
            let elevation = (raised - RHYTHM_FROM_RAD).max(0.0) * RHYTHM_SHARE;
            self.rest[first_of(side, DofGroup::Scapula)] = elevation;
        }
    }
}

fn scale(sigmas: &mut [f64], factors: &[f64]) {
    for (sigma, factor) in sigmas.iter_mut().zip(factors) {
        *sigma *= factor;
    }
}
