//! Limits for rays of one body: how near they must pass each other, and where.

use nalgebra::Vector3;

use crate::sightings::rays::SightedRay;

/// Limits for witnesses of one body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gates {
    /// Largest distance between two rays of one keypoint, metres.
    pub(crate) ray_distance_m: f64,
    /// Least keypoints that two witnesses must agree on.
    pub(crate) min_keypoints: usize,
    /// Lower corner of the field, world metres.
    pub(crate) field_min_m: Vector3<f64>,
    /// Upper corner of the field, world metres.
    pub(crate) field_max_m: Vector3<f64>,
}

impl Gates {
    /// The same without a field.
    pub(crate) fn anywhere(&self) -> Self {
        Self {
            field_min_m: Vector3::repeat(f64::NEG_INFINITY),
            field_max_m: Vector3::repeat(f64::INFINITY),
            ..*self
        }
    }

    /// Whether `point_m` is in the field grown by `slack_m`.
    pub(crate) fn inside(&self, point_m: &Vector3<f64>, slack_m: f64) -> bool {
        (0..3).all(|i| {
            point_m[i] >= self.field_min_m[i] - slack_m
                && point_m[i] <= self.field_max_m[i] + slack_m
        })
    }

    /// Whether `ray` passes through the field grown by `slack_m`.
    pub(crate) fn are_crossed_by(&self, ray: &SightedRay, slack_m: f64) -> bool {
        let (mut from, mut to) = (0.0_f64, f64::INFINITY);
        for i in 0..3 {
            let low = self.field_min_m[i] - slack_m - ray.origin_m[i];
            let high = self.field_max_m[i] + slack_m - ray.origin_m[i];
            let along = ray.direction[i];
            if along.abs() < f64::MIN_POSITIVE {
                // The ray is between these two planes everywhere or nowhere.
                if low > 0.0 || high < 0.0 {
                    return false;
                }
                continue;
            }
            let (first, second) = (low / along, high / along);
            from = from.max(first.min(second));
            to = to.min(first.max(second));
        }
        from <= to
    }

    /// Largest distance of a ray from its point: half of that between two rays.
    pub(crate) fn point_distance_m(&self) -> f64 {
        0.5 * self.ray_distance_m
    }
}
