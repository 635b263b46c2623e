//! Whether lines of sight meet better with another lens distortion, of one camera or of all.
//!
//! ```text
//!   y' = y (1 + k |y|²)        y: normalised, undistorted by the calibration; k: calibrated k1 less the true one, approximately
//! ```
//!
//! People in the middle of a picture hardly show a distortion, less than the errors of networks. But networks err in
//! all directions. So for each k the places of all keypoints are found again from all cameras, and the k with the least
//! mean cost is taken. On valid real cameras it leaves 0.996 of the cost or more.

use super::{LensPoints, minimum};

/// The values of k from which the search starts.
const CANDIDATES: [f64; 6] = [-0.8, -0.4, -0.2, 0.2, 0.4, 0.8];
/// Smallest k that is reported, with the largest share of the cost that it may leave: a larger k may leave more. For
/// valid cameras any k of 0.05 or larger left 0.995 and more.
const REPORT_LIMITS: [(f64, f64); 2] = [(0.1, 0.985), (0.2, 0.99)];
/// How many times as much as the next choice it must explain: a wrong lens also bends the places that other cameras share.
const MIN_MARGIN: f64 = 1.5;

/// Another distortion.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::camera_agreement) struct DistortionFit {
    /// The cameras that have it: one, or all whose lenses can be judged (without fisheyes, which have another model).
    pub(in crate::camera_agreement) cameras: Vec<usize>,
    /// Calibrated k1 less the true one.
    pub(in crate::camera_agreement) k1_over: f64,
    /// Share of the cost that it leaves.
    pub(in crate::camera_agreement) ratio: f64,
}

/// The distortion with which lines of sight meet best, if it is sure.
pub(in crate::camera_agreement) fn distortion(points: &LensPoints) -> Option<DistortionFit> {
    let calibrated = points.lines_of_sight();
    let before = points.mean_cost(&calibrated, |_, _| None);
    let known = points.known();
    let alone = known.iter().map(|&camera| vec![camera]);
    let together = Some(known.to_vec()).filter(|known| known.len() > 1);
    let fits = together.into_iter().chain(alone).map(|cameras| {
        let cost = |k: f64| {
            points.mean_cost(&calibrated, |of, y| {
                let is_changed = cameras.contains(&of);
                is_changed.then(|| y * (1.0 + k * y.norm_squared()))
            })
        };
        let (k1_over, least) = minimum(&CANDIDATES, cost, before);
        DistortionFit {
            cameras,
            k1_over,
            ratio: least / before.max(f64::MIN_POSITIVE),
        }
    });
    let mut fits: Vec<DistortionFit> = fits.collect();
    fits.sort_by(|a, b| a.ratio.total_cmp(&b.ratio));
    let best = fits.first()?;
    let gain = |fit: &DistortionFit| 1.0 - fit.ratio;
    // With one camera among fisheyes, the others may be the cause.
    let is_clear = fits
        .get(1)
        .is_some_and(|next| gain(best) > MIN_MARGIN * gain(next));
    let is_within = |(k, ratio): (f64, f64)| best.k1_over.abs() >= k && best.ratio < ratio;
    (is_clear && REPORT_LIMITS.into_iter().any(is_within)).then(|| best.clone())
}
