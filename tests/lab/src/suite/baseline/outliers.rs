//! Triangulation from peaks of several views, some of them wrong: weighted DLT with Pose2Sim's removal of outlying views.
//!
//! Pose2Sim 0.9 to 0.10, `triangulation_from_best_cameras`: peaks below a likelihood are excluded. All subsets of the other
//! views are tried: first without removal, then with one view removed, and so on. Of each size the subset with the least mean
//! reprojection error counts. The search ends when that error is within the threshold, or before fewer than two views remain.
//! Above the threshold there is no point. Its swapping of left and right (off by default, also in its demonstration) is not
//! implemented.

use farfield_fusion::estimate::triangulate::{Observation, weighted_dlt};
use farfield_proto::frames::Point;
use nalgebra::Vector3;

/// Configuration of Pose2Sim.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// Least likelihood of a peak (`likelihood_threshold_triangulation`).
    pub likelihood: f64,
    /// Largest mean distance of the peaks from the point's projections, pixels
    /// (`reproj_error_threshold_triangulation`).
    pub reprojection_px: f64,
    /// Least views (`min_cameras_for_triangulation`).
    pub min_views: usize,
}

impl Default for Thresholds {
    /// Defaults of Pose2Sim.
    fn default() -> Self {
        Self {
            likelihood: 0.3,
            reprojection_px: 15.0,
            min_views: 2,
        }
    }
}

/// The triangulated point (world, metres); `None` if no allowed subset agrees. The weights are the likelihoods. Cost: at most
/// 2^n DLTs for n views.
pub fn triangulate(seen: &[Observation], thresholds: &Thresholds) -> Option<Vector3<f64>> {
    let likely: Vec<Observation> = seen
        .iter()
        .filter(|o| o.weight >= thresholds.likelihood)
        .copied()
        .collect();
    let n = likely.len();
    let least = thresholds.min_views.max(2);
    let mut subset = Vec::with_capacity(n);
    for size in (least..=n).rev() {
        let mut best: Option<(f64, Vector3<f64>)> = None;
        let subsets = (0u32..1 << n).filter(|mask| mask.count_ones() as usize == size);
        for mask in subsets {
            subset.clear();
            subset.extend((0..n).filter(|i| mask & (1 << i) != 0).map(|i| likely[i]));
            let Ok(point) = weighted_dlt(&subset) else {
                continue;
            };
            let error_px = reprojection_error_px(&point, &subset);
            if best.is_none_or(|(least_px, _)| error_px < least_px) {
                best = Some((error_px, point.coordinates_m().coords));
            }
        }
        if let Some((error_px, point)) = best
            && error_px <= thresholds.reprojection_px
        {
            return Some(point);
        }
    }
    None
}

fn reprojection_error_px(
    point: &Point<farfield_proto::frames::World>,
    seen: &[Observation],
) -> f64 {
    let homogeneous = point.coordinates_m().coords.push(1.0);
    let distance_px = |o: &Observation| {
        let image = o.pixel_from_world * homogeneous;
        (image.xy() / image.z - o.pixel.vector_px()).norm()
    };
    seen.iter().map(distance_px).sum::<f64>() / seen.len() as f64
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Pixel;
    use nalgebra::Point3;

    use super::*;
    use crate::ring::CameraRing;

    /// Rounding error of exact projections, metres.
    const EXACT_M: f64 = 1e-6;

    fn seen(point: Vector3<f64>) -> Vec<Observation> {
        let ring = CameraRing::new(4).unwrap();
        ring.cameras()
            .iter()
            .map(|camera| Observation {
                pixel_from_world: camera.projection_matrix(),
                pixel: camera.project(Point::new(Point3::from(point))).unwrap(),
                weight: 0.9,
            })
            .collect()
    }

    fn check(seen: &[Observation], expected: Option<Vector3<f64>>) {
        let found = triangulate(seen, &Thresholds::default());
        match (found, expected) {
            (Some(found), Some(expected)) => {
                assert!((found - expected).norm() < EXACT_M, "{found}");
            }
            (found, expected) => assert_eq!(found, expected),
        }
    }

    const POINT: Vector3<f64> = Vector3::new(0.2, -0.3, 1.1);

    #[test]
    fn exact_views_give_the_point() {
        check(&seen(POINT), Some(POINT));
    }

    #[test]
    fn a_view_that_is_far_off_is_removed() {
        let mut views = seen(POINT);
        views[1].pixel = Pixel::new(views[1].pixel.x() + 200.0, views[1].pixel.y());
        check(&views, Some(POINT));
    }

    #[test]
    fn unlikely_peaks_do_not_count_and_one_view_is_not_enough() {
        let mut views = seen(POINT);
        views[0].weight = 0.2;
        views[0].pixel = Pixel::new(0.0, 0.0);
        check(&views, Some(POINT));
        for view in &mut views[..3] {
            view.weight = 0.2;
        }
        check(&views, None);
    }

    #[test]
    fn views_of_which_no_two_agree_give_no_point() {
        let mut views = seen(POINT)[..2].to_vec();
        views[0].pixel = Pixel::new(views[0].pixel.x(), views[0].pixel.y() + 400.0);
        check(&views, None);
    }
}
