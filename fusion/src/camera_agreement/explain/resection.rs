//! What a camera would have to be to agree: resection, from where the others say that keypoints are, and where this one shows
//! them.
//!
//! ```text
//!   p' = exp(ω) p + t                       p: a keypoint in the camera as it is calibrated, metres
//!   y' = s y (1 - k |y|²),  y = p'.xy / p'.z     where the camera shows it then, normalised
//!   r  = p.z (y' - u)                       u: where it shows it; metres where people are
//! ```
//!
//! Gauss-Newton on some of ω, t, log s and k, weights after Geman and `McClure`, so that single keypoints do not count. All four
//! are held to be small as far as nothing tells: of people who stay at one place nobody knows whether a camera was turned or
//! moved.

use std::ops::Range;

use farfield_proto::order_statistics::upper_median;
use nalgebra::{Rotation3, SMatrix, SVector, Vector2, Vector3};

use super::super::geometry::SightLines;

/// ω (right, down, ahead), t (the same), log s, k.
const N_NUMBERS: usize = 8;
/// How large each is held to be: radians, metres, as a share, k1.
const USUAL: [f64; N_NUMBERS] = [0.2, 0.2, 0.2, 0.3, 0.3, 0.3, 0.3, 0.5];
/// All keypoints tell as much as so many do of which each errs for itself.
const INDEPENDENT: f64 = 100.0;
/// Rounds of weighting.
const ROUNDS: usize = 10;
/// Least median distance by which distances are weighed, metres.
const LEAST_SCALE_M: f64 = 0.004;
/// Least depth of a keypoint, metres.
pub(in crate::camera_agreement) const LEAST_DEPTH_M: f64 = 0.05;

/// A keypoint that a camera shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Observed {
    /// Where it is by the other cameras, in this one as it is calibrated (right, down, ahead), metres.
    pub(in crate::camera_agreement) place_m: Vector3<f64>,
    /// Where this one shows it, normalised, undistorted.
    pub(in crate::camera_agreement) shown: Vector2<f64>,
    /// Which keypoint of the network it is.
    pub(in crate::camera_agreement) keypoint: usize,
}

/// What may be another than was calibrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::camera_agreement) enum Change {
    FocalLength,
    Distortion,
    Turned,
    /// Turned, too.
    Moved,
}

impl Change {
    pub(in crate::camera_agreement) const ALL: [Self; 4] = [
        Self::FocalLength,
        Self::Distortion,
        Self::Turned,
        Self::Moved,
    ];

    /// Which of the numbers it is made of.
    pub(in crate::camera_agreement) fn numbers(self) -> Range<usize> {
        match self {
            Self::FocalLength => 6..7,
            Self::Distortion => 7..8,
            Self::Turned => 0..3,
            Self::Moved => 0..6,
        }
    }
}

/// A camera beside the one that was calibrated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Changed(SVector<f64, N_NUMBERS>);

impl Changed {
    /// The calibrated camera.
    pub(in crate::camera_agreement) fn none() -> Self {
        Self(SVector::zeros())
    }

    /// The one that shows `all` best with this change alone; `None` where they do not tell.
    pub(in crate::camera_agreement) fn fitted(all: &[Observed], change: Change) -> Option<Self> {
        let mut changed = Self::none();
        for _ in 0..ROUNDS {
            let scale_m = changed.median_m(all)?.max(LEAST_SCALE_M);
            changed.0 += changed.step(all, (change, scale_m))?;
        }
        changed.0.iter().all(|n| n.is_finite()).then_some(changed)
    }

