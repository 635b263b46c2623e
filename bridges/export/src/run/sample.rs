//! Pose of one person at one moment for the export skeleton, and interpolation.

use farfield_fusion::body::skeleton::angles::is_translation;
use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint, N_JOINTS};
use farfield_proto::message::PersonState;
use nalgebra::{UnitQuaternion, Vector3};

use super::line::PoseLine;
use crate::skeleton::{Angles, Motion, N_BONES, Offsets, RestPose, links_of};

/// A pose that can be interpolated.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Phase of the track.
    pub state: PersonState,
    /// Number of views that took part.
    pub views: u32,
    /// The export skeleton's pose.
    pub motion: Motion,
    /// The body's offsets at this moment, metres; a run learns them.
    pub offsets: Offsets,
    /// The reported angles.
    pub angles: Angles,
    /// Bit per reported angle: set if only a prior determines it.
    pub unobserved: u64,
    /// Positions of the keypoints in the world, metres, in the order of
    /// [`Survey::keypoints`](super::Survey).
    pub keypoints_m: Vec<Option<Vector3<f64>>>,
    /// Standard deviations of the joints per axis, metres.
    pub sigma_m: Option<[f64; N_JOINTS]>,
}

impl Sample {
    /// The pose of `line` for a skeleton with the rest pose `rest`.
    pub fn from_line(line: &PoseLine, rest: RestPose, keypoints: &[String]) -> Self {
        let mut body = links_of(&line.angles);
        let offsets = Offsets::measured(&line.joints_m, &body);
        // The joint and the translations among the angles are rounded separately; use the joint as
        // root.
        body.joints_m[Joint::Pelvis.index()] = line.joints_m[Joint::Pelvis.index()];
        let keypoint = |name: &String| {
            let found = line.keypoints_m.iter().find(|(known, _)| known == name);
            found.map(|(_, at_m)| *at_m)
        };
        Self {
            state: line.state,
            views: line.views,
            motion: Motion::of_links(&body, rest),
            offsets,
            angles: line.angles,
            unobserved: line.unobserved,
            keypoints_m: keypoints.iter().map(keypoint).collect(),
            sigma_m: line.sigma_m,
        }
    }

    /// The 29 joints in the world, metres.
    pub fn joints_m(&self, rest: RestPose) -> [Vector3<f64>; N_JOINTS] {
        self.motion.joints_m(rest, &self.offsets)
    }

    /// The weighted mean of samples around `centre`, which is one of them. Weights sum to 1 and may
    /// be negative.
    ///
    /// Rotations are averaged in the tangent space at the centre: `R = R_c exp(Σ wᵢ log(R_c⁻¹
    /// Rᵢ))`; for two samples this is spherical linear interpolation. Lengths and positions are
    /// averaged directly, angles along the shorter way from the centre. An angle is unobserved if
    /// samples with half of the weight have it unobserved. Deviations are averaged if all samples
    /// have one. Everything else is taken from the centre.
    pub fn mean(weighted: &[(f64, &Self)], centre: &Self, rest: RestPose) -> Self {
        let points = |value_of: &dyn Fn(&Self) -> Vector3<f64>| {
            weighted.iter().map(|(w, s)| value_of(s) * *w).sum()
        };
        let mut rotations = centre.motion.rotations;
        for (i, rotation) in rotations.iter_mut().enumerate().take(N_BONES) {
            let logs = weighted.iter().map(|(w, sample)| {
                let apart = rotation.inverse() * sample.motion.rotations[i];
                apart.scaled_axis() * *w
            });
            let mean: Vector3<f64> = logs.sum();
            *rotation *= UnitQuaternion::from_scaled_axis(mean);
            rotation.renormalize();
        }
        let motion = Motion {
            root_m: points(&|s| s.motion.root_m),
            rotations,
        };
        let mut angles = centre.angles;
        for (i, angle) in angles.iter_mut().enumerate() {
            let from = *angle;
            let apart = |sample: &Self| {
                let apart = sample.angles[i] - from;
                if is_translation(i) {
                    apart
                } else {
                    wrapped(apart)
                }
            };
            *angle += weighted.iter().map(|(w, s)| w * apart(s)).sum::<f64>();
        }
        let keypoints_m = (0..centre.keypoints_m.len()).map(|k| {
            let all = weighted
                .iter()
                .all(|(_, s)| s.keypoints_m.get(k).copied().flatten().is_some());
            all.then(|| points(&|s| s.keypoints_m[k].unwrap_or_default()))
        });
        let all_have_sigma = weighted.iter().all(|(_, s)| s.sigma_m.is_some());
        let sigma_m = all_have_sigma.then(|| {
            let value_of = |j: usize| {
                weighted
                    .iter()
                    .map(|(w, s)| w * s.sigma_m.map_or(f64::NAN, |all| all[j]))
                    .sum()
            };
            Joint::ALL.map(|joint| value_of(joint.index()))
        });
        Self {
            state: centre.state,
            views: centre.views,
            angles: motion.angles(rest, &angles),
            motion,
            offsets: Offsets(Joint::ALL.map(|joint| points(&|s| s.offsets.of_joint(joint)))),
            keypoints_m: keypoints_m.collect(),
            sigma_m: sigma_m.or(centre.sigma_m),
            unobserved: (0..ANGLE_NAMES.len())
                .filter(|&angle| {
                    let without = weighted.iter().filter(|(_, s)| s.is_unobserved(angle));
                    without.map(|(w, _)| w).sum::<f64>() >= 0.5
                })
                .fold(0, |bits, angle| bits | 1 << angle),
        }
    }

    /// Whether only a prior determines a reported angle.
    pub fn is_unobserved(&self, angle: usize) -> bool {
        self.unobserved >> angle & 1 == 1
    }

    /// The same pose as an unseen one: no views, no deviations.
    #[must_use]
    pub fn unseen(self) -> Self {
        Self {
            state: PersonState::Coasting,
            views: 0,
            sigma_m: None,
            ..self
        }
    }
}

/// The equivalent angle within ±π, radians.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    use std::f64::consts::TAU;
    angle_rad - TAU * (angle_rad / TAU).round()
}
