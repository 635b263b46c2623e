//! Cameras that are written as another program writes them.

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
fn the_convention_of_another_program_is_named_of_all_cameras() {
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
fn a_camera_in_the_convention_of_another_program_is_named_with_what_mends_it() {
    let said = said(&with(turned_axes));
    // That it is upside down and looks away follows, and turning its pictures would mend nothing.
    assert_eq!(said.len(), 1, "{said:?}");
    assert_eq!(
        (said[0].cause, said[0].severity),
        (Cause::CameraAxes, Severity::Doubtful)
    );
    assert_eq!(said[0].camera.as_deref(), ONE);
    assert!(
        said[0].remedy.contains("second and third row"),
        "{}",
        said[0]
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
fn a_camera_that_is_hung_upside_down_or_looks_away_is_none_of_another_program() {
    let hung = said(&with(|it| roll(it, 180.0)));
    let away = said(&with(|it| {
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
