//! How well the targets determine each DoF, and which reported angles they do not.

use std::f64::consts::PI;

use super::normal::{Factor, NormalEquations, Row};
use crate::body::skeleton::angles::FIRST_JOINT_ANGLE;
use crate::body::skeleton::dof::{ANCESTORS, DofGroup, MAX_CHAIN, first_of};
use crate::body::skeleton::range_of_motion::spread_rad;
use crate::body::skeleton::{N_ANGLES, N_DOF, N_ROOT_DOF, Pose, Side, reported_angles};

/// Standard deviation at which an angle counts as unknown, radians (11 degrees). With 17 exact
/// keypoints of 20 mm it is 14 degrees for the pelvis' tilt and 18 for the spine's extension, and
/// at most 10 for determined angles.
const UNKNOWN_RAD: f64 = 0.2;
/// The same for hips and shoulders (17 degrees): they inherit the uncertainty of pelvis and
/// scapula, 11 to 14 degrees, which is flagged there.
const UNKNOWN_LIMB_RAD: f64 = 0.3;
/// Or at this share of the prior deviation: an angle with a small range is unknown if the targets
/// halve its variance at best.
const UNKNOWN_SHARE: f64 = 0.7;
/// Standard deviation at which the root's position counts as unknown, metres.
const UNKNOWN_M: f64 = 0.1;
/// Prior spread of the root: a metre, and any direction.
const ROOT_SPREAD: [f64; N_ROOT_DOF] = [1.0, 1.0, 1.0, PI / 1.732, PI / 1.732, PI / 1.732];

/// The variance that targets leave to each DoF, if each was uniform over its clinical range before.
#[derive(Debug, Clone)]
pub(super) struct Observability {
    /// Prior precision of each DoF.
    before: [f64; N_DOF],
    /// Variance at which a DoF counts as unknown.
    unknown: [f64; N_DOF],
    variance: [f64; N_DOF],
    covariance: Box<[Row; N_DOF]>,
}

impl Observability {
    pub(super) fn new() -> Self {
        let spread = spread_before();
        let unknown = std::array::from_fn(|i| {
            let limit = match i {
                0..3 => UNKNOWN_M,
                _ if is_limb_root(i) => UNKNOWN_LIMB_RAD,
                _ => UNKNOWN_RAD,
            };
            limit.min(UNKNOWN_SHARE * spread[i]).powi(2)
        });
        Self {
            before: spread.map(|s| 1.0 / (s * s)),
            unknown,
            variance: spread.map(|s| s * s),
            covariance: Box::new([[0.0; MAX_CHAIN]; N_DOF]),
        }
    }

    /// Measures the targets in `normal`. Overwrites `factor`.
    pub(super) fn measure(&mut self, normal: &NormalEquations, factor: &mut Factor) {
        factor.compute(normal, &self.before, &[false; N_DOF]);
        factor.invert(&mut self.covariance);
        let rows = self.covariance.iter().zip(&ANCESTORS);
        for (variance, (row, ancestors)) in self.variance.iter_mut().zip(rows) {
            *variance = row[ancestors.dofs().len()];
        }
    }

    /// How much DoF `i` depends on the priors: near 0 if the targets determine it, near 1 if not.
    pub(super) fn ignorance(&self, i: usize) -> f64 {
        self.variance[i] / (self.variance[i] + self.unknown[i])
    }

    fn is_unknown(&self, i: usize) -> bool {
        self.variance[i] > self.unknown[i]
    }

    /// One bit per reported angle that the targets do not determine.
    ///
    /// The arm's flexion and adduction follow from the two swings alone, and its rotation also from
    /// the twist. Near an adduction of ±90 degrees, the pole of the reported angles, a small swing
    /// is a large flexion: then neither flexion nor rotation is determined.
    pub(super) fn unobserved(&self, pose: &Pose) -> u64 {
        // DoF of the root's list, tilt, rotation: about the pelvis' x, y, z.
        const ROOT: [usize; N_ROOT_DOF] = [4, 3, 5, 1, 2, 0];
        let mut unknown = [false; N_ANGLES];
        for (angle, dof) in ROOT.into_iter().chain(N_ROOT_DOF..N_DOF).enumerate() {
            unknown[angle] = self.is_unknown(dof);
        }
        let angles = reported_angles(pose);
        for side in Side::BOTH {
            let first = first_of(side, DofGroup::Shoulder);
            let (dof, angle) = (N_ROOT_DOF + first, FIRST_JOINT_ANGLE + first);
            let swing = self.variance[dof].max(self.variance[dof + 1]);
            let adduction = libm::cos(angles[angle + 1]).powi(2);
            let swing_is_unknown = self.is_unknown(dof) || self.is_unknown(dof + 1);
            unknown[angle + 1] = swing_is_unknown;
            unknown[angle] = swing_is_unknown || swing > adduction * self.unknown[dof];
            unknown[angle + 2] = unknown[angle] || self.is_unknown(dof + 2);
        }
        unknown
            .iter()
            .rev()
            .fold(0, |bits, &bit| bits << 1 | u64::from(bit))
    }
}

/// Prior standard deviation of each DoF: metres for the root's translation, else radians.
pub(super) fn spread_before() -> [f64; N_DOF] {
    let joints = spread_rad();
    std::array::from_fn(|i| {
        if i < N_ROOT_DOF {
            ROOT_SPREAD[i]
        } else {
            joints[i - N_ROOT_DOF]
        }
    })
}

/// Whether DoF `i` of all 40 belongs to a hip or a shoulder.
fn is_limb_root(i: usize) -> bool {
    Side::BOTH.into_iter().any(|side| {
        [DofGroup::Shoulder, DofGroup::Hip].into_iter().any(|part| {
            let first = N_ROOT_DOF + first_of(side, part);
            (first..first + 3).contains(&i)
        })
    })
}
