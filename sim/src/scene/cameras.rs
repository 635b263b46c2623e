//! Generates cameras for a field: viewpoints around it, each a fan of cameras that covers all of
//! it.
//!
//! The directions from a viewpoint to the field are divided evenly among its cameras. Each slice is
//! a little wider than its share. A camera is aimed so that its slice of the field, from the floor
//! to above a jumping head, fits into the image with the longest focal length. With a fisheye the
//! slice fits into the used part of the image.

use std::f64::consts::{PI, TAU};

use farfield_proto::camera::{
    CameraModel, Distortion, FISHEYE_HALF_VIEW_RAD, Intrinsics, LensModel,
};
use farfield_proto::toml_file::unknown_name;
use nalgebra::{Vector2, Vector3};
use rand::RngExt as _;

use super::file::GeneratedCameras;
use super::{Purpose, draws};
use crate::look_at::look_at;

/// Distance beyond the edge of the field at which bodies are still seen, metres; at most half the
/// way to the cameras.
const MARGIN_M: f64 = 0.3;
/// Height up to which bodies are seen, metres: a tall person's raised hand, or the head in a jump.
const TOP_M: f64 = 2.5;
/// By how much a slice is wider than its share, on either side.
const OVERLAP: f64 = 0.08;
/// Part of the image that a slice may fill, to allow for rounding.
const FILL: f64 = 0.985;
/// Largest tangent of the half angle of an image; a wider lens would need the fisheye model.
const WIDEST: f64 = 2.5;
/// Part of the used view of a fisheye that a slice may fill.
const USED: f64 = 0.98;
/// Step of the search for a camera's direction, radians.
const STEP_RAD: f64 = PI / 720.0;

/// The cameras of a scene, by viewpoint.
#[derive(Debug, Default)]
pub(super) struct CameraRig {
    pub(super) viewpoints: Vec<super::SceneViewpoint>,
    pub(super) cameras: Vec<CameraModel>,
}

/// Places the cameras of `wanted` around a field of `size_m` whose floor is `floor_m` above the
/// ground.
///
/// # Errors
/// A description of the problem when the field cannot be covered.
pub(super) fn generate(
    wanted: &GeneratedCameras,
    size_m: [f64; 2],
    floor_m: f64,
    seed: u64,
) -> Result<CameraRig, String> {
    let half_m = Vector2::new(size_m[0] / 2.0, size_m[1] / 2.0);
    let mut rng = draws(seed, Purpose::Cameras, 0);
    let mut rig = CameraRig::default();
    let places = places(wanted.viewpoints, half_m, wanted.setback_m);
    check_names(wanted, &places)?;
    for (name, at_m) in places {
        let fisheye = wanted.fisheye_of(&name).map(LensModel::KannalaBrandt);
        let eye = Vector3::new(at_m.x, at_m.y, wanted.height_m);
        let seen_m = half_m.add_scalar(MARGIN_M.min(wanted.setback_m / 2.0));
        let first = rig.cameras.len();
        for (index, slice) in slices(seen_m, at_m, wanted.per_viewpoint)
            .into_iter()
            .enumerate()
        {
            let name = format!("{name}-{}", index + 1);
            let look = aim(eye, &slice, floor_m, wanted.size_px, fisheye.as_ref()).ok_or_else(|| {
                format!("camera `{name}` cannot cover its part of the field: place the cameras farther back, or use more of them")
            })?;
            let [w, h] = wanted.size_px.map(f64::from);
            let intrinsics = Intrinsics {
                fx_px: look.focal_px,
                fy_px: look.focal_px,
                cx_px: (w - 1.0) / 2.0,
                cy_px: (h - 1.0) / 2.0,
            };
            // Both terms shrink the image, and 1 + 3 k1 r2 + 5 k2 r4 has no root.
            let distortion = Distortion {
                k1: rng.random_range(-0.095..-0.065),
                k2: 0.02,
                ..Distortion::default()
            };
            let pose = look_at(eye, eye + look.direction);
            let lens = fisheye.unwrap_or(distortion.into());
            let camera = CameraModel::new(name, wanted.size_px, intrinsics, lens, pose);
            rig.cameras.push(camera.map_err(|error| error.to_string())?);
        }
        rig.viewpoints.push(super::SceneViewpoint {
            name,
            cameras: (first..rig.cameras.len()).collect(),
        });
    }
    Ok(rig)
}

