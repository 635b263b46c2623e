//! Whether the world is tilted against the floor and against the people who stand on it.
//!
//! ```text
//!   z = a x + b y + c      (x, y, z): feet of standing people, world, metres
//!   (-a, -b, 1)            up direction of the floor
//! ```
//!
//! A ramp or a stage of two heights tilts the feet, but not the people. Runners lean, but the floor
//! does not. A tilted world tilts both in the same direction by the same angle.

use farfield_proto::order_statistics::{percentile, upper_median};
use nalgebra::{Matrix3, Vector2, Vector3};

use crate::body::skeleton::{Joint, Joints};

/// Least number of places.
const MIN_PLACES: usize = 40;
/// Least reported slope: 2.5 degrees.
const MIN_SLOPE: f64 = 0.0437;
/// Least extent of nine tenths of the places along the slope, metres.
const MIN_EXTENT_M: f64 = 2.0;
/// Largest median distance of feet from the plane, as a share of its rise along the extent, and in
/// metres. Feet step; 0.018 was measured.
const MAX_OFF_PLANE_RATIO: f64 = 0.25;
const MAX_OFF_PLANE_M: f64 = 0.03;
/// Largest difference between the up directions of people and floor, as a share of the slope.
const MAX_LEAN_DIFFERENCE: f64 = 0.5;
/// Distance from the plane at which a place has a weight of one quarter, metres: a lifted foot.
const WEIGHT_M: f64 = 0.06;
/// Weight of the prior for a level plane. Without it, places along one line leave the slope across
/// the line undetermined.
const LEVEL_WEIGHT: f64 = 1.0;
/// Rounds of reweighting.
const ROUNDS: usize = 6;

/// The place and the lean of a standing person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stance {
    /// The lowest point of the feet, world, metres.
    pub(super) foot_m: Vector3<f64>,
    /// Horizontal offset (x, y) of the shoulders from the ankles, over the distance between them.
    pub(super) lean: Vector2<f64>,
}

impl Stance {
    pub(super) fn new(joints_m: &Joints, foot_m: Vector3<f64>) -> Self {
        let middle = |[a, b]: [Joint; 2]| 0.5 * (joints_m[a.index()] + joints_m[b.index()]);
        let ankles_m = middle([Joint::LeftAnkle, Joint::RightAnkle]);
        let up_m = middle([Joint::LeftShoulder, Joint::RightShoulder]) - ankles_m;
        Self {
            foot_m,
            lean: up_m.xy() / up_m.norm().max(f64::MIN_POSITIVE),
        }
    }
}

/// The tilt of the world, radians; `None` if it is not tilted, or if too little is known.
pub(super) fn tilt_rad(stances: &[Stance]) -> Option<f64> {
    if stances.len() < MIN_PLACES {
        return None;
    }
    let places: Vec<Vector3<f64>> = stances.iter().map(|stance| stance.foot_m).collect();
    let plane = plane(&places)?;
    let slope = plane.xy();
    let steep = slope.norm();
    if steep < MIN_SLOPE {
        return None;
    }
    let mut along_m: Vec<f64> = places.iter().map(|m| m.xy().dot(&slope) / steep).collect();
    along_m.sort_by(f64::total_cmp);
    let extent_m = percentile(&along_m, 0.95)? - percentile(&along_m, 0.05)?;
    let off_m = |m: &Vector3<f64>| (m.z - m.xy().push(1.0).dot(&plane)).abs();
    let off_m = upper_median(places.iter().map(off_m).collect())?;
    let is_flat = off_m <= MAX_OFF_PLANE_M.min(MAX_OFF_PLANE_RATIO * steep * extent_m);
    let leans = |axis: usize| upper_median(stances.iter().map(|s| s.lean[axis]).collect());
    let lean = Vector2::new(leans(0)?, leans(1)?);
    let is_same = (lean + slope).norm() <= MAX_LEAN_DIFFERENCE * steep && lean.norm() >= MIN_SLOPE;
    (extent_m >= MIN_EXTENT_M && is_flat && is_same).then(|| libm::atan(steep))
}

/// The plane (a, b, c) through these places, by reweighted least squares with a level prior.
fn plane(places: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let middle = places.iter().sum::<Vector3<f64>>() / places.len().max(1) as f64;
    let mut plane = Vector3::zeros();
    for round in 0..ROUNDS {
        let mut matrix = Matrix3::from_diagonal(&Vector3::new(LEVEL_WEIGHT, LEVEL_WEIGHT, 0.0));
        let mut vector = Vector3::zeros();
        for place in places {
            let m = place - middle;
            let row = m.xy().push(1.0);
            let off = if round == 0 {
                0.0
            } else {
                (m.z - row.dot(&plane)) / WEIGHT_M
            };
            let weight = 1.0 / ((1.0 + off * off) * (1.0 + off * off));
            matrix += weight * row * row.transpose();
            vector += weight * m.z * row;
        }
        plane = matrix.cholesky()?.solve(&vector);
    }
    let height_m = middle.z + plane.z - middle.xy().dot(&plane.xy());
    Some(plane.xy().push(height_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reported tilt, degrees. The height of the floor is `height_m(x)`; people go to and fro
    /// along x from -2 to 2 m, and lean by `lean` along x.
    fn tilt_deg(height_m: impl Fn(f64) -> f64, lean: f64) -> Option<f64> {
        let stances: Vec<Stance> = (0..120)
            .map(|i| {
                let along = f64::from(i) * 0.1;
                let x = 2.0 * libm::sin(along);
                // People step and sway.
                let (step_m, sway) = (0.01 * f64::from(i % 4), 0.04 * libm::sin(7.0 * along));
                Stance {
                    foot_m: Vector3::new(x, 0.3 * libm::cos(3.0 * along), height_m(x) + step_m),
                    lean: Vector2::new(lean + sway, 0.5 * sway),
                }
            })
            .collect();
        tilt_rad(&stances).map(f64::to_degrees)
    }

    #[test]
    fn the_world_is_tilted_if_the_floor_and_the_people_are() {
        for degrees in [-8.0_f64, -5.0, 3.5, 5.0, 12.0] {
            let slope = libm::tan(degrees.to_radians());
            let tilt = tilt_deg(|x| slope * x, -libm::sin(degrees.to_radians()));
            let tilt = tilt.unwrap_or_else(|| panic!("{degrees}: no tilt"));
            assert!((tilt - degrees.abs()).abs() < 0.5, "{degrees}: {tilt}");
        }
    }

    #[test]
    fn ramps_stages_and_leaning_people_are_no_tilt() {
        let slope = 0.1;
        assert_eq!(tilt_deg(|x| slope * x, 0.0), None, "a ramp");
        assert_eq!(tilt_deg(|x| slope * x, 0.1), None, "up a ramp");
        let stage = |x: f64| if x > 0.0 { 0.4 } else { 0.0 };
        assert_eq!(tilt_deg(stage, 0.0), None, "a stage");
        assert_eq!(tilt_deg(stage, -0.1), None, "a stage, leaning");
        assert_eq!(tilt_deg(|_| 0.0, -0.1), None, "a runner");
        assert_eq!(tilt_deg(|x| 0.02 * x, -0.02), None, "a degree");
        let on_the_spot = tilt_deg(|x| 0.5 * slope * x, -0.1);
        assert_eq!(on_the_spot, None, "less than they lean");
    }
}
