//! The change of a camera with which it would agree: resection, from the places of keypoints by the other cameras and
//! the pixels of this one.
//!
//! ```text
//!   p' = exp(ω) p + t                       p: a keypoint in the camera as it is calibrated, metres
//!   y' = s y (1 - k |y|²),  y = p'.xy / p'.z     where the changed camera shows it, normalised
//!   r  = p.z (y' - u)                       u: where the camera shows it; metres at the depth of people
//! ```
//!
//! Gauss-Newton on some of ω, t, log s and k, with weights after Geman and `McClure` so that single keypoints do not
//! count. A prior keeps all four small: if people stay at one place, a turn and a move of a camera look the same.

use std::ops::Range;

use farfield_proto::order_statistics::upper_median;
use nalgebra::{Rotation3, SMatrix, SVector, Vector2, Vector3};

use super::super::geometry::SightLines;

/// ω (right, down, ahead), t (the same), log s, k.
const N_PARAMETERS: usize = 8;
/// Standard deviations of the prior: radians, metres, as a share, k1.
const PRIOR_SIGMA: [f64; N_PARAMETERS] = [0.2, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3, 0.5];
/// All keypoints count as much as so many independent ones.
const INDEPENDENT_KEYPOINTS: f64 = 100.0;
/// Rounds of weighting.
const ROUNDS: usize = 10;
/// Smallest scale of the weights, metres.
const MIN_SCALE_M: f64 = 0.004;
/// Smallest depth of a keypoint, metres.
pub(in crate::camera_agreement) const MIN_DEPTH_M: f64 = 0.05;

/// A keypoint in a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Observed {
    /// Its place by the other cameras, in the calibrated frame of this one (right, down, ahead), metres.
    pub(in crate::camera_agreement) place_m: Vector3<f64>,
    /// Its place in the picture of this one, normalised, undistorted.
    pub(in crate::camera_agreement) shown: Vector2<f64>,
    /// Its index in the network.
    pub(in crate::camera_agreement) keypoint: usize,
}

/// What may differ from the calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::camera_agreement) enum Change {
    FocalLength,
    Distortion,
    Turned,
    /// Moved and turned.
    Moved,
}

impl Change {
    pub(in crate::camera_agreement) const ALL: [Self; 4] = [
        Self::FocalLength,
        Self::Distortion,
        Self::Turned,
        Self::Moved,
    ];

    /// Those that people who stay at one place reveal, too: a lens and a way of some decimetres look alike there.
    pub(in crate::camera_agreement) const IN_PLACE: [Self; 2] = [Self::FocalLength, Self::Turned];

    /// Its parameters.
    pub(in crate::camera_agreement) fn parameters(self) -> Range<usize> {
        match self {
            Self::FocalLength => 6..7,
            Self::Distortion => 7..8,
            Self::Turned => 0..3,
            Self::Moved => 0..6,
        }
    }
}

/// A camera relative to its calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Changed(SVector<f64, N_PARAMETERS>);

impl Changed {
    /// The calibrated camera.
    pub(in crate::camera_agreement) fn none() -> Self {
        Self(SVector::zeros())
    }

    /// The camera that fits `all` best with this change alone; `None` if they do not determine it.
    pub(in crate::camera_agreement) fn fitted(all: &[Observed], change: Change) -> Option<Self> {
        let mut changed = Self::none();
        for _ in 0..ROUNDS {
            let scale_m = changed.median_m(all)?.max(MIN_SCALE_M);
            changed.0 += changed.step(all, change, scale_m)?;
        }
        changed.0.iter().all(|n| n.is_finite()).then_some(changed)
    }

    fn step(
        &self,
        all: &[Observed],
        change: Change,
        scale_m: f64,
    ) -> Option<SVector<f64, N_PARAMETERS>> {
        let mut matrix = SMatrix::<f64, N_PARAMETERS, N_PARAMETERS>::zeros();
        let mut vector = SVector::<f64, N_PARAMETERS>::zeros();
        for one in all {
            let Some((y, jacobian)) = self.linear(&one.place_m) else {
                continue;
            };
            let per_scale = one.place_m.z / scale_m;
            let off = (one.shown - y) * per_scale;
            let off2 = off.norm_squared();
            let weight = per_scale / ((1.0 + off2) * (1.0 + off2));
            matrix += jacobian.tr_mul(&jacobian) * (weight * per_scale);
            vector += jacobian.tr_mul(&off) * weight;
        }
        let prior = all.len() as f64 / INDEPENDENT_KEYPOINTS;
        let free = change.parameters();
        for (own, sigma) in PRIOR_SIGMA.iter().enumerate() {
            if free.contains(&own) {
                let information = prior / (sigma * sigma);
                matrix[(own, own)] += information;
                vector[own] -= information * self.0[own];
            } else {
                matrix.row_mut(own).fill(0.0);
                matrix.column_mut(own).fill(0.0);
                matrix[(own, own)] = 1.0;
                vector[own] = 0.0;
            }
        }
        Some(matrix.cholesky()?.solve(&vector))
    }

