//! Warnings about an implausible world: cameras that do not look at one place, its size, the axis that points up, the floor.
//! The checks also run if the caller stated these facts. They change nothing.

use std::f64::consts::FRAC_1_SQRT_2;

use farfield_proto::calibration::MAX_DISTANCE_M;
use nalgebra::{Matrix3, Vector3};

use super::super::camera::{RawCamera, RawPose, Remark, RemarkKind};
use super::{CameraAxes, PoseMeaning, TOO_NEAR_M, WorldAxis, reread, spread, turn_up};

/// Smallest share of the mean direction "up" for an axis to count as up: cameras look down by 60 degrees at most.
const UP_SHARE: f64 = 0.5;
/// Another axis contradicts the stated one if its share of that direction is larger by this.
const CLEARLY_MORE: f64 = 0.3;
/// Mean share of the viewing directions along "down" (45 degrees). Beyond it the upper edges of pictures point along the floor,
/// and do not contradict a stated axis.
const LOOKS_DOWN: f64 = FRAC_1_SQRT_2;

/// The point nearest to the optical axes of all cameras. `None` if all axes are parallel.
pub(super) fn meeting_place(poses: &[RawPose]) -> Option<Vector3<f64>> {
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for pose in poses {
        let forward: Vector3<f64> = pose.rotation.row(2).transpose();
        let across = Matrix3::identity() - forward * forward.transpose();
        normal += across;
        right += across * pose.center();
    }
    let eigenvalues = normal.symmetric_eigenvalues();
    if eigenvalues.min() < 0.02 * eigenvalues.max() {
        return None;
    }
    Some(normal.cholesky()?.solve(&right))
}

/// How well cameras look at one place: the share of cameras that have it in front, and the distance of their axes to it
/// relative to the mean distance. `None` if all axes are parallel.
fn convergence(poses: &[RawPose]) -> Option<(f64, f64)> {
    let place = meeting_place(poses)?;
    let n = poses.len() as f64;
    let mut in_front = 0.0;
    let mut passed = 0.0;
    let mut distance = 0.0;
    for pose in poses {
        let seen = pose.rotation * place + pose.translation;
        in_front += f64::from(u8::from(seen.z > 0.0)) / n;
        passed += seen.xy().norm_squared() / n;
        distance += seen.norm() / n;
    }
    Some((in_front, passed.sqrt() / distance.max(1e-12)))
}

/// Warns if cameras do not look at one place, and names the options under which they would.
pub(super) fn check_directions(cameras: &[RawCamera], remarks: &mut Vec<Remark>) {
    let poses: Vec<RawPose> = cameras.iter().filter_map(|camera| camera.pose).collect();
    if poses.len() < 2 {
        return;
    }
    let judge = |meaning, axes| {
        let read: Vec<RawPose> = poses
            .iter()
            .map(|pose| reread(*pose, meaning, axes))
            .collect();
        convergence(&read)
    };
    let as_written = judge(PoseMeaning::AsFormat, CameraAxes::OpenCv);
    // For parallel axes only the other interpretations can converge.
    let (in_front, passed) = as_written.unwrap_or((0.0, f64::INFINITY));
    // Beyond half the distance the axes do not meet.
    let meets = as_written.is_none() || (in_front > 0.5 && passed < 0.5);
    if in_front >= 1.0 && passed < 0.2 {
        return;
    }
    let others = [
        (
            PoseMeaning::AsFormat,
            CameraAxes::OpenGl,
            "the cameras look along -z with y up (OpenGL): option `camera_axes`",
        ),
        (
            PoseMeaning::Inverse,
            CameraAxes::OpenCv,
            "the file takes camera to world: option `pose`",
        ),
        (
            PoseMeaning::Inverse,
            CameraAxes::OpenGl,
            "the file takes camera to world and looks along -z (OpenGL): options `pose` and `camera_axes`",
        ),
    ];
    let best = others
        .into_iter()
        .filter_map(|(meaning, axes, text)| Some((judge(meaning, axes)?, text)))
        .filter(|((front, pass), _)| {
            *front >= 1.0 && *pass < 0.2 && (in_front < 1.0 || *pass < 0.5 * passed)
        })
        .min_by(|a, b| a.0.1.total_cmp(&b.0.1));
    let found = match as_written {
        Some(_) => format!(
            "{:.0} of {} cameras look away from the place where their axes come nearest, which they pass by {:.0} % of its distance",
            (1.0 - in_front) * poses.len() as f64,
            poses.len(),
            100.0 * passed
        ),
        None => "all cameras look one way".to_owned(),
    };
    let text = match best {
        Some((_, remedy)) => format!("{found}; all would look at one place if {remedy}"),
        None if meets => return,
        None => {
            format!("{found}; if they stand around a field, check the meaning of their poses")
        }
    };
    remarks.push(Remark::of_all(RemarkKind::Doubtful, text));
}

/// Warns if the `stated` unit gives a world that is impossibly large or small. A stadium is not too large.
pub(super) fn check_size(cameras: &[RawCamera], stated: f64, remarks: &mut Vec<Remark>) {
    let Some(spread_m) = spread(cameras).filter(|spread_m| *spread_m > 0.0) else {
        return;
    };
    let why = if spread_m > MAX_DISTANCE_M {
        format!("farther than the {MAX_DISTANCE_M:.0} m that a run takes")
    } else if spread_m < TOO_NEAR_M {
        "nearer than cameras stand".to_owned()
    } else {
        return;
    };
    let text = format!(
        "with {stated} metres per unit, as stated, the cameras are up to {spread_m:.3} m apart, {why}; if they are not, give \
         other metres per unit"
    );
    remarks.push(Remark::of_all(RemarkKind::Doubtful, text));
}

