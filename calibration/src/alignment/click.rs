//! What was clicked in pictures, and where its lines of sight meet.

use nalgebra::Vector3;

use crate::adjustment::CameraState;
use crate::geometry::triangulate;

/// Where a camera, by name, saw something: distorted pixels.
pub type Click = (String, [f64; 2]);

/// Largest angle between a click and the point that all clicks agree on, radians.
const CLICK_RAD: f64 = 0.02;

/// The camera of this name.
pub(super) fn camera<'a>(
    cameras: &'a [(String, CameraState)],
    name: &str,
) -> Result<&'a CameraState, String> {
    let found = cameras.iter().find(|(other, _)| other == name);
    found.map(|(_, state)| state).ok_or_else(|| {
        let names: Vec<&str> = cameras.iter().map(|(name, _)| name.as_str()).collect();
        format!(
            "found camera `{name}`, expected one of {}",
            names.join(", ")
        )
    })
}

/// The point that at least two of the clicks agree on.
pub(super) fn meeting(
    cameras: &[(String, CameraState)],
    clicks: &[Click],
    what: &str,
) -> Result<Vector3<f64>, String> {
    let mut sights = Vec::new();
    for (name, px) in clicks {
        let state = camera(cameras, name)?;
        let bearing = state.bearing(*px, state.fold_radius()).ok_or_else(|| {
            format!(
                "{what}: camera `{name}` draws nothing at ({}, {})",
                px[0], px[1]
            )
        })?;
        sights.push((state.center_w, state.camera_from_world.inverse() * bearing));
    }
    let (point, agreeing) = triangulate(&sights, CLICK_RAD).ok_or_else(|| {
        format!(
            "{what}: its clicks in {} cameras do not meet, expected at least two that do",
            clicks.len()
        )
    })?;
    if agreeing.len() < sights.len() {
        let off = (0..sights.len())
            .find(|i| !agreeing.contains(i))
            .unwrap_or(0);
        let name = clicks.get(off).map_or("", |(name, _)| name.as_str());
        return Err(format!(
            "{what}: its click in camera `{name}` does not meet the others"
        ));
    }
    Ok(point)
}