    /// Where it shows a place, and the derivatives by the parameters.
    fn linear(
        &self,
        place_m: &Vector3<f64>,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, N_PARAMETERS>)> {
        let parameters = &self.0;
        let turn = Rotation3::from_scaled_axis(parameters.fixed_rows::<3>(0).into_owned());
        let m = turn * place_m + parameters.fixed_rows::<3>(3);
        if m.z < MIN_DEPTH_M {
            return None;
        }
        let (y, scale) = (m.xy() / m.z, libm::exp(parameters[6]));
        let bend = scale * (1.0 - parameters[7] * y.norm_squared());
        let mut jacobian = SMatrix::<f64, 2, N_PARAMETERS>::zeros();
        // The derivative of the bend itself is neglected.
        let moved = SMatrix::<f64, 2, 3>::new(1.0, 0.0, -y.x, 0.0, 1.0, -y.y) * (bend / m.z);
        jacobian
            .fixed_columns_mut::<3>(0)
            .copy_from(&(-moved * m.cross_matrix()));
        jacobian.fixed_columns_mut::<3>(3).copy_from(&moved);
        jacobian.set_column(6, &(bend * y));
        jacobian.set_column(7, &(-scale * y.norm_squared() * y));
        Some((bend * y, jacobian))
    }

    /// Median distance between where it shows keypoints and where they are, metres; infinite if most are behind it.
    pub(in crate::camera_agreement) fn median_m(&self, all: &[Observed]) -> Option<f64> {
        let off_m = |one: &Observed| {
            self.linear(&one.place_m).map_or(f64::INFINITY, |(y, _)| {
                (y - one.shown).norm() * one.place_m.z
            })
        };
        upper_median(all.iter().map(off_m).collect())
    }

    /// Mean cost of these distances, 0 to 1; `half_m` costs one half. Unlike the median, it distinguishes small errors
    /// of all from large errors of some.
    pub(in crate::camera_agreement) fn mean_cost(&self, all: &[Observed], half_m: f64) -> f64 {
        let cost = |one: &Observed| {
            let at = self.linear(&one.place_m);
            at.map_or(1.0, |(y, _)| {
                let off = (y - one.shown).norm() * one.place_m.z / half_m;
                off * off / (1.0 + off * off)
            })
        };
        all.iter().map(cost).sum::<f64>() / all.len().max(1) as f64
    }

    /// Median distance between where it and the calibrated camera show keypoints, metres at their depth.
    pub(in crate::camera_agreement) fn shift_m(&self, all: &[Observed]) -> Option<f64> {
        let shift_m = |one: &Observed| {
            let (y, _) = self.linear(&one.place_m)?;
            let calibrated = one.place_m.xy() / one.place_m.z;
            Some((y - calibrated).norm() * one.place_m.z)
        };
        upper_median(all.iter().filter_map(shift_m).collect())
    }

    /// Its lines of sight without a distortion, from the calibrated ones.
    pub(in crate::camera_agreement) fn lines(&self, calibrated: &SightLines) -> SightLines {
        let turn = Rotation3::from_scaled_axis(self.0.fixed_rows::<3>(0).into_owned());
        let shift_m = self.0.fixed_rows::<3>(3).into_owned();
        calibrated.displaced(turn.matrix(), &shift_m, self.focal_factor())
    }

    /// Where a camera with the calibrated distortion shows what this one shows at `y`, both normalised.
    pub(in crate::camera_agreement) fn straightened(&self, y: Vector2<f64>) -> Vector2<f64> {
        y * (1.0 + self.k1_over() * y.norm_squared())
    }

    /// Turn, radians.
    pub(in crate::camera_agreement) fn turned_rad(&self) -> f64 {
        self.0.fixed_rows::<3>(0).norm()
    }

    /// Distance from the calibrated position, metres.
    pub(in crate::camera_agreement) fn moved_m(&self) -> f64 {
        self.0.fixed_rows::<3>(3).norm()
    }

    /// Focal length as a factor of the calibrated one.
    pub(in crate::camera_agreement) fn focal_factor(&self) -> f64 {
        libm::exp(self.0[6])
    }

    /// Calibrated k1 less the true one.
    pub(in crate::camera_agreement) fn k1_over(&self) -> f64 {
        self.0[7]
    }
}