/// Refuses lenses for unknown viewpoints.
fn check_names(wanted: &GeneratedCameras, places: &[(String, Vector2<f64>)]) -> Result<(), String> {
    let named = wanted.fisheye_viewpoints.iter().flatten();
    if wanted.fisheye.is_none() && wanted.fisheye_viewpoints.is_some() {
        return Err(
            "`fisheye_viewpoints` without `fisheye`: expected the coefficients of their lenses, [k1, k2, k3, k4]".to_owned(),
        );
    }
    for name in named {
        if !places.iter().any(|(known, _)| known == name) {
            let known: Vec<&str> = places.iter().map(|(name, _)| name.as_str()).collect();
            return Err(format!(
                "`fisheye_viewpoints`: {}",
                unknown_name("viewpoint", name, &known)
            ));
        }
    }
    Ok(())
}

/// Names and positions of `n` viewpoints around a field that extends to `half_m`.
fn places(n: usize, half_m: Vector2<f64>, setback_m: f64) -> Vec<(String, Vector2<f64>)> {
    let reach = half_m.add_scalar(setback_m);
    let corners = [
        ("north-east", [1.0, 1.0]),
        ("north-west", [-1.0, 1.0]),
        ("south-west", [-1.0, -1.0]),
        ("south-east", [1.0, -1.0]),
    ];
    let corners =
        corners.map(|(name, [x, y])| (name.to_owned(), Vector2::new(x, y).component_mul(&reach)));
    if n <= 4 {
        // Two viewpoints cover most from opposite corners.
        let chosen: &[usize] = match n {
            2 => &[0, 2],
            _ => &[0, 1, 2, 3][..n],
        };
        return chosen.iter().map(|&i| corners[i].clone()).collect();
    }
    let along = sides(n - 4, reach);
    let mut places = Vec::new();
    for (side, name) in ["north", "west", "south", "east"].into_iter().enumerate() {
        let (from, to) = (corners[side].1, corners[(side + 1) % 4].1);
        places.push(corners[side].clone());
        for i in 1..=along[side] {
            let share = i as f64 / (along[side] + 1) as f64;
            places.push((format!("{name}-{i}"), from.lerp(&to, share)));
        }
    }
    places
}

/// The number of viewpoints on the north, west, south and east side, of `n` between the corners.
/// Each next one goes to the side with the largest gap; the first side wins a tie.
fn sides(n: usize, reach: Vector2<f64>) -> [usize; 4] {
    let length_m = [reach.x, reach.y, reach.x, reach.y];
    let mut along = [0; 4];
    for _ in 0..n {
        let gap_m = |side: usize, along: &[usize; 4]| length_m[side] / (along[side] + 1) as f64;
        let mut widest = 0;
        for side in 1..4 {
            if gap_m(side, &along) > gap_m(widest, &along) + 1e-9 {
                widest = side;
            }
        }
        along[widest] += 1;
    }
    along
}

/// The parts of the rectangle that extends to `half_m`, one for each of the `n` cameras at `eye`,
/// from left to right: corners of convex polygons on the floor.
fn slices(half_m: Vector2<f64>, eye: Vector2<f64>, n: usize) -> Vec<Vec<Vector2<f64>>> {
    let field = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]
        .map(|[x, y]| Vector2::new(x, y).component_mul(&half_m));
    // Angles to the left of the direction to the middle of the field; all are below a half turn.
    let middle = -eye;
    let angle = |p: &Vector2<f64>| middle.perp(&(p - eye)).atan2(middle.dot(&(p - eye)));
    let leftmost = field.iter().map(angle).fold(f64::MIN, f64::max);
    let rightmost = field.iter().map(angle).fold(f64::MAX, f64::min);
    let share = (leftmost - rightmost) / n as f64;
    let forward = middle.y.atan2(middle.x);
    let slice = |i: usize| {
        let left = leftmost - i as f64 * share;
        let wider = OVERLAP * share;
        let ray = |angle: f64| Vector2::new((forward + angle).cos(), (forward + angle).sin());
        let mut part = field.to_vec();
        if i > 0 {
            let ray = ray(left + wider);
            part = clip(&part, |p| -ray.perp(&(p - eye)));
        }
        if i + 1 < n {
            let ray = ray(left - share - wider);
            part = clip(&part, |p| ray.perp(&(p - eye)));
        }
        part
    };
    (0..n).map(slice).collect()
}

