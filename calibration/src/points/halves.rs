//! The first and the second half of the data, adjusted apart.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::order_statistics::{percentile, upper_median};

use crate::adjustment::{AdjustedCamera, Block, CameraState, Free, Limits, Path, Problem, adjust};
use crate::alignment::Similarity;

/// Sights of a camera that a half needs; of a body instants, for all its sights at one tell one pose.
const LEAST_SIGHTS: usize = 15;

/// Most sights of a camera at which halves are compared, and the share of these that is nearer than what is said.
const MOST_COMPARED: usize = 1000;
const NEARER: f64 = 0.95;

/// How far two halves put a camera from each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Apart {
    /// Their pinholes, in the unit of the problem.
    pub(crate) distance: f64,
    /// Their axes.
    pub(crate) turned_rad: f64,
    /// How far they draw a point apart where the camera saw points, pixels: 95 % of its sights are nearer. Infinite where one
    /// draws it not. Nothing is said of parts of the picture where nothing was seen.
    pub(crate) px: f64,
    /// The same where the point is, across the line of sight, in the unit of the problem.
    pub(crate) across: f64,
}

/// Per camera where in its picture it saw something and how deep that is, of at most [`MOST_COMPARED`] of its sights.
fn seen(problem: &Problem) -> Vec<Vec<([f64; 2], f64)>> {
    let mut seen = vec![Vec::new(); problem.cameras.len()];
    for it in &problem.observations {
        let Some(camera) = problem.cameras.get(it.camera) else {
            continue;
        };
        if let Some(point) = problem.path.place(it, &camera.state) {
            let at = camera.state.camera_from_world * (point - camera.state.center_w);
            seen[it.camera].push((it.px, at.z));
        }
    }
    for own in &mut seen {
        let step = own.len().div_ceil(MOST_COMPARED).max(1);
        *own = own.iter().copied().step_by(step).collect();
    }
    seen
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
        let counts = counts(&half);
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
    let seen = seen(problem);
    let apart = (0..first.len()).map(|i| {
        both.contains(&i).then(|| {
            let moved = similarity.apply_to_camera(&second[i]);
            let turned = moved
                .camera_from_world
                .angle_to(&first[i].camera_from_world);
            let (px, across) = drawn_apart(&first[i], &moved, &seen[i]);
            Apart {
                distance: (moved.center_w - first[i].center_w).norm(),
                turned_rad: turned,
                px,
                across,
            }
        })
    });
    apart.collect()
}

/// [`Apart::px`] and [`Apart::across`] of two states of a camera that saw points there (pixels, depth).
fn drawn_apart(first: &CameraState, second: &CameraState, seen: &[([f64; 2], f64)]) -> (f64, f64) {
    let folds = [first.fold_radius(), second.fold_radius()];
    let focal_px = (first.intrinsics.fx_px * first.intrinsics.fy_px).sqrt();
    let apart = |(px, depth): &([f64; 2], f64)| {
        // What the lens does not draw there says nothing.
        let bearing = first.bearing(*px, folds[0])?;
        let ahead = bearing * (depth / bearing.z);
        let point = first.center_w + first.camera_from_world.inverse() * ahead;
        let drawn = first.project(&point, folds[0])?;
        let other = second.project(&point, folds[1]);
        let apart_px = other.map_or(f64::INFINITY, |other| (drawn - other).norm());
        Some((apart_px, apart_px * depth / focal_px))
    };
    let (px, across): (Vec<f64>, Vec<f64>) = seen.iter().filter_map(apart).unzip();
    let most = |mut all: Vec<f64>| {
        all.sort_by(f64::total_cmp);
        percentile(&all, NEARER).unwrap_or(f64::NAN)
    };
    (most(px), most(across))
}

/// Per camera how much tells where it stands: its sights, and of bodies the instants at which another camera saw the body, too.
fn counts(half: &Problem) -> Vec<usize> {
    let mut counts = vec![0; half.cameras.len()];
    let Path::Bodies(bodies) = &half.path else {
        for it in &half.observations {
            counts[it.camera] += 1;
        }
        return counts;
    };
    let mut seen_by: BTreeMap<usize, BTreeSet<usize>> = BTreeMap::new();
    for it in &half.observations {
        let moment = bodies.moment(it.point);
        seen_by.entry(moment).or_default().insert(it.camera);
    }
    for camera in seen_by.values().filter(|own| own.len() > 1).flatten() {
        counts[*camera] += 1;
    }
    counts
}

/// What orders an observation in time.
fn moment(problem: &Problem, observation: &crate::adjustment::Observation) -> f64 {
    match &problem.path {
        Path::Points(_) => observation.point as f64,
        Path::Bodies(bodies) => bodies.moment(observation.point) as f64,
        Path::Curve(_) => {
            let camera = problem.cameras.get(observation.camera);
            camera.map_or(0.0, |camera| camera.state.time_s(observation.frame))
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Distortion, Intrinsics};
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn halves_that_are_turned_about_the_axis_of_the_camera_are_apart() {
        let intrinsics = Intrinsics {
            fx_px: 1100.0,
            fy_px: 1100.0,
            cx_px: 960.0,
            cy_px: 600.0,
        };
        let first = CameraState::at_origin(intrinsics, Distortion::default());
        let rolled = CameraState {
            camera_from_world: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.01),
            ..first
        };
        // Turned about the axis, what is seen in the middle stays there.
        let about = |x: f64, y: f64| vec![([960.0 + x, 600.0 + y], 8.0); 20];
        let (px, across) = drawn_apart(&first, &rolled, &about(400.0, 300.0));
        assert!((px - 0.01 * 500.0).abs() < 0.01, "{px}");
        assert!((across - px * 8.0 / 1100.0).abs() < 1e-9, "{across}");
        assert!(drawn_apart(&first, &rolled, &about(0.0, 0.0)).0 < 1e-9);
        assert!(drawn_apart(&first, &first, &about(400.0, 300.0)).0 < 1e-9);
        assert!(drawn_apart(&first, &first, &[]).0.is_nan());
    }
}
