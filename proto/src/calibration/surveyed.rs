//! Cameras in surveyed coordinates: correct, but too far from the origin for precise computation.

use nalgebra::Vector3;

use super::MAX_DISTANCE_M;

/// Largest distance from the origin of coordinates on Earth, metres.
const FARTHEST_M: f64 = 2e7;
/// Rounding of the reported place, metres, so that it is easily added again.
const ROUNDED_M: f64 = 10.0;

/// The rounded common place of distant cameras, for example (500000, 5000000, 120). `None` if they
/// are scattered, which indicates another unit, or if a number is not finite.
pub(super) fn place(centers_m: &[Vector3<f64>]) -> Option<[f64; 3]> {
    let mean_m = centers_m.iter().sum::<Vector3<f64>>() / centers_m.len() as f64;
    let is_together = centers_m
        .iter()
        .all(|it| (it - mean_m).norm() < MAX_DISTANCE_M);
    let is_place = is_together && mean_m.norm() < FARTHEST_M;
    is_place.then(|| mean_m.map(|it| (it / ROUNDED_M).round() * ROUNDED_M).into())
}

/// The error for cameras at `place`, with the remedy.
pub(super) fn refusal([x, y, z]: [f64; 3]) -> String {
    format!(
        "the cameras stand at about ({x:.0}, {y:.0}, {z:.0}) m: these are surveyed coordinates (UTM, say), too far from the origin \
         to compute with; subtract an origin near the cameras, z being the height of the floor: `farfield calibrate convert FILE \
         --origin {x:.0},{y:.0},{z:.0} --out DIR`"
    )
}
