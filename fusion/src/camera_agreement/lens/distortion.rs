//! Whether lines of sight would meet better with another lens distortion: of one camera, or of all.
//!
//! ```text
//!   y' = y (1 + k |y|²)        y: normalised, undistorted by the calibration; k: written k1 less the true one, nearly
//! ```
//!
//! People in the middle of a picture hardly show a distortion, and what they show is less than networks err; but networks
//! err to all sides. So the places of all keypoints are found again for each k, from all cameras together, and the k with
//! the least mean cost is taken: on real cameras that are right it leaves 0.996 of the cost, or more.

use super::{LensPoints, least};

/// The k that are tried first.
const TRIED: [f64; 6] = [-0.8, -0.4, -0.2, 0.2, 0.4, 0.8];
/// Least k that is told of, and what it leaves of the cost: of a larger one there may be more left. Of cameras that are right
/// 0.995 and more was left by any k of 0.05 or larger.
const TOLD: [(f64, f64); 2] = [(0.1, 0.985), (0.2, 0.99)];
/// How many times as much as the next camera's it must explain: a wrong lens bends what others seem to show, too.
const STANDS_OUT: f64 = 1.5;

/// Another distortion.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::camera_agreement) struct DistortionFit {
    /// The cameras that have it: one, or all that tell and have one (fisheyes have another).
    pub(in crate::camera_agreement) cameras: Vec<usize>,
    /// By how much k1 of the calibration is larger than it should be.
    pub(in crate::camera_agreement) k1_over: f64,
    /// What it leaves of the cost.
    pub(in crate::camera_agreement) ratio: f64,
}

/// The distortion with which lines of sight meet best, where that is sure.
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
        let (k1_over, least) = least(&TRIED, cost, before);
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
    // Of one camera alone among fisheyes nobody can say that it is not the others.
    let stands_out = fits
        .get(1)
        .is_some_and(|next| gain(best) > STANDS_OUT * gain(next));
    let is_told = |(k, ratio): (f64, f64)| best.k1_over.abs() >= k && best.ratio < ratio;
    (stands_out && TOLD.into_iter().any(is_told)).then(|| best.clone())
}
