//! The range of motion: hard bounds on every joint DoF, paper (14)-(15).
//!
//! Sources of the table:
//! * JOA/AAOS: the ranges of the Japanese Orthopaedic Association (with the Japanese Association of
//!   Rehabilitation Medicine, 1995), which follow the American Academy of Orthopaedic Surgeons' "Joint
//!   Motion" (1965).
//! * Neumann: D. A. Neumann, "Kinesiology of the Musculoskeletal System", chapter on the shoulder
//!   complex: of the 180 degrees of a raised arm 120 are glenohumeral and 60 the scapula's upward
//!   rotation, and of these about 30 happen at the sternoclavicular joint (SC) and 30 at the
//!   acromioclavicular joint (AC).
//!
//! The clinical 180 degrees of the shoulder are scapula and shoulder together and are not counted
//! twice: our scapula turns about the SC and gets its 30, our shoulder holds the AC and gets
//! 120 + 30 = 150.
//!
//! The swing box of the shoulder is the bounding box, in the coordinates of `shoulder.rs`, of
//! the directions that the clinical ranges allow against the scapula: 0 to 150 degrees of elevation in
//! every plane from abduction to horizontal flexion of 115 (JOA's 135 less the 20 of the shoulder
//! girdle), to 100 as far as 135, 0 to 120 as far as horizontal extension of 30, and extension of 50.
//! That is -88.5..86.1 (raising) and -77.0..92.1 (inward) degrees, rounded outward. The twist is the
//! span of JOA's rotations (external 60 and internal 80 with the arm at the side, external 90 and
//! internal 70 in abduction, and those of a flexed, an extended and a fully raised arm), each
//! expressed as a twist from the middle of the reach: -66..123.4, rounded outward. A box is wider
//! than the clinical limits at its corners; that is the price of bounds that are simple and exact.

use std::f64::consts::PI;

use nalgebra::Vector3;

use super::angles::{FIRST_JOINT_ANGLE, N_ANGLES, is_translation};
use super::dof::{DofGroup, LUMBAR, N_JOINT_DOF, NECK, first_of};
use super::joint::Side;
use super::model::Pose;
use super::shoulder::SwingTwist;

/// One DoF: what it is, least and greatest angle in degrees, and the limit beyond which no factor
/// takes it: short of the pole for the middle one of three angles, of a half turn for others.
type RangeRow = (&'static str, f64, f64, f64);

/// Limit of the middle one of three angles, degrees.
const MIDDLE: f64 = 85.0;
/// Limit of a first, last or only angle, degrees.
const OUTER: f64 = 175.0;
/// Limit of each swing, degrees: the corner of the box stays clear of 180.
const SWING: f64 = 110.0;

const TRUNK_AND_NECK: [RangeRow; 6] = [
    // JOA/AAOS trunk: flexion 45, extension 30, lateral bending 50, rotation 40.
    ("lumbar extension", -45.0, 30.0, OUTER),
    ("lumbar bending", -50.0, 50.0, MIDDLE),
    ("lumbar rotation", -40.0, 40.0, OUTER),
    // JOA/AAOS neck: flexion 60, extension 50, lateral bending 50, rotation 60.
    ("neck flexion", -50.0, 60.0, OUTER),
    ("neck bending", -50.0, 50.0, MIDDLE),
    ("neck rotation", -60.0, 60.0, OUTER),
];

const SIDE: [RangeRow; 14] = [
    // JOA shoulder girdle: depression 10; Neumann: the SC's 30 of a raised arm (JOA's shrug is 20).
    ("scapula elevation", -10.0, 30.0, OUTER),
    // JOA shoulder girdle: flexion 20, extension 20.
    ("scapula protraction", -20.0, 20.0, MIDDLE),
    // Neumann: the clavicle turns back by 20-35; forward tilt about 10.
    ("scapula tilt", -30.0, 10.0, OUTER),
    // See the head of this file.
    ("shoulder raising swing", -90.0, 87.0, SWING),
    ("shoulder inward swing", -78.0, 93.0, SWING),
    ("shoulder twist", -70.0, 125.0, OUTER),
    // JOA/AAOS elbow: extension 5, flexion 145.
    ("elbow flexion", -5.0, 145.0, OUTER),
    // JOA/AAOS hip: flexion 125, extension 15, abduction 45, adduction 20, rotations 45.
    ("hip flexion", -15.0, 125.0, OUTER),
    ("hip adduction", -45.0, 20.0, MIDDLE),
    ("hip rotation", -45.0, 45.0, OUTER),
    // JOA/AAOS knee: extension 0, flexion 130.
    ("knee flexion", 0.0, 130.0, OUTER),
    // JOA/AAOS ankle and foot: dorsiflexion 20, plantar flexion 45; inversion 30, eversion 20;
    // adduction (toe-in) 20, abduction 10.
    ("ankle dorsiflexion", -45.0, 20.0, OUTER),
    ("subtalar inversion", -20.0, 30.0, MIDDLE),
    ("foot toe-in", -10.0, 20.0, OUTER),
];

/// Samples per edge of the swing box when the reach across the body is measured.
const REACH_SAMPLES: usize = 200;
/// What lies between two samples, radians: half the longest edge's step (220 degrees / 200), since
/// the exponential map does not stretch on the sphere.
const REACH_MARGIN_RAD: f64 = 0.01;

fn row(dof: usize) -> &'static RangeRow {
    if dof < TRUNK_AND_NECK.len() {
        &TRUNK_AND_NECK[dof]
    } else {
        &SIDE[(dof - TRUNK_AND_NECK.len()) % SIDE.len()]
    }
}

