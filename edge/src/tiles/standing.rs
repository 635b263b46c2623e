//! Sizes of people in a picture: standing persons at sample places of the floor.

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Distorted, Pixel, Point, World};

use super::plan::Cell;

/// Height of the person assumed in the plan of tiles, metres.
const STATURE_M: f64 = 1.7;

/// Sample places along each side of the field and of the picture.
const STEPS: usize = 64;
/// Feet are sampled down to this share of a picture's height below its lower edge, because the
/// heads of these people are still in the picture.
const BELOW: f64 = 0.6;
/// Half the width of a person's box, body heights: raised arms or a long stride.
const HALF_WIDTH: f64 = 0.3;
/// Margin above the head and below the feet, body heights: a raised hand, a bending lens.
const OVER: f64 = 0.08;
/// Width of the shoulders, body heights: the size of a person for a camera above.
const SHOULDERS: f64 = 0.25;

/// A person standing in the field, as seen by a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Standing {
    /// Left, top, right and bottom, pixels from the picture's outer corner; not cut at its edges.
    pub(super) around_px: [f64; 4],
    /// Length from feet to crown, or between the shoulders if longer, pixels.
    pub(super) long_px: f64,
}

/// A person at `feet_m` (world, metres) as seen by `camera`; `None` if completely outside the
/// picture.
pub(super) fn standing(camera: &CameraModel, feet_m: [f64; 3]) -> Option<Standing> {
    let drawn = |[x, y, z]: [f64; 3]| -> Option<Pixel<Distorted>> {
        let p_w = Point::<World>::new([x, y, z].into());
        camera.distort(camera.project(p_w)?)
    };
    let [x, y, z] = feet_m;
    let (feet, crown) = (drawn(feet_m)?, drawn([x, y, z + STATURE_M])?);
    let upright_px = (feet.vector_px() - crown.vector_px()).norm();
    // The height for a camera at the person's own height.
    let full_px = upright_px.max(STATURE_M * pixels_per_metre(camera, feet_m)?);
    let long_px = upright_px.max(SHOULDERS * full_px);
    let half_width = HALF_WIDTH * full_px;
    // From above, arms extend beyond head and feet.
    let lying = 1.0 - (feet.y() - crown.y()).abs() / full_px;
    let over = (OVER + (HALF_WIDTH - OVER) * lying) * full_px;
    let around_px = [
        feet.x().min(crown.x()) - half_width + 0.5,
        feet.y().min(crown.y()) - over + 0.5,
        feet.x().max(crown.x()) + half_width + 0.5,
        feet.y().max(crown.y()) + over + 0.5,
    ];
    let [width, height] = camera.size_px().map(f64::from);
    let [l, t, r, b] = around_px;
    (l < width && r > 0.0 && t < height && b > 0.0).then_some(Standing { around_px, long_px })
}

/// Pixels of `camera` per metre across its line of sight, at the nearer of feet and crown; `None`
/// behind the camera. A fisheye projects angles, so the distance counts there instead of the depth.
fn pixels_per_metre(camera: &CameraModel, [x, y, z]: [f64; 3]) -> Option<f64> {
    let is_fisheye = camera.lens().is_fisheye();
    let depth_m = |z: f64| {
        let p_w = Point::<World>::new([x, y, z].into());
        let p_c = (*camera.camera_from_world() * p_w).coordinates_m();
        if is_fisheye { p_c.coords.norm() } else { p_c.z }
    };
    let nearest_m = depth_m(z).min(depth_m(z + STATURE_M));
    let k = camera.intrinsics();
    (nearest_m > 0.0).then(|| k.fx_px.min(k.fy_px) / nearest_m)
}

/// The place of a person (world x and y, metres), and its outline in the picture.
pub(super) type StandingAt = ([f64; 2], Standing);

/// People on a grid over a cell of the field, as seen by `camera`. With `cells` cells in the field,
/// the grid is so fine that distant neighbours differ little.
pub(super) fn on_floor(
    camera: &CameraModel,
    cell: &Cell,
    cells: usize,
    floor_m: f64,
) -> impl Iterator<Item = Standing> {
    let steps = (STEPS as f64 / (cells as f64).sqrt()).ceil() as usize + 4;
    let share = move |i: usize| i as f64 / (steps - 1) as f64;
    (0..steps * steps).filter_map(move |i| {
        let [x, y] = cell.at([share(i % steps), share(i / steps)]);
        standing(camera, [x, y, floor_m])
    })
}

/// People whose feet are at the points of a grid over the picture, so that near neighbours differ
/// little.
pub(super) fn under_picture(camera: &CameraModel, floor_m: f64) -> Vec<StandingAt> {
    let share = |i: usize| i as f64 / (STEPS - 1) as f64;
    let [width, height] = camera.size_px().map(f64::from);
    let person = |i: usize| {
        let pixel = Pixel::<Distorted>::new(
            share(i % STEPS) * width - 0.5,
            share(i / STEPS) * height * (1.0 + BELOW) - 0.5,
        );
        let ray = camera.ray(camera.undistort(pixel)?);
        let eye = ray.origin.coordinates_m();
        let steps = (floor_m - eye.z) / ray.direction.z;
        let at = eye + ray.direction.into_inner() * steps;
        let is_ahead = steps > 0.0 && steps.is_finite();
        Some(([at.x, at.y], standing(camera, [at.x, at.y, floor_m])?)).filter(|_| is_ahead)
    };
    (0..STEPS * STEPS).filter_map(person).collect()
}
