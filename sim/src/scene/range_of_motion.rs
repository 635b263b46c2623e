//! How often a scene leaves the clinical range of motion.
//!
//! People in a scene bend where the model has no joint, and farther than its range of motion
//! allows. To measure the excess, the model is fitted to the true joints without bounds. Then each
//! degree of freedom is compared with its bound.

use farfield_fusion::body::fit::fit;
use farfield_fusion::body::observed::ObservedJoints;
use farfield_fusion::body::skeleton::angles::FIRST_JOINT_ANGLE;
use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint, N_JOINT_DOF, RangeOfMotion};
use farfield_proto::tick::Tick;
use farfield_proto::venue::parameters::IkParameters;
use rayon::prelude::*;
use serde::Serialize;

use super::Scene;

/// Tolerance for errors of the fit, degrees; a smaller excess is not counted.
pub const TOLERANCE_DEG: f64 = 3.0;
/// Fitted samples per second: postures change little in between.
const SAMPLES_PER_S: f64 = 6.0;

/// How often, and how far, the people of a scene leave the clinical range of motion.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RangeOfMotionExcess {
    /// All people, in the order of the scene.
    pub people: Vec<PersonExcess>,
}

/// One person of a [`RangeOfMotionExcess`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PersonExcess {
    /// Number in the truth file.
    pub person: u32,
    /// Number of samples.
    pub samples: usize,
    /// Samples at which any degree of freedom exceeds its bound by more than [`TOLERANCE_DEG`].
    pub outside: usize,
    /// The same without ankles and feet, whose neutral posture depends on the skeleton.
    pub outside_but_feet: usize,
    /// Every degree of freedom with an excess, worst first.
    pub angles: Vec<AngleExcess>,
}

/// One degree of freedom of a [`PersonExcess`].
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AngleExcess {
    /// Name of the angle; for the three of a shoulder `arm_raise`, `arm_inward`, `arm_twist`.
    pub name: String,
    /// Samples with an excess.
    pub outside: usize,
    /// Largest excess, degrees.
    pub most_deg: f64,
}

impl RangeOfMotionExcess {
    /// Number of samples of all people, and of those with an excess.
    pub fn total(&self) -> (usize, usize) {
        let sum = |of: fn(&PersonExcess) -> usize| self.people.iter().map(of).sum();
        (sum(|p| p.samples), sum(|p| p.outside))
    }
}

/// Examines every person of `scene` six times per second. Takes milliseconds per sample.
pub fn range_of_motion_excess(scene: &Scene) -> RangeOfMotionExcess {
    let people = 0..scene.people().len();
    RangeOfMotionExcess {
        people: people
            .into_par_iter()
            .map(|i| of_person(scene, i))
            .collect(),
    }
}

fn of_person(scene: &Scene, person: usize) -> PersonExcess {
    #[expect(clippy::cast_possible_truncation, reason = "a few hundred at most")]
    let stride = ((scene.rate_hz() / SAMPLES_PER_S).round() as i64).max(1);
    let ticks = (0..scene.ticks().end.0 / stride).map(|i| Tick(i * stride));
    let moments: Vec<Tick> = ticks
        .filter(|&tick| scene.is_there(person, scene.time_s(tick)))
        .collect();
    let excess: Vec<[f64; N_JOINT_DOF]> = moments
        .par_iter()
        .filter_map(|&tick| excess_deg(scene, person, tick))
        .collect();
    let angle = |dof: usize| {
        let over = excess.iter().map(|e| e[dof]).filter(|e| *e > TOLERANCE_DEG);
        AngleExcess {
            name: dof_name(dof),
            outside: over.clone().count(),
            most_deg: over.fold(0.0, f64::max),
        }
    };
    let mut angles: Vec<_> = (0..N_JOINT_DOF)
        .map(angle)
        .filter(|a| a.outside > 0)
        .collect();
    angles.sort_by(|a, b| {
        b.outside
            .cmp(&a.outside)
            .then(b.most_deg.total_cmp(&a.most_deg))
    });
    let is_outside = |e: &&[f64; N_JOINT_DOF]| e.iter().any(|e| *e > TOLERANCE_DEG);
    let but_feet: Vec<usize> = (0..N_JOINT_DOF).filter(|&dof| !is_of_foot(dof)).collect();
    let is_outside_but_feet =
        |e: &&[f64; N_JOINT_DOF]| but_feet.iter().any(|&dof| e[dof] > TOLERANCE_DEG);
    PersonExcess {
        person: scene.people()[person].number,
        samples: excess.len(),
        outside: excess.iter().filter(is_outside).count(),
        outside_but_feet: excess.iter().filter(is_outside_but_feet).count(),
        angles,
    }
}

/// Excess of every degree of freedom at `tick`, degrees; 0 inside the bounds.
fn excess_deg(scene: &Scene, person: usize, tick: Tick) -> Option<[f64; N_JOINT_DOF]> {
    let truth = scene.person_at(person, scene.time_s(tick))?;
    let mut body = ObservedJoints::default();
    for joint in Joint::ALL {
        body.set(joint, truth.joint_m(joint), 1.0);
    }
    let fitted = fit(&[body], &IkParameters::default(), None).ok()?;
    let bounds = RangeOfMotion::default();
    Some(std::array::from_fn(|dof| {
        let q = fitted.pose.dof[dof];
        let beyond = (bounds.lo_rad(dof) - q).max(q - bounds.hi_rad(dof));
        beyond.max(0.0).to_degrees()
    }))
}

fn is_of_foot(dof: usize) -> bool {
    let name = ANGLE_NAMES[FIRST_JOINT_ANGLE + dof];
    ["ankle", "subtalar", "foot"]
        .iter()
        .any(|part| name.starts_with(part))
}

fn dof_name(dof: usize) -> String {
    let name = ANGLE_NAMES[FIRST_JOINT_ANGLE + dof];
    // A shoulder's degrees of freedom are swings and a twist, not the reported angles.
    [
        ("arm_flex", "arm_raise"),
        ("arm_add", "arm_inward"),
        ("arm_rot", "arm_twist"),
    ]
    .iter()
    .find_map(|(angle, swing)| Some(format!("{swing}{}", name.strip_prefix(angle)?)))
    .unwrap_or_else(|| name.to_owned())
}
