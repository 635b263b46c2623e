//! Consistency over time: compares calibrations from the first and the second half of the data, and detects cameras that fit
//! only part of the time.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::order_statistics::{percentile, upper_median};

use crate::adjustment::{AdjustedCamera, Block, CameraState, Free, Limits, Path, Problem, adjust};
use crate::alignment::Similarity;

/// Least number of sights of a camera in a half. With a body they are instants, because all sights at one instant determine one
/// pose.
const LEAST_SIGHTS: usize = 15;

/// Most sights of a camera at which halves are compared.
const MOST_COMPARED: usize = 1000;
/// The reported distance is this percentile.
const NEARER: f64 = 0.95;

/// The difference between the poses of a camera in two halves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Apart {
    /// Distance of the pinholes, in the unit of the problem.
    pub(crate) distance: f64,
    /// Angle between the rotations.
    pub(crate) turned_rad: f64,
    /// The 95th percentile of the distances between the projections of the points that the camera saw, pixels. Infinite if one
    /// pose cannot project them. Parts of the picture without sights do not count.
    pub(crate) px: f64,
    /// The same at the points, across the line of sight, in the unit of the problem.
    pub(crate) across: f64,
}

/// Per camera, the pixel and depth of at most [`MOST_COMPARED`] of its sights.
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

/// Per camera, the difference between its poses in the two halves, after the second half was aligned with the first by a
/// similarity; `None` if a half has too few sights.
///
/// Lenses and clocks stay as in the whole problem: a half starts from it and adjusts only poses.
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
            // A camera with too few sights keeps its pose.
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

/// [`Apart::px`] and [`Apart::across`] of two states of a camera, for its sights (pixels, depth).
fn drawn_apart(first: &CameraState, second: &CameraState, seen: &[([f64; 2], f64)]) -> (f64, f64) {
    let folds = [first.fold_radius(), second.fold_radius()];
    let focal_px = (first.intrinsics.fx_px * first.intrinsics.fy_px).sqrt();
    let apart = |(px, depth): &([f64; 2], f64)| {
        // Pixels outside the range of the lens are ignored.
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

/// Per camera, the number of its sights; for bodies, the instants at which another camera also saw the body.
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

/// The order of an observation in time.
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

/// Number of windows with equally many sights.
const WINDOWS: usize = 20;
/// Least number of sights in a window.
const LEAST_WINDOW_SIGHTS: usize = 5;
/// Number of neighbouring bad windows that indicate a knock.
const LEAST_RUN: usize = 2;
/// A window is bad if its share of fitting sights is below this share of the median.
const BAD_SHARE: f64 = 0.5;

/// The time at which a camera was knocked, as a share of all its sights, 0 to 1. `used` states whether each sight fits, in the
/// order of time.
///
/// It is the beginning of the first run of bad windows, or its end if the run begins with the first window. There are 20
/// windows, or 10 if sights are few.
pub(crate) fn knocked_at(used: &[bool]) -> Option<f64> {
    let windows = if used.len() >= WINDOWS * 2 * LEAST_WINDOW_SIGHTS {
        WINDOWS
    } else {
        WINDOWS / 2
    };
    if used.len() < windows * LEAST_WINDOW_SIGHTS {
        return None;
    }
    let shares = (0..windows).filter_map(|k| {
        let own = used.get(k * used.len() / windows..(k + 1) * used.len() / windows)?;
        let fitting = own.iter().filter(|fits| **fits).count();
        Some(fitting as f64 / own.len().max(1) as f64)
    });
    let shares: Vec<f64> = shares.collect();
    let bar = BAD_SHARE * upper_median(shares.clone())?;
    let mut runs = shares.windows(LEAST_RUN);
    let start = runs.position(|run| run.iter().all(|share| *share < bar))?;
    let change = if start > 0 {
        start
    } else {
        shares.iter().take_while(|share| **share < bar).count()
    };
    Some(change as f64 / windows as f64)
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Distortion, Intrinsics};
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    #[test]
    fn halves_rotated_about_the_axis_of_the_camera_differ() {
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
        // A rotation about the axis does not move the middle of the picture.
        let about = |x: f64, y: f64| vec![([960.0 + x, 600.0 + y], 8.0); 20];
        let (px, across) = drawn_apart(&first, &rolled, &about(400.0, 300.0));
        assert!((px - 0.01 * 500.0).abs() < 0.01, "{px}");
        assert!((across - px * 8.0 / 1100.0).abs() < 1e-9, "{across}");
        assert!(drawn_apart(&first, &rolled, &about(0.0, 0.0)).0 < 1e-9);
        assert!(drawn_apart(&first, &first, &about(400.0, 300.0)).0 < 1e-9);
        assert!(drawn_apart(&first, &first, &[]).0.is_nan());
    }
}

#[cfg(test)]
mod knock_tests {
    use super::*;

    /// One sight in ten does not fit, and none between `from` and `to`.
    fn used(count: usize, from: f64, to: f64) -> Vec<bool> {
        let each = (0..count).map(|i| {
            let at = i as f64 / count as f64;
            i % 10 != 3 && !(from..to).contains(&at)
        });
        each.collect()
    }

    #[test]
    fn knocks_are_found_at_either_end_of_the_bad_part() {
        for (count, from, to, change) in [
            (400, 0.85, 1.0, 0.85),
            (400, 0.5, 0.6, 0.5),
            (400, 0.0, 0.2, 0.2),
            (60, 0.6, 1.0, 0.6),
        ] {
            let at = knocked_at(&used(count, from, to)).unwrap();
            assert!((at - change).abs() < 0.06, "{at} {change}");
        }
    }

    #[test]
    fn regular_outliers_and_too_few_sights_are_not_a_knock() {
        assert_eq!(knocked_at(&used(400, 2.0, 2.0)), None);
        assert_eq!(knocked_at(&used(30, 0.5, 1.0)), None);
        assert_eq!(knocked_at(&[]), None);
    }
}
