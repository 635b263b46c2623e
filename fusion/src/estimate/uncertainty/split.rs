//! Variance of a keypoint that views show at different places.
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

use super::disagreement::IN_SIGHT;
use super::views::{information_of_view, variance_m2};
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::estimate::evidence::View;

/// Least height of a peak that counts for or against a place, 0 to 1: lower ones are in every map.
const LEAST_HEIGHT: f64 = 0.3;
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
mod tests {
    use crate::estimate::meeting_fixture::{LEFT_WRIST, MeetingFixture, RIGHT_WRIST};

    /// The deviations of both wrists, metres, if so many of four views show the left one 0.45 m
    /// higher, with this height of the peak; all others are 0.9 high.
    fn split_m(n_against: usize, height: f64) -> [f64; 2] {
        let mut meeting = MeetingFixture::at(&[[0.3, -0.2, 0.0]]);
        meeting.begin();
        for camera in 0..meeting.hall.cameras.len() {
            let mut drawn = meeting.as_they_are(0);
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