/// Warns if the upper edges of the pictures contradict the axis that points up. The `stated` axis of the file's world has
/// already been rotated to z; `None`: the world is the file's own.
pub(super) fn check_up(
    cameras: &[RawCamera],
    stated: Option<WorldAxis>,
    remarks: &mut Vec<Remark>,
) {
    let poses: Vec<RawPose> = cameras.iter().filter_map(|camera| camera.pose).collect();
    if poses.len() < 2 {
        return;
    }
    let mean = |row: usize| {
        let rows = poses.iter().map(|pose| pose.rotation.row(row).transpose());
        rows.sum::<Vector3<f64>>() / poses.len() as f64
    };
    // The stated axis refers to the file's axes.
    let file_from_world = stated.map_or_else(Matrix3::identity, turn_up);
    let up = file_from_world * -mean(1);
    let share = |axis: WorldAxis| up.dot(&axis.vector());
    let largest = WorldAxis::ALL
        .into_iter()
        .max_by(|a, b| share(*a).total_cmp(&share(*b)));
    let shown = largest.filter(|axis| share(*axis) >= UP_SHARE);
    let looks_down = -mean(2).z > LOOKS_DOWN;
    let is_clear = |axis, than| share(axis) > share(than) + CLEARLY_MORE && !looks_down;
    let other = match (shown, stated) {
        (None, None) => Some(UNDECIDED.to_owned()),
        (Some(axis), None) if axis != WorldAxis::Z => Some(other_axis(axis, None)),
        (Some(axis), Some(than)) if is_clear(axis, than) => Some(other_axis(axis, stated)),
        _ => None,
    };
    let is_below = poses.iter().all(|pose| pose.center().z < 0.0);
    let text = other.or_else(|| is_below.then(|| ALL_BELOW.to_owned()));
    remarks.extend(text.map(|text| Remark::of_all(RemarkKind::Doubtful, text)));
}

/// The pictures show no axis to be up, and none was stated.
const UNDECIDED: &str = "the pictures do not agree on which way is up: the world is tilted, or cameras stand on their side";

/// All cameras are below the floor.
const ALL_BELOW: &str = "z is up, but all cameras stand below 0: the floor is not where z is 0, or the board that gave the world \
                         was seen mirrored, which no reprojection error shows";

/// The pictures show another axis to be up than the one used.
fn other_axis(axis: WorldAxis, stated: Option<WorldAxis>) -> String {
    let name = axis.name();
    let Some(stated) = stated.map(WorldAxis::name) else {
        return format!(
            "the pictures' upper edges point along {name} of the world: {name} is up there, and z is here; give the option \
             `up` as {name} to turn it"
        );
    };
    let remedy = if axis == WorldAxis::Z {
        "leave the option out".to_owned()
    } else {
        format!("give the option as {name}")
    };
    format!(
        "the option `up` states {stated}, but the pictures' upper edges point along {name} of the file's world, and not along \
         {stated}; if {name} is up there, {remedy}"
    )
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Intrinsics, LensModel};

    use super::*;

    /// Three cameras in a row, 3 m above the floor, that look along y and down by `degrees`.
    fn tilted(degrees: f64) -> Vec<RawCamera> {
        let (down, along) = degrees.to_radians().sin_cos();
        // Rows: right, down, forward.
        let rotation = Matrix3::new(1.0, 0.0, 0.0, 0.0, -down, -along, 0.0, along, -down);
        let camera = |x_m: f64| RawCamera {
            name: x_m.to_string(),
            size_px: None,
            intrinsics: Intrinsics {
                fx_px: 600.0,
                fy_px: 600.0,
                cx_px: 319.5,
                cy_px: 239.5,
            },
            lens: LensModel::ideal(),
            pose: Some(RawPose::at(rotation, Vector3::new(x_m, 0.0, 3.0))),
        };
        [-1.0, 0.0, 1.0].map(camera).to_vec()
    }

    fn warnings(degrees: f64, stated: Option<WorldAxis>) -> String {
        let mut remarks = Vec::new();
        check_up(&tilted(degrees), stated, &mut remarks);
        let texts = remarks.into_iter().map(|remark| remark.text);
        texts.collect::<Vec<_>>().join("\n")
    }

    #[test]
    fn cameras_that_look_down_do_not_contradict_a_stated_axis() {
        for degrees in [0.0, 40.0, 50.0, 60.0, 90.0] {
            assert_eq!(warnings(degrees, Some(WorldAxis::Z)), "", "{degrees}");
        }
        assert!(warnings(60.0, None).contains("y is up there"));
    }

    #[test]
    fn an_axis_with_a_clearly_larger_share_contradicts_the_stated_one() {
        // -z was stated, and all upper edges point along z.
        let mut upside_down = tilted(10.0);
        for pose in upside_down.iter_mut().filter_map(|it| it.pose.as_mut()) {
            pose.rotation *= turn_up(WorldAxis::MinusZ);
        }
        let mut remarks = Vec::new();
        check_up(&upside_down, Some(WorldAxis::MinusZ), &mut remarks);
        let [only] = remarks.as_slice() else {
            panic!("{remarks:?}")
        };
        assert!(only.text.contains("leave the option out"), "{only}");
    }
}