/// The part of a convex polygon where `inside` is not negative (Sutherland-Hodgman clipping).
fn clip(polygon: &[Vector2<f64>], inside: impl Fn(&Vector2<f64>) -> f64) -> Vec<Vector2<f64>> {
    let mut kept = Vec::new();
    for (i, a) in polygon.iter().enumerate() {
        let b = &polygon[(i + 1) % polygon.len()];
        let (at_a, at_b) = (inside(a), inside(b));
        if at_a >= 0.0 {
            kept.push(*a);
        }
        if at_a * at_b < 0.0 {
            kept.push(a.lerp(b, at_a / (at_a - at_b)));
        }
    }
    kept
}

/// Direction and focal length of a camera.
struct CameraLook {
    direction: Vector3<f64>,
    focal_px: f64,
}

/// The direction from `eye` in which the prism over `slice` of the floor fits into the image with
/// the longest focal length.
fn aim(
    eye: Vector3<f64>,
    slice: &[Vector2<f64>],
    floor_m: f64,
    size_px: [u32; 2],
    fisheye: Option<&LensModel>,
) -> Option<CameraLook> {
    let corners: Vec<Vector3<f64>> = slice
        .iter()
        .flat_map(|p| [0.0, TOP_M].map(|z| Vector3::new(p.x, p.y, floor_m + z) - eye))
        .collect();
    let sum: Vector3<f64> = corners.iter().map(Vector3::normalize).sum();
    let pan = sum.y.atan2(sum.x);
    let mut best = (0.0, 0.0, 0.0);
    // From coarse to fine: the focal length is smooth enough in both angles.
    for step in [16.0 * STEP_RAD, 4.0 * STEP_RAD, STEP_RAD] {
        let (_, pan_0, tilt_0) = if best.0 > 0.0 {
            best
        } else {
            (0.0, pan, -TAU / 12.0)
        };
        let reach: i32 = if best.0 > 0.0 { 5 } else { 20 };
        for i in -reach..=reach {
            for j in -reach..=reach {
                let (pan, tilt) = (pan_0 + f64::from(i) * step, tilt_0 + f64::from(j) * step);
                let focal_px = longest_lens(&corners, pan, tilt, size_px, fisheye);
                if focal_px > best.0 {
                    best = (focal_px, pan, tilt);
                }
            }
        }
    }
    let (focal_px, pan, tilt) = best;
    // A fisheye may be as wide as its used view.
    let widest_px = if fisheye.is_some() {
        0.0
    } else {
        f64::from(size_px[0].max(size_px[1])) / 2.0 / WIDEST
    };
    (focal_px > widest_px).then(|| CameraLook {
        direction: direction(pan, tilt),
        focal_px,
    })
}

fn direction(pan: f64, tilt: f64) -> Vector3<f64> {
    Vector3::new(tilt.cos() * pan.cos(), tilt.cos() * pan.sin(), tilt.sin())
}

