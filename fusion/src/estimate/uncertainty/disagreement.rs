//! Disagreement of views: the distance of map peaks from the pose, relative to network errors.
//!
//! ```text
//!   q(j) = median over keypoints of |peak - pose| / sigma,  of view j
//!   f²   = mean over views of max(1, q / 2)²
//! ```
//!
//! Keypoint errors alone give a q of 0.7 to 1.8. A swapped, mirrored or moved camera shows all
//! keypoints elsewhere (7 to 10): its pose is a compromise, and less certain than its views
//! suggest.

use crate::body::skeleton::{Kinematics, Site};
use crate::estimate::evidence::View;
use nalgebra::Vector3;

use super::views::variance_m2;

/// q up to which views fit.
const FITS: f64 = 2.0;
/// Occlusion weight from which a keypoint counts: the peak of a hidden one may belong to another
/// person.
pub(super) const IN_SIGHT: f64 = 0.99;
/// Least height of a peak that counts.
const LEAST_HEIGHT: f64 = 0.3;
/// Least keypoints of a view that count.
const MIN_KEYPOINTS: usize = 6;
/// Most keypoints that are used.
const MAX_KEYPOINTS: usize = 32;

/// A person at a tick, for comparison with its views.
pub(crate) struct SeenPose<'a> {
    pub(crate) views: &'a [View],
    pub(crate) sites: &'a [Option<Site>],
    /// Expected keypoints at the tick, world, metres.
    pub(crate) predicted_m: &'a [Vector3<f64>],
    pub(crate) body: &'a Kinematics,
    pub(crate) relative_sigmas: &'a [f64],
}

impl SeenPose<'_> {
    /// f²: the factor on the variance of the pose, at least 1; `None` if no view counts.
    pub(crate) fn variance_factor(&self) -> Option<f64> {
        let (mut sum, mut n) = (0.0, 0);
        for view in self.views {
            if let Some(q) = self.misfit(view) {
                let over = (q / FITS).max(1.0);
                sum += over * over;
                n += 1;
            }
        }
        (n > 0).then(|| sum / f64::from(n))
    }

    /// q of a view.
    fn misfit(&self, view: &View) -> Option<f64> {
        let (mut all, mut n) = ([0.0; MAX_KEYPOINTS], 0);
        for (k, site) in self.sites.iter().enumerate().take(MAX_KEYPOINTS) {
            let (Some(site), Some(expected)) = (site, view.expected(k)) else {
                continue;
            };
            let Some(peak) = view.peaks(k).as_slice().first() else {
                continue;
            };
            if view.occlusion[k] < IN_SIGHT || peak.height < LEAST_HEIGHT {
                continue;
            }
            // The pose of the tick, at the instant of the view.
            let place_m = self.body.site_m(site) + expected.position_m - self.predicted_m[k];
            let h = view.cell_from_world(k) * place_m.push(1.0);
            let off_cells = (h.xy() / h.z - peak.cell).norm();
            let pixel_m = expected.cell_m / view.grid(k).pixels_per_cell();
            let variance_m2 = variance_m2(self.relative_sigmas[k], peak.height, pixel_m);
            let off = off_cells * expected.cell_m / variance_m2.sqrt();
            if h.z > 0.0 && off.is_finite() {
                all[n] = off;
                n += 1;
            }
        }
        let all = &mut all[..n];
        all.sort_unstable_by(f64::total_cmp);
        (n >= MIN_KEYPOINTS).then(|| all[n / 2])
    }
}
