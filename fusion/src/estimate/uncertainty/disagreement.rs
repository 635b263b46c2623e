//! Disagreement of the views of a tick.
//!
//! # Distance of map peaks from the pose, relative to network errors
//!
//! ```text
//!   q(j) = median over keypoints of |peak - pose| / sigma,  of view j
//!   f²   = mean over views of max(1, q / 2)²
//! ```
//!
//! Keypoint errors alone give a q of 0.7 to 1.8. A swapped, mirrored or moved camera shows all
//! keypoints elsewhere (7 to 10): its pose is a compromise, and less certain than its views
//! suggest.
//!
//! # Variance of a keypoint that views show at different places
//!
//! ```text
//!   a  = sum of h² of the views against / sum of h² of all that show it
//!   v  = w(a) mean of r²/2 over the views against,    w = 0 up to 0.3, 1 from 0.5 on
//! ```
//!
//! The search selects one place, and views whose peaks lie elsewhere do not count there. One wrong
//! view of four changes nothing. If as much evidence supports another place (two views of four, one
//! of two), the uncertainty is the distance of the two. h is the height of a peak: an unsure
//! network draws a lower one, and is wrong more often. r is the distance of the peak from the place
//! in that view, metres.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::observation::{information_of_view, variance_m2};
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::{Kinematics, Site};
use crate::estimate::evidence::View;

/// q up to which views fit.
const FITS: f64 = 2.0;
/// Occlusion weight from which a keypoint counts: the peak of a hidden one may belong to another
/// person.
pub(super) const IN_SIGHT: f64 = 0.99;
/// Least height of a peak that counts, 0 to 1: lower ones are in every map.
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

/// A peak farther away than this, in standard deviations of a view, is at another place.
const APART_SIGMAS: f64 = 5.0;
/// Share of the views against below which the place is sure, and from which it is as likely as
/// another.
const UNQUESTIONED: f64 = 0.3;
const EVEN: f64 = 0.5;

/// Sets [`KeypointEstimate::information`]. `predicted_m` are the expected keypoints at the tick,
/// `relative_sigmas` one factor per keypoint.
pub fn weigh_views(
    views: &[View],
    predicted_m: &[Vector3<f64>],
    relative_sigmas: &[f64],
    estimates: &mut [KeypointEstimate],
) {
    let known = predicted_m.iter().zip(relative_sigmas);
    for (k, (estimate, (expected_m, relative))) in estimates.iter_mut().zip(known).enumerate() {
        (estimate.information, estimate.split_m2) = (Matrix3::zeros(), 0.0);
        if estimate.weight <= 0.0 {
            continue;
        }
        let offset_m = estimate.position_m - expected_m;
        for view in views {
            estimate.information += information_of_view(view, k, offset_m, *relative);
        }
        estimate.split_m2 = split_m2(views, k, offset_m, *relative);
    }
}

/// v of keypoint `k`, m² per axis, which the search found `offset_m` from the prediction.
fn split_m2(views: &[View], k: usize, offset_m: Vector3<f64>, relative_sigma: f64) -> f64 {
    let (mut for_it, mut against, mut off_m2) = (0.0, 0.0, 0.0);
    for view in views {
        let Some(expected) = view.expected(k) else {
            continue;
        };
        let h = view.cell_from_world(k) * (expected.position_m + offset_m).push(1.0);
        let cell = Vector2::new(h.x, h.y) / h.z;
        if h.z <= 0.0 || view.occlusion[k] < IN_SIGHT {
            continue;
        }
        let height = view.map(k).bilinear(cell);
        if height >= LEAST_HEIGHT {
            for_it += height * height;
            continue;
        }
        let Some(peak) = view.map(k).highest_peak() else {
            continue;
        };
        let r_m = (peak.cell - cell).norm() * expected.cell_m;
        let pixel_m = expected.cell_m / view.grid(k).pixels_per_cell();
        let sigma_m = variance_m2(relative_sigma, peak.height, pixel_m).sqrt();
        if peak.height >= LEAST_HEIGHT && r_m > APART_SIGMAS * sigma_m {
            let weight = peak.height * peak.height;
            against += weight;
            off_m2 += weight * 0.5 * r_m * r_m;
        }
    }
    if against <= 0.0 {
        return 0.0;
    }
    let share = against / (for_it + against);
    let in_question = ((share - UNQUESTIONED) / (EVEN - UNQUESTIONED)).clamp(0.0, 1.0);
    in_question * off_m2 / against
}

#[cfg(test)]
mod split_tests {
    use crate::estimate::meeting_fixture::{LEFT_WRIST, MeetingFixture, RIGHT_WRIST};

    /// The deviations of both wrists, metres, if so many of four views show the left one 0.45 m
    /// higher, with this height of the peak; all others are 0.9 high.
    fn split_m(n_against: usize, height: f64) -> [f64; 2] {
        let mut meeting = MeetingFixture::at(&[[0.3, -0.2, 0.0]]);
        meeting.begin();
        for camera in 0..meeting.hall.cameras.len() {
            let mut drawn = meeting.true_peaks(0);
            if camera < n_against {
                drawn[LEFT_WRIST].1.z += 0.45;
                drawn[LEFT_WRIST].2 = height;
            }
            meeting.show(0, camera, &drawn);
        }
        meeting.place();
        meeting.tracks[0].search(&meeting.method);
        let estimates = meeting.tracks[0].estimates();
        [LEFT_WRIST, RIGHT_WRIST].map(|k| {
            let covariance_m2 = estimates[k].information.try_inverse().unwrap();
            (covariance_m2.trace() / 3.0 + estimates[k].split_m2).sqrt()
        })
    }

    #[test]
    fn two_views_against_two_leave_the_place_unsure() {
        let [split_m, seen_m] = split_m(2, 0.9);
        assert!(split_m > 0.2 && seen_m < 0.03, "{split_m} {seen_m}");
    }

    #[test]
    fn weaker_views_against_a_place_change_little() {
        for (n_against, height) in [(1, 0.9), (2, 0.5)] {
            let [split_m, seen_m] = split_m(n_against, height);
            assert!(split_m < 1.6 * seen_m, "{n_against}: {split_m} {seen_m}");
        }
    }
}
