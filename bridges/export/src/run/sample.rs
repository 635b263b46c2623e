//! One person at one moment in the terms of the export skeleton, and what lies between such moments.

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
    /// Views that took part.
    pub views: u32,
    /// The export skeleton's pose.
    pub motion: Motion,
    /// The body's offsets at this moment, metres: a run learns them.
    pub offsets: Offsets,
    /// The reported angles.
    pub angles: Angles,
    /// Bit per reported angle: set where only a prior tells it.
    pub unobserved: u64,
    /// The keypoints' sites in the world, metres, in the order of [`Survey::keypoints`](super::Survey).
    pub keypoints_m: Vec<Option<Vector3<f64>>>,
    /// Standard deviations of the joints per axis, metres.
    pub sigma_m: Option<[f64; N_JOINTS]>,
}

impl Sample {
    /// The pose of `line` for a skeleton that rests as `rest`.
    pub fn of(line: &PoseLine, rest: RestPose, keypoints: &[String]) -> Self {
        let mut body = links_of(&line.angles);
        let offsets = Offsets::measured(&line.joints_m, &body);
        // The joint and the angles' translations are rounded separately: one of them is the root.
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

    /// The weighted mean of samples around `centre`, one of them. Weights add up to 1 and may be negative.
    ///
    /// Rotations are averaged in the tangent space at the centre: `R = R_c exp(Σ wᵢ log(R_c⁻¹ Rᵢ))`, which for two is the
    /// spherical linear interpolation. Lengths and positions are averaged as they are, angles from the centre's by the
    /// shorter way round. An angle is unobserved where samples with half of the weight leave it so; deviations are averaged
    /// where all have one. What cannot be averaged is the centre's.
    pub fn mean(weighted: &[(f64, &Self)], centre: &Self, rest: RestPose) -> Self {
        let points =
            |of: &dyn Fn(&Self) -> Vector3<f64>| weighted.iter().map(|(w, s)| of(s) * *w).sum();
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
            let of = |j: usize| {
                weighted
                    .iter()
                    .map(|(w, s)| w * s.sigma_m.map_or(f64::NAN, |all| all[j]))
                    .sum()
            };
            Joint::ALL.map(|joint| of(joint.index()))
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

    /// Whether only a prior tells a reported angle.
    pub fn is_unobserved(&self, angle: usize) -> bool {
        self.unobserved >> angle & 1 == 1
    }

    /// The same pose as that of a moment at which nobody saw the person: no view, no deviation.
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

/// The same angle within ±π, radians.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    use std::f64::consts::TAU;
    angle_rad - TAU * (angle_rad / TAU).round()
}
