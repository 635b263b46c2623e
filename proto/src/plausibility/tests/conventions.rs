//! Cameras in the conventions of other programs.

use super::*;

/// World to camera, with y up and z backward.
fn turned_axes(camera: &mut Given) {
    camera.rotation = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0)) * camera.rotation;
}

/// Camera to world.
fn pose(camera: &mut Given) {
    camera.center_m = -(camera.rotation * camera.center_m);
    camera.rotation.transpose_mut();
}

fn pose_of_turned_axes(camera: &mut Given) {
    turned_axes(camera);
    pose(camera);
}

#[test]
fn another_convention_of_all_cameras_is_recognised() {
    use Severity::Wrong;
    check(vec![
        ("pose", with_all(pose), (Cause::Backwards, Wrong, None)),
        (
            "axes",
            with_all(turned_axes),
            (Cause::CameraAxes, Wrong, None),
        ),
        (
            "pose of axes",
            with_all(pose_of_turned_axes),
            (Cause::CameraAxes, Wrong, None),
        ),
    ]);
}

#[test]
fn another_convention_of_one_camera_is_recognised_with_its_remedy() {
    let found = findings(&with(turned_axes));
    // Upside down and looking away follow from it, and a turn of its pictures would not help.
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!(
        (found[0].cause, found[0].severity),
        (Cause::CameraAxes, Severity::Doubtful)
    );
    assert_eq!(found[0].camera.as_deref(), ONE);
    assert!(
        found[0].remedy.contains("second and third row"),
        "{}",
        found[0]
    );
    check(vec![
        (
            "pose",
            with(pose),
            (Cause::Backwards, Severity::Doubtful, ONE),
        ),
        (
            "pose of axes",
            with(pose_of_turned_axes),
            (Cause::CameraAxes, Severity::Doubtful, ONE),
        ),
    ]);
}

#[test]
fn a_camera_upside_down_is_not_taken_for_another_convention() {
    let hung = findings(&with(|it| roll(it, 180.0)));
    let away = findings(&with(|it| {
        it.rotation = looking(it.center_m, it.center_m * 2.0);
    }));
    assert!(!hung.is_empty() && !away.is_empty(), "{hung:?} {away:?}");
    for finding in hung.iter().chain(&away) {
        assert!(
            !matches!(finding.cause, Cause::CameraAxes | Cause::Backwards),
            "{finding}"
        );
    }
}
