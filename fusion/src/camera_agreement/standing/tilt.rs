//! Whether the world is tilted against the floor on which people stand, and against how they stand on it.
//!
//! ```text
//!   z = a x + b y + c      (x, y, z): where the feet are of who stands, world, metres
//!   (-a, -b, 1)            what is up for the floor
//! ```
//!
//! A ramp, and a stage of two heights, tilt the feet and not the people; who runs leans, and the floor does not. A world that
//! is tilted does both, the same way and by as much.

use farfield_proto::order_statistics::{percentile, upper_median};
use nalgebra::{Matrix3, Vector2, Vector3};

use crate::body::skeleton::{Joint, Joints};

/// Least places that tell.
const MIN_PLACES: usize = 40;
/// Least tilt that is told of, as a slope: 2.5 degrees.
const MIN_SLOPE: f64 = 0.0437;
/// How far people must be apart along the slope, metres: nine tenths of the places.
const MIN_WAY_M: f64 = 2.0;
/// How far feet may be from the plane in the median, as a share of what that rises along the way, and metres: they step, and
/// were seen to be 0.018 off.
const FLAT: f64 = 0.25;
const FLAT_M: f64 = 0.03;
/// How far what is up for people may be from what is up for the floor, as a share of the slope.
const SAME: f64 = 0.5;
/// Distance from the plane at which a place weighs a quarter, metres: a foot in the air.
const WEIGHT_M: f64 = 0.06;
/// What a slope of one counts as, in places that are a metre from each other: of a way along one line nobody knows what is
/// beside it.
const LEVEL: f64 = 1.0;
/// Rounds of weighting.
const ROUNDS: usize = 6;

/// Where somebody stands, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Stance {
    /// The lowest point of the feet, world, metres.
    pub(super) foot_m: Vector3<f64>,
    /// By how much the shoulders are to the side of the ankles (x, y), as a share of how far they are from these.
    pub(super) lean: Vector2<f64>,
}

impl Stance {
    /// Of a body whose lowest point of the feet is there.
    pub(super) fn of(joints_m: &Joints, foot_m: Vector3<f64>) -> Self {
        let middle = |of: [Joint; 2]| 0.5 * (joints_m[of[0].index()] + joints_m[of[1].index()]);
        let ankles_m = middle([Joint::LeftAnkle, Joint::RightAnkle]);
        let up_m = middle([Joint::LeftShoulder, Joint::RightShoulder]) - ankles_m;
        Self {
            foot_m,
            lean: up_m.xy() / up_m.norm().max(f64::MIN_POSITIVE),
        }
    }
}

/// By how much the world is tilted, radians; `None` where it is not, or too little is known.
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
    let way_m = percentile(&along_m, 0.95)? - percentile(&along_m, 0.05)?;
    let off_m = |m: &Vector3<f64>| (m.z - m.xy().push(1.0).dot(&plane)).abs();
    let off_m = upper_median(places.iter().map(off_m).collect())?;
    let is_flat = off_m <= FLAT_M.min(FLAT * steep * way_m);
    let leans = |axis: usize| upper_median(stances.iter().map(|s| s.lean[axis]).collect());
    let lean = Vector2::new(leans(0)?, leans(1)?);
    let is_same = (lean + slope).norm() <= SAME * steep && lean.norm() >= MIN_SLOPE;
    (way_m >= MIN_WAY_M && is_flat && is_same).then(|| libm::atan(steep))
}

/// The plane (a, b, c) of these places, as far as they tell.
fn plane(places: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    let middle = places.iter().sum::<Vector3<f64>>() / places.len().max(1) as f64;
    let mut plane = Vector3::zeros();
    for round in 0..ROUNDS {
        let mut matrix = Matrix3::from_diagonal(&Vector3::new(LEVEL, LEVEL, 0.0));
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

    /// By what the world seems to be tilted, degrees, where the floor is `height_m(x)` high, people go to and fro along x from
    /// -2 to 2 m, and lean so along x.
    fn tilt_deg(height_m: impl Fn(f64) -> f64, lean: f64) -> Option<f64> {
        let stances: Vec<Stance> = (0..120)
            .map(|i| {
                let along = f64::from(i) * 0.1;
                let x = 2.0 * libm::sin(along);
                // They step, and sway as they do.
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
    fn a_world_is_tilted_where_the_floor_and_who_stands_on_it_are() {
        for degrees in [-8.0_f64, -5.0, 3.5, 5.0, 12.0] {
            let slope = libm::tan(degrees.to_radians());
            let found = tilt_deg(|x| slope * x, -libm::sin(degrees.to_radians()));
            let found = found.unwrap_or_else(|| panic!("{degrees}: nothing is told"));
            assert!((found - degrees.abs()).abs() < 0.5, "{degrees}: {found}");
        }
    }

    #[test]
    fn nothing_is_said_of_a_ramp_a_stage_and_of_who_leans() {
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