/// Bounds on the 34 DoF of the joints, radians (all fields). The root is free.
#[derive(Debug, Clone, PartialEq)]
pub struct RangeOfMotion {
    lo: [f64; N_JOINT_DOF],
    hi: [f64; N_JOINT_DOF],
    /// Greatest reported adduction of an arm.
    arm_add_hi: f64,
}

impl Default for RangeOfMotion {
    fn default() -> Self {
        Self::new(1.0)
    }
}

impl RangeOfMotion {
    /// The clinical ranges multiplied by `factor` (1 is clinical, athletes have more; a factor that is
    /// not a number above 0 counts as 1).
    pub fn new(factor: f64) -> Self {
        let factor = if factor.is_finite() && factor > 0.0 {
            factor
        } else {
            1.0
        };
        let mut bounds = Self {
            lo: [0.0; N_JOINT_DOF],
            hi: [0.0; N_JOINT_DOF],
            arm_add_hi: 0.0,
        };
        for dof in 0..N_JOINT_DOF {
            let (_, lo_deg, hi_deg, limit_deg) = row(dof);
            bounds.lo[dof] = (lo_deg * factor).max(-limit_deg).to_radians();
            bounds.hi[dof] = (hi_deg * factor).min(*limit_deg).to_radians();
        }
        bounds.arm_add_hi = bounds.reach_across();
        bounds
    }

    /// Least value of DoF `dof` of [`Pose::dof`], radians.
    pub fn lo_rad(&self, dof: usize) -> f64 {
        self.lo[dof]
    }

    /// Greatest value of DoF `dof` of [`Pose::dof`], radians.
    pub fn hi_rad(&self, dof: usize) -> f64 {
        self.hi[dof]
    }

    /// Whether every joint DoF is inside, bounds included.
    pub fn contains(&self, pose: &Pose) -> bool {
        self.n_outside(pose) == 0
    }

    /// How many joint DoF are outside, or not a number.
    pub fn n_outside(&self, pose: &Pose) -> usize {
        let inside = |i: usize, q: f64| (self.lo[i]..=self.hi[i]).contains(&q);
        pose.dof
            .iter()
            .enumerate()
            .filter(|&(i, &q)| !inside(i, q))
            .count()
    }

    /// The pose with every joint DoF moved to its nearest bound where it is outside.
    #[must_use]
    pub fn clamp(&self, mut pose: Pose) -> Pose {
        for (i, q) in pose.dof.iter_mut().enumerate() {
            *q = q.clamp(self.lo[i], self.hi[i]);
        }
        pose
    }

    /// Least and greatest value of reported angle `angle` (an index of
    /// [`ANGLE_NAMES`](super::ANGLE_NAMES)) over all poses inside, radians; infinite for the root's
    /// translations. The arm's flexion and rotation are Euler angles of a spherical joint and span
    /// the full turn; its adduction spans what the swing reaches.
    ///
    /// # Panics
    /// For an index that is not that of an angle.
    pub fn reported_range(&self, angle: usize) -> (f64, f64) {
        assert!(angle < N_ANGLES, "there are {N_ANGLES} angles");
        if is_translation(angle) {
            return (f64::NEG_INFINITY, f64::INFINITY);
        }
        let Some(dof) = angle.checked_sub(FIRST_JOINT_ANGLE) else {
            // The pelvis' list is the middle angle.
            return if angle == 1 {
                (-PI / 2.0, PI / 2.0)
            } else {
                (-PI, PI)
            };
        };
        for side in Side::BOTH {
            let arm = first_of(side, DofGroup::Shoulder);
            if dof == arm || dof == arm + 2 {
                return (-PI, PI);
            }
            if dof == arm + 1 {
                return (-PI / 2.0, self.arm_add_hi);
            }
        }
        (self.lo[dof], self.hi[dof])
    }

    /// Greatest adduction that the swing box allows, radians: on its border, since the direction
    /// straight inward is not inside; or π/2 if it is.
    fn reach_across(&self) -> f64 {
        let right = SwingTwist::for_side(Side::Right);
        let first = first_of(Side::Right, DofGroup::Shoulder);
        let (lo1, hi1) = (self.lo[first], self.hi[first]);
        let (lo2, hi2) = (self.lo[first + 1], self.hi[first + 1]);
        let [s1, s2] = right.swing_to(&Vector3::y());
        if (lo1..=hi1).contains(&s1) && (lo2..=hi2).contains(&s2) {
            return PI / 2.0;
        }
        let mut greatest = f64::NEG_INFINITY;
        for i in 0..=REACH_SAMPLES {
            let t = i as f64 / REACH_SAMPLES as f64;
            let (s1, s2) = (lo1 + t * (hi1 - lo1), lo2 + t * (hi2 - lo2));
            for (s1, s2) in [(s1, lo2), (s1, hi2), (lo1, s2), (hi1, s2)] {
                greatest = greatest.max(libm::asin(right.direction(s1, s2).y.clamp(-1.0, 1.0)));
            }
        }
        (greatest + REACH_MARGIN_RAD).min(PI / 2.0)
    }
}

/// What is known of each joint DoF before anything is seen: the standard deviation of an even
/// spread over its clinical range, radians.
pub(crate) fn spread_rad() -> [f64; N_JOINT_DOF] {
    std::array::from_fn(|dof| {
        let (_, lo_deg, hi_deg, _) = row(dof);
        (hi_deg - lo_deg).to_radians() / 12.0_f64.sqrt()
    })
}

// The table's rows follow the order of the DoF.
const _: () =
    assert!(LUMBAR == 0 && NECK == 3 && TRUNK_AND_NECK.len() + 2 * SIDE.len() == N_JOINT_DOF);