/// The longest focal length that shows all `corners` (relative to the eye), pixels; 0 if none does.
fn longest_lens(
    corners: &[Vector3<f64>],
    pan: f64,
    tilt: f64,
    size_px: [u32; 2],
    fisheye: Option<&LensModel>,
) -> f64 {
    if tilt.abs() > 0.49 * PI {
        return 0.0;
    }
    let forward = direction(pan, tilt);
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let (mut x, mut y) = (1e-9_f64, 1e-9_f64);
    for corner in corners {
        let depth = corner.dot(&forward);
        if depth <= 0.05 {
            return 0.0;
        }
        if let Some(lens) = fisheye {
            let p = Vector2::new(corner.dot(&right), corner.dot(&down)) / depth;
            if p.norm() > USED * FISHEYE_HALF_VIEW_RAD.tan() {
                return 0.0;
            }
            let drawn = lens.draw_with_jacobian(p).0;
            (x, y) = (x.max(drawn.x.abs()), y.max(drawn.y.abs()));
            continue;
        }
        x = x.max(corner.dot(&right).abs() / depth);
        y = y.max(corner.dot(&down).abs() / depth);
    }
    let [w, h] = size_px.map(f64::from);
    FILL * (w / 2.0 / x).min(h / 2.0 / y)
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Point;

    use super::*;

    fn wanted(
        viewpoints: usize,
        per_viewpoint: usize,
        height_m: f64,
        setback_m: f64,
    ) -> GeneratedCameras {
        GeneratedCameras {
            viewpoints,
            per_viewpoint,
            height_m,
            setback_m,
            size_px: [1920, 1200],
            fisheye: None,
            fisheye_viewpoints: None,
        }
    }

    /// Checks that a camera of every viewpoint sees every point over the field.
    fn check(wanted: &GeneratedCameras, size_m: [f64; 2]) {
        let rig = generate(wanted, size_m, 0.0, 7).unwrap();
        assert_eq!(rig.viewpoints.len(), wanted.viewpoints);
        let names: std::collections::BTreeSet<_> =
            rig.cameras.iter().map(CameraModel::name).collect();
        assert_eq!(names.len(), wanted.viewpoints * wanted.per_viewpoint);
        let grid = |n: usize| (0..=n).map(move |i| i as f64 / n as f64);
        for (x, y, z) in
            grid(12).flat_map(|x| grid(12).flat_map(move |y| grid(4).map(move |z| (x, y, z))))
        {
            let point = Vector3::new((x - 0.5) * size_m[0], (y - 0.5) * size_m[1], 2.0 * z);
            for viewpoint in &rig.viewpoints {
                let sees = |&camera: &usize| {
                    let camera = &rig.cameras[camera];
                    let px = camera.project(Point::new(point.into()));
                    px.is_some_and(|px| camera.sees(px))
                };
                assert!(
                    viewpoint.cameras.iter().any(sees),
                    "{} does not see {point:?}",
                    viewpoint.name
                );
            }
        }
    }

    #[test]
    fn every_viewpoint_sees_all_of_a_small_court() {
        check(&wanted(4, 2, 2.5, 1.5), [7.0, 5.0]);
    }

    #[test]
    fn every_viewpoint_sees_all_of_a_futsal_court() {
        check(&wanted(4, 3, 4.0, 2.0), [24.0, 16.0]);
    }

    #[test]
    fn every_viewpoint_sees_all_of_a_stadium() {
        check(&wanted(16, 2, 12.0, 8.0), [105.0, 68.0]);
    }

    #[test]
    fn odd_numbers_of_cameras_work_too() {
        for n in [1, 2, 3, 5, 6, 7] {
            check(&wanted(n, 1, 3.0, 2.0), [8.0, 8.0]);
        }
        check(&wanted(1, 5, 6.0, 4.0), [30.0, 10.0]);
    }

    #[test]
    fn a_field_that_one_camera_cannot_cover_is_refused() {
        let narrow = GeneratedCameras {
            size_px: [16, 8192],
            ..wanted(4, 1, 2.5, 1.5)
        };
        let refused = generate(&narrow, [7.0, 5.0], 0.0, 7).err().unwrap();
        assert!(refused.contains("`north-east-1`"), "{refused}");
    }

    /// Coefficients of a typical fit.
    const FISHEYE: [f64; 4] = [-0.02, 0.005, -0.002, 0.0003];

    #[test]
    fn fisheyes_see_all_of_the_field_in_their_used_view() {
        for (field, wanted) in [
            ([7.0, 5.0], wanted(4, 1, 2.5, 1.5)),
            ([24.0, 16.0], wanted(4, 2, 4.0, 2.0)),
        ] {
            let wide = GeneratedCameras {
                fisheye: Some(FISHEYE),
                ..wanted
            };
            check(&wide, field);
            let rig = generate(&wide, field, 0.0, 7).unwrap();
            assert!(rig.cameras.iter().all(|it| it.lens().is_fisheye()));
        }
    }

    #[test]
    fn fisheyes_at_some_viewpoints_do_not_change_other_cameras() {
        let plain = wanted(4, 1, 2.5, 1.5);
        let mixed = GeneratedCameras {
            fisheye: Some(FISHEYE),
            fisheye_viewpoints: Some(vec!["north-east".to_owned(), "south-west".to_owned()]),
            ..plain.clone()
        };
        let [plain, mixed] =
            [&plain, &mixed].map(|wanted| generate(wanted, [7.0, 5.0], 0.0, 7).unwrap());
        let is_fisheye: Vec<bool> = mixed
            .cameras
            .iter()
            .map(|it| it.lens().is_fisheye())
            .collect();
        assert_eq!(is_fisheye, [true, false, true, false]);
        assert_eq!(plain.cameras[1], mixed.cameras[1]);
        assert_eq!(plain.cameras[3], mixed.cameras[3]);
        let unknown = GeneratedCameras {
            fisheye: Some(FISHEYE),
            fisheye_viewpoints: Some(vec!["north".to_owned()]),
            ..wanted(4, 1, 2.5, 1.5)
        };
        let refused = generate(&unknown, [7.0, 5.0], 0.0, 7).err().unwrap();
        assert!(refused.contains("unknown viewpoint `north`"), "{refused}");
    }
}
