//! The first and the second half of the data, adjusted apart.

use farfield_proto::order_statistics::upper_median;
use nalgebra::Vector3;

use crate::adjustment::{AdjustedCamera, Block, CameraState, Free, Limits, Path, Problem, adjust};
use crate::alignment::Similarity;

/// Sights of a camera that a half needs.
const LEAST_SIGHTS: usize = 15;

/// Where in the picture halves are compared besides its middle: towards each corner, as a share of the picture's sides. What
/// turns about the axis of the camera moves nothing in the middle.
const TOWARDS_CORNER: f64 = 0.35;

/// How far two halves put a camera from each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Apart {
    /// Their pinholes, in the unit of the problem.
    pub(crate) distance: f64,
    /// Their axes.
    pub(crate) turned_rad: f64,
    /// The most that they draw a point apart that is at the usual depth of the first, ahead of it or
    /// [`TOWARDS_CORNER`] of the picture off; infinite where one draws it not.
    pub(crate) px: f64,
}

/// Per camera the median depth of what it saw; `None` of nothing.
fn depths(problem: &Problem) -> Vec<Option<f64>> {
    let mut depths = vec![Vec::new(); problem.cameras.len()];
    for it in &problem.observations {
        let Some(camera) = problem.cameras.get(it.camera) else {
            continue;
        };
        let point = match &problem.path {
            Path::Points(points) => points.get(it.point).copied(),
            Path::Curve(spline) => spline.at(camera.state.time_s(it.frame)),
        };
        if let Some(point) = point {
            let seen = camera.state.camera_from_world * (point - camera.state.center_w);
            depths[it.camera].push(seen.z);
        }
    }
    depths.into_iter().map(upper_median).collect()
}

/// Per camera, how far the two halves put its centre from each other (in the unit of the problem) and turn it (radians),
/// after the second was laid on the first by a similarity; `None` where a half has too little.
///
/// Lenses and clocks stay as the whole has them: a half starts from the whole, and what it then moves is the pose.
pub(crate) fn halves(problem: &Problem) -> Vec<Option<Apart>> {
    let none = vec![None; problem.cameras.len()];
    let moments: Vec<f64> = problem
        .observations
        .iter()
        .map(|it| moment(problem, it))
        .collect();
    let Some(middle) = upper_median(moments.clone()) else {
        return none;
    };
    let solved = |is_first: bool| {
        let mut half = problem.clone();
        let mut kept = moments.iter().map(|moment| (*moment < middle) == is_first);
        half.observations.retain(|_| kept.next().unwrap_or(false));
        let mut counts = vec![0; problem.cameras.len()];
        for observation in &half.observations {
            counts[observation.camera] += 1;
        }
        for (camera, count) in half.cameras.iter_mut().zip(&counts) {
            // What saw nothing keeps its place.
            let free = if *count < LEAST_SIGHTS {
                Free::none()
            } else {
                Free::none().with(Block::Pose)
            };
            *camera = AdjustedCamera::new(camera.state, free);
        }
        let limits = Limits {
            steps: 25,
            decrease: 1e-6,
        };
        adjust(&mut half, limits);
        let states: Vec<CameraState> = half.cameras.iter().map(|c| c.state).collect();
        (states, counts)
    };
    let ((first, first_counts), (second, second_counts)) = (solved(true), solved(false));
    let both: Vec<usize> = (0..first.len())
        .filter(|i| first_counts[*i] >= LEAST_SIGHTS && second_counts[*i] >= LEAST_SIGHTS)
        .collect();
    let centers =
        |states: &[CameraState]| both.iter().map(|i| states[*i].center_w).collect::<Vec<_>>();
    let Ok(similarity) = Similarity::between(&centers(&second), &centers(&first)) else {
        return none;
    };
    let depths = depths(problem);
    let apart = (0..first.len()).map(|i| {
        both.contains(&i).then(|| {
            let moved = similarity.apply_to_camera(&second[i]);
            let turned = moved
                .camera_from_world
                .angle_to(&first[i].camera_from_world);
            let depth = depths.get(i).copied().flatten().unwrap_or(f64::NAN);
            Apart {
                distance: (moved.center_w - first[i].center_w).norm(),
                turned_rad: turned,
                px: drawn_apart_px(&first[i], &moved, depth),
            }
        })
    });
    apart.collect()
}

/// [`Apart::px`] of two states of a camera, at `depth`.
fn drawn_apart_px(first: &CameraState, second: &CameraState, depth: f64) -> f64 {
    let fold_radius = first.fold_radius();
    let of = &first.intrinsics;
    // The principal point is about the middle of the picture.
    let off = [of.cx_px, of.cy_px].map(|middle| 2.0 * TOWARDS_CORNER * middle);
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]];
    let towards = corners.iter().filter_map(|[x, y]| {
        let px = [of.cx_px + x * off[0], of.cy_px + y * off[1]];
        // What the lens does not draw there says nothing.
        let bearing = first.bearing(px, fold_radius)?;
        (bearing.z > 0.0).then(|| bearing * (depth / bearing.z))
    });
    let ahead = Vector3::new(0.0, 0.0, depth);
    let each = std::iter::once(ahead).chain(towards).map(|seen| {
        let point = first.center_w + first.camera_from_world.inverse() * seen;
        let drawn = |state: &CameraState| state.project(&point, state.fold_radius());
        let both = drawn(first).zip(drawn(second));
        both.map_or(f64::INFINITY, |(a, b)| (a - b).norm())
    });
    each.fold(0.0, f64::max)
}

/// What orders an observation in time.
fn moment(problem: &Problem, observation: &crate::adjustment::Observation) -> f64 {
    match &problem.path {
        Path::Points(_) => observation.point as f64,
        Path::Curve(_) => {
            let camera = problem.cameras.get(observation.camera);
            camera.map_or(0.0, |camera| camera.state.time_s(observation.frame))
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Distortion, Intrinsics};
    use nalgebra::UnitQuaternion;

    use super::*;

    #[test]
    fn halves_that_are_turned_about_the_axis_of_the_camera_are_apart() {
        let intrinsics = Intrinsics {
            fx_px: 1100.0,
            fy_px: 1100.0,
            cx_px: 960.0,
            cy_px: 600.0,
        };
        let first = CameraState::at_origin(intrinsics, &Distortion::default());
        let rolled = CameraState {
            camera_from_world: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.01),
            ..first
        };
        // 0.35 of the picture's sides off its middle.
        let arm_px = libm::hypot(0.7 * 960.0, 0.7 * 600.0);
        let px = drawn_apart_px(&first, &rolled, 8.0);
        assert!((px - 0.01 * arm_px).abs() < 0.01, "{px}");
        assert!(drawn_apart_px(&first, &first, 8.0) < 1e-9);
    }
}