    fn step(
        &self,
        all: &[Observed],
        (change, scale_m): (Change, f64),
    ) -> Option<SVector<f64, N_NUMBERS>> {
        let mut matrix = SMatrix::<f64, N_NUMBERS, N_NUMBERS>::zeros();
        let mut vector = SVector::<f64, N_NUMBERS>::zeros();
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
        let prior = all.len() as f64 / INDEPENDENT;
        let free = change.numbers();
        for (own, usual) in USUAL.iter().enumerate() {
            if free.contains(&own) {
                let information = prior / (usual * usual);
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

    /// Where it shows a place, and by how much farther for each of the numbers.
    fn linear(&self, place_m: &Vector3<f64>) -> Option<(Vector2<f64>, SMatrix<f64, 2, N_NUMBERS>)> {
        let numbers = &self.0;
        let turn = Rotation3::from_scaled_axis(numbers.fixed_rows::<3>(0).into_owned());
        let m = turn * place_m + numbers.fixed_rows::<3>(3);
        if m.z < LEAST_DEPTH_M {
            return None;
        }
        let (y, scale) = (m.xy() / m.z, libm::exp(numbers[6]));
        let bend = scale * (1.0 - numbers[7] * y.norm_squared());
        let mut jacobian = SMatrix::<f64, 2, N_NUMBERS>::zeros();
        // What the bend changes along the way is a share of what it does itself.
        let moved = SMatrix::<f64, 2, 3>::new(1.0, 0.0, -y.x, 0.0, 1.0, -y.y) * (bend / m.z);
        jacobian
            .fixed_columns_mut::<3>(0)
            .copy_from(&(-moved * m.cross_matrix()));
        jacobian.fixed_columns_mut::<3>(3).copy_from(&moved);
        jacobian.set_column(6, &(bend * y));
        jacobian.set_column(7, &(-scale * y.norm_squared() * y));
        Some((bend * y, jacobian))
    }

    /// How far from where they are it shows them in the median, metres; infinite where most are behind it.
    pub(in crate::camera_agreement) fn median_m(&self, all: &[Observed]) -> Option<f64> {
        let off_m = |one: &Observed| {
            self.linear(&one.place_m).map_or(f64::INFINITY, |(y, _)| {
                (y - one.shown).norm() * one.place_m.z
            })
        };
        upper_median(all.iter().map(off_m).collect())
    }

    /// What it costs, 0 to 1, that it shows them beside where they are; at `half_m` from there it is a half. Unlike the median it
    /// tells a little that all are off from a lot that some are.
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

    /// How far beside where the calibrated camera does it shows them in the median, metres where they are.
    pub(in crate::camera_agreement) fn aside_m(&self, all: &[Observed]) -> Option<f64> {
        let aside_m = |one: &Observed| {
            let (y, _) = self.linear(&one.place_m)?;
            let calibrated = one.place_m.xy() / one.place_m.z;
            Some((y - calibrated).norm() * one.place_m.z)
        };
        upper_median(all.iter().filter_map(aside_m).collect())
    }

    /// Its lines of sight, but for a distortion, beside those that are calibrated.
    pub(in crate::camera_agreement) fn lines(&self, calibrated: &SightLines) -> SightLines {
        let turn = Rotation3::from_scaled_axis(self.0.fixed_rows::<3>(0).into_owned());
        let shift_m = self.0.fixed_rows::<3>(3).into_owned();
        calibrated.displaced((turn.matrix(), &shift_m), self.focal_factor())
    }

    /// Where a camera without another distortion shows what this one shows at `y`, both normalised.
    pub(in crate::camera_agreement) fn straightened(&self, y: Vector2<f64>) -> Vector2<f64> {
        y * (1.0 + self.k1_over() * y.norm_squared())
    }

    /// By what it is turned, radians.
    pub(in crate::camera_agreement) fn turned_rad(&self) -> f64 {
        self.0.fixed_rows::<3>(0).norm()
    }

    /// How far it has moved, metres.
    pub(in crate::camera_agreement) fn moved_m(&self) -> f64 {
        self.0.fixed_rows::<3>(3).norm()
    }

    /// Focal length as a factor of the calibrated one.
    pub(in crate::camera_agreement) fn focal_factor(&self) -> f64 {
        libm::exp(self.0[6])
    }

    /// By how much k1 of the calibration is larger than it should be.
    pub(in crate::camera_agreement) fn k1_over(&self) -> f64 {
        self.0[7]
    }
}
