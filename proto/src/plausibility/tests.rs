//! A valid hall, and variants with one mistake each.

mod lens;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::*;
use crate::camera::{Distortion, Intrinsics, LensModel};
use crate::frames::Transform;
use crate::tick::Tick;
use crate::venue::GivenPerson;

/// A camera as a calibration describes it.
#[derive(Clone)]
struct Given {
    /// Position, metres.
    center_m: Vector3<f64>,
    /// World to camera.
    rotation: Matrix3<f64>,
    intrinsics: Intrinsics,
    distortion: Distortion,
    /// Replaces `distortion`: k1 to k4.
    fisheye: Option<[f64; 4]>,
    size_px: [u32; 2],
}

/// The rotation from the world's axes to those of an upright camera at `center_m` that looks at
/// `at_m`.
fn looking(center_m: Vector3<f64>, at_m: Vector3<f64>) -> Matrix3<f64> {
    let forward = (at_m - center_m).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()])
}

/// Four cameras in the corners of a hall of 12 x 8 m that look at its middle.
fn hall() -> Vec<Given> {
    let corners = [(6.0, 4.0), (-6.0, 4.0), (-6.0, -4.0), (6.0, -4.0)];
    let given = |(x, y): (f64, f64)| {
        let center_m = Vector3::new(x, y, 2.5);
        Given {
            center_m,
            rotation: looking(center_m, Vector3::new(0.0, 0.0, 1.0)),
            intrinsics: Intrinsics {
                fx_px: 1000.0,
                fy_px: 1000.0,
                cx_px: 639.5,
                cy_px: 359.5,
            },
            distortion: Distortion {
                k1: -0.08,
                k2: 0.02,
                ..Distortion::default()
            },
            fisheye: None,
            size_px: [1280, 720],
        }
    };
    corners.map(given).to_vec()
}

fn venue(cameras: &[Given], viewpoints: usize) -> Venue {
    let mut text =
        "name = \"hall\"\nrate_hz = 60.0\ncalibration = \"c.toml\"\n[field]\nmin_m = [-5.0, -3.0, -0.3]\nmax_m = [5.0, 3.0, 2.6]\n"
            .to_owned();
    let mut models = BTreeMap::new();
    for (i, given) in cameras.iter().enumerate() {
        if i < viewpoints {
            write!(text, "[[viewpoint]]\nname = \"v{i}\"\n").unwrap();
        }
        write!(
            text,
            "[[viewpoint.camera]]\nname = \"c{i}\"\nsource = {{ kind = \"keypoints\", path = \"{i}.jsonl\" }}\n"
        )
        .unwrap();
        let rotation =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(given.rotation));
        let translation = Translation3::from(-(given.rotation * given.center_m));
        let model = CameraModel::new(
            format!("c{i}"),
            given.size_px,
            given.intrinsics,
            given
                .fisheye
                .map_or(given.distortion.into(), LensModel::KannalaBrandt),
            Transform::new(Isometry3::from_parts(translation, rotation)),
        );
        models.insert(format!("c{i}"), model.unwrap());
    }
    let calibration = Calibration {
        cameras: models,
        hash: String::new(),
        rotation_lengths_rad: std::collections::BTreeMap::new(),
    };
    Venue::parse(&text, Path::new("hall.toml"), calibration).unwrap()
}

fn findings(cameras: &[Given]) -> Vec<Finding> {
    of_venue(&venue(cameras, cameras.len()))
}

/// Turns the whole world: a point p moves to `turn` p.
fn turned(turn: Matrix3<f64>) -> Vec<Given> {
    let mut cameras = hall();
    for camera in &mut cameras {
        camera.center_m = turn * camera.center_m;
        camera.rotation *= turn.transpose();
    }
    cameras
}

/// The hall with a change to its second camera.
fn with(change: impl FnOnce(&mut Given)) -> Vec<Given> {
    let mut cameras = hall();
    change(&mut cameras[1]);
    cameras
}

/// Turns the camera's picture about its axis.
fn roll(camera: &mut Given, angle_deg: f64) {
    let about_axis = Rotation3::from_axis_angle(&Vector3::z_axis(), angle_deg.to_radians());
    camera.rotation = about_axis.matrix() * camera.rotation;
}

#[test]
fn a_valid_hall_has_no_findings() {
    assert_eq!(findings(&hall()), []);
    assert!(coverage(&venue(&hall(), 4)).by_two > 0.8);
}

/// A hall and its expected finding: cause, severity, camera.
type Case = (
    &'static str,
    Vec<Given>,
    (Cause, Severity, Option<&'static str>),
);

/// Checks that each of `cases` has its cause and its camera.
fn check(cases: Vec<Case>) {
    let mut faults = Vec::new();
    for (what, cameras, expected) in cases {
        let findings = findings(&cameras);
        let mut named = findings
            .iter()
            .map(|it| (it.cause, it.severity, it.camera.as_deref()));
        if !named.any(|it| it == expected) {
            let lines: Vec<String> = findings
                .iter()
                .map(|it| format!("{:?} {it}", it.severity))
                .collect();
            faults.push(format!("{what}: expected {expected:?}, got {lines:#?}"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

/// The hall with every camera changed.
fn with_all(change: impl Fn(&mut Given)) -> Vec<Given> {
    let mut cameras = hall();
    cameras.iter_mut().for_each(change);
    cameras
}

/// The hall with its second camera at the place of the first.
fn with_copy(change: impl FnOnce(&mut Given)) -> Vec<Given> {
    let mut cameras = hall();
    cameras[1] = cameras[0].clone();
    change(&mut cameras[1]);
    cameras
}

const ONE: Option<&str> = Some("c1");

#[test]
fn a_world_with_another_axis_up_is_reported() {
    let turn = |rows: [f64; 9]| turned(Matrix3::from_row_slice(&rows));
    let wrong = (Cause::WorldAxes, Severity::Wrong, None);
    let inverse = |camera: &mut Given| {
        camera.center_m = -(camera.rotation * camera.center_m);
        camera.rotation.transpose_mut();
    };
    check(vec![
        (
            "z down",
            turn([1., 0., 0., 0., -1., 0., 0., 0., -1.]),
            wrong,
        ),
        ("y up", turn([1., 0., 0., 0., 0., 1., 0., -1., 0.]), wrong),
        ("y down", turn([1., 0., 0., 0., 0., -1., 0., 1., 0.]), wrong),
        ("x up", turn([0., 0., 1., 1., 0., 0., 0., 1., 0.]), wrong),
        (
            "camera to world",
            with_all(inverse),
            (Cause::Backwards, Severity::Wrong, None),
        ),
        (
            "upside down",
            with(|it| roll(it, 180.0)),
            (Cause::UpsideDown, Severity::Doubtful, ONE),
        ),
        (
            "turned by a quarter",
            with(|it| roll(it, 90.0)),
            (Cause::Sideways, Severity::Doubtful, ONE),
        ),
        (
            "all upside down",
            with_all(|it| roll(it, 180.0)),
            (Cause::UpsideDown, Severity::Doubtful, Some("c0")),
        ),
    ]);
}

#[test]
fn a_camera_at_an_impossible_place_is_reported() {
    use Severity::{Doubtful, Wrong};
    let height = |m: f64| with(|it| it.center_m.z = m);
    let away = |it: &mut Given| it.rotation = looking(it.center_m, it.center_m * 2.0);
    let elsewhere =
        |it: &mut Given| it.rotation = looking(it.center_m, Vector3::new(-3.0, 2.0, 0.0));
    let nowhere = |it: &mut Given| {
        it.center_m = Vector3::zeros();
        it.rotation = Matrix3::identity();
    };
    check(vec![
        (
            "under the floor",
            height(-1.0),
            (Cause::UnderFloor, Doubtful, ONE),
        ),
        (
            "far under the floor",
            height(-9.0),
            (Cause::UnderFloor, Wrong, ONE),
        ),
        (
            "all under the floor",
            with_all(|it| it.center_m.z = -1.0),
            (Cause::UnderFloor, Wrong, Some("c0")),
        ),
        ("on a tower", height(70.0), (Cause::Height, Doubtful, ONE)),
        ("in the sky", height(250.0), (Cause::Height, Wrong, ONE)),
        ("on the floor", height(0.05), (Cause::Height, Doubtful, ONE)),
        (
            "squares of a board",
            with_all(|it| it.center_m *= 0.02),
            (Cause::Units, Doubtful, None),
        ),
        (
            "kilometres",
            with_all(|it| it.center_m *= 0.001),
            (Cause::Units, Wrong, None),
        ),
        (
            "centimetres",
            with_all(|it| it.center_m *= 26.0),
            (Cause::Units, Doubtful, None),
        ),
        (
            "a table copied",
            with_copy(|_| ()),
            (Cause::SamePlace, Wrong, ONE),
        ),
        (
            "never calibrated",
            with_all(nowhere),
            (Cause::SamePlace, Wrong, ONE),
        ),
        (
            "one place, turned elsewhere",
            with_copy(elsewhere),
            (Cause::SamePlace, Doubtful, ONE),
        ),
        (
            "looks at the wall",
            with(away),
            (Cause::LooksAway, Doubtful, ONE),
        ),
        (
            "all look at the wall",
            with_all(away),
            (Cause::FieldUnseen, Wrong, None),
        ),
    ]);
}

#[test]
fn wrong_findings_come_before_suspect_ones() {
    let mut cameras = hall();
    roll(&mut cameras[0], 180.0);
    cameras[3].distortion.k1 = 5.0;
    let findings = findings(&cameras);
    let causes: Vec<Cause> = findings.iter().map(|it| it.cause).collect();
    assert_eq!(causes, [Cause::Distortion, Cause::UpsideDown]);
}

#[test]
fn cameras_that_disagree_on_up_give_one_finding() {
    let mut cameras = hall();
    for (camera, angle_deg) in cameras.iter_mut().zip([180.0, 90.0, -90.0, 0.0]) {
        roll(camera, angle_deg);
    }
    let findings = findings(&cameras);
    assert_eq!(findings.len(), 1, "{findings:?}");
    assert!(
        findings[0]
            .to_string()
            .contains("do not agree on which way is up: 1 of 4")
    );
}

#[test]
fn a_single_viewpoint_is_wrong_or_suspect_with_given_people() {
    let mut alone = venue(&hall(), 1);
    let finding = |venue: &Venue| {
        let findings = of_venue(venue);
        assert_eq!(findings.len(), 1, "{findings:?}");
        (findings[0].cause, findings[0].severity)
    };
    assert_eq!(finding(&alone), (Cause::OneViewpoint, Severity::Wrong));
    alone.given_persons.push(GivenPerson {
        tick: Tick(0),
        keypoints_m: BTreeMap::new(),
    });
    assert_eq!(finding(&alone), (Cause::OneViewpoint, Severity::Doubtful));
}

/// The hall with its last camera in the viewpoint of the one before, `apart_m` from it.
fn with_neighbours(apart_m: f64) -> Vec<Finding> {
    let mut cameras = hall();
    cameras[3].center_m = cameras[2].center_m + Vector3::new(apart_m, 0.0, 0.0);
    cameras[3].rotation = looking(cameras[3].center_m, Vector3::new(0.0, 0.0, 1.0));
    of_venue(&venue(&cameras, 3))
}

#[test]
fn distant_cameras_in_one_viewpoint_are_suspect() {
    for (apart_m, distance) in [(12.0, "12.0 m"), (3.2, "3.2 m")] {
        let findings = with_neighbours(apart_m);
        assert_eq!(findings.len(), 1, "{findings:?}");
        assert_eq!(findings[0].cause, Cause::ViewpointApart);
        assert_eq!(findings[0].severity, Severity::Doubtful);
        let text = findings[0].to_string();
        for words in [
            "camera `c3`",
            distance,
            "from `c2`",
            "a viewpoint is one corner",
            "[[viewpoint]]",
        ] {
            assert!(text.contains(words), "{words}: {text}");
        }
    }
}

#[test]
fn close_cameras_in_one_viewpoint_have_no_findings() {
    for apart_m in [0.1, 1.0, 2.8] {
        assert_eq!(with_neighbours(apart_m), [], "{apart_m}");
    }
}

#[test]
fn the_most_distant_cameras_of_a_viewpoint_are_reported_once() {
    let findings = of_venue(&venue(&hall(), 2));
    assert_eq!(findings.len(), 1, "{findings:?}");
    let text = findings[0].to_string();
    assert!(
        text.contains("camera `c3`: it stands 14.4 m from `c1`"),
        "{text}"
    );
}

#[test]
fn cameras_on_one_mast_and_overhead_have_no_findings() {
    let mut cameras = hall();
    let mut twin = cameras[3].clone();
    twin.rotation = looking(twin.center_m, Vector3::new(-3.0, 2.0, 0.0));
    let mut overhead = cameras[0].clone();
    overhead.center_m = Vector3::new(0.0, 0.0, 9.0);
    overhead.rotation = looking(overhead.center_m, Vector3::new(0.01, 0.0, 0.0));
    cameras.insert(0, overhead);
    cameras.push(twin);
    // The last two are of one viewpoint.
    assert_eq!(of_venue(&venue(&cameras, 5)), []);
}

#[test]
fn a_copied_camera_is_suspect_but_twins_on_a_mast_are_not() {
    let mut cameras = hall();
    cameras.push(cameras[3].clone());
    let copied = of_venue(&venue(&cameras, 4));
    assert_eq!(copied.len(), 1, "{copied:?}");
    assert_eq!(
        (copied[0].cause, copied[0].severity),
        (Cause::SamePlace, Severity::Doubtful)
    );
    cameras[4].center_m.x += 0.004;
    assert_eq!(of_venue(&venue(&cameras, 4)), []);
}

#[test]
fn anamorphic_pixels_of_a_video_format_are_accepted() {
    let hdv = with(|it| {
        it.size_px = [1440, 1080];
        it.intrinsics = Intrinsics {
            fx_px: 1177.0,
            fy_px: 1573.0,
            cx_px: 703.0,
            cy_px: 532.0,
        };
    });
    assert_eq!(findings(&hdv), []);
}

#[test]
fn long_rotations_are_suspect() {
    let calibration = Calibration {
        cameras: std::collections::BTreeMap::new(),
        hash: String::new(),
        rotation_lengths_rad: [("a".to_owned(), 3.1), ("b".to_owned(), 5.2)].into(),
    };
    let lines: Vec<String> = of_rotations(&calibration)
        .iter()
        .map(Finding::to_string)
        .collect();
    assert_eq!(
        lines,
        [
            "camera `b`: `rotation` is a vector of length 5.20, expected radians, at most 3.14; if these are degrees, multiply them by 0.017453"
        ]
    );
}

#[test]
fn pictures_of_another_size_get_a_matching_remedy() {
    let venue = venue(&hall(), 4);
    let remedy = |found_px| of_picture_size(&venue.cameras[0].model, found_px).map(|it| it.remedy);
    assert_eq!(remedy([1280, 720]), None);
    assert!(
        remedy([720, 1280])
            .unwrap()
            .contains("turned by 90 degrees")
    );
    assert!(remedy([1920, 1080]).unwrap().contains("by 1.500000"));
    assert!(remedy([1280, 960]).unwrap().contains("cropped"));
}

/// The hall with a fisheye of `focal_px` in one corner.
fn with_fisheye(focal_px: f64, k: [f64; 4]) -> Vec<Given> {
    let mut cameras = hall();
    cameras[1].fisheye = Some(k);
    (cameras[1].intrinsics.fx_px, cameras[1].intrinsics.fy_px) = (focal_px, focal_px);
    cameras
}

#[test]
fn a_fisheye_in_a_corner_has_no_findings() {
    // 183 degrees across, of which the middle is used.
    let cameras = with_fisheye(400.0, [-0.02, 0.005, -0.002, 0.0003]);
    assert_eq!(findings(&cameras), []);
    let venue = venue(&cameras, 4);
    let shares: Vec<f64> = venue
        .cameras
        .iter()
        .map(|camera| used_share(&camera.model))
        .collect();
    assert!(shares[0] > 0.999 && shares[2] > 0.999 && shares[3] > 0.999);
    // A disc of radius f theta_d, cut by the picture's upper and lower edge.
    assert!((0.5..0.6).contains(&shares[1]), "{}", shares[1]);
}

#[test]
fn fisheyes_with_implausible_distortion_are_reported() {
    let plain = with_fisheye(2000.0, [0.0; 4]);
    let causes = |cameras: &[Given]| -> Vec<_> {
        let findings = findings(cameras);
        findings.iter().map(|it| (it.cause, it.severity)).collect()
    };
    assert!(causes(&plain).contains(&(Cause::FieldOfView, Severity::Doubtful)));
    let stretched = with_fisheye(400.0, [0.6, 0.2, 0.0, 0.0]);
    assert!(causes(&stretched).contains(&(Cause::Distortion, Severity::Doubtful)));
}

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

/// The findings for the hall with a field from `min_m` to `max_m` without a floor.
fn with_field(min_m: [f64; 3], max_m: [f64; 3]) -> Vec<Finding> {
    let mut venue = venue(&hall(), 4);
    (venue.field.min_m, venue.field.max_m) = (min_m, max_m);
    venue.field.floor_m = 0.0_f64.clamp(min_m[2], max_m[2]);
    let findings = of_venue(&venue).into_iter();
    findings.filter(|it| it.cause == Cause::FieldSize).collect()
}

#[test]
fn a_field_too_low_for_standing_people_is_suspect() {
    let cases = [
        // Below the floor, a typing mistake, as high as hips, above heads.
        ([-3.3, -1.0], "0.00 m above its floor (z = -1.00 m)"),
        (
            [-0.3, 0.25],
            "0.25 m above its floor (z = 0.00 m), at max_m[2] = 0.25 m",
        ),
        ([-0.3, 1.0], "1.00 m above its floor"),
        ([1.5, 2.4], "0.90 m above its floor (z = 1.50 m)"),
    ];
    for ([low_m, high_m], words) in cases {
        let found = with_field([-5.0, -3.0, low_m], [5.0, 3.0, high_m]);
        assert_eq!(found.len(), 1, "{low_m} {high_m}: {found:?}");
        assert_eq!(found[0].severity, Severity::Doubtful, "{found:?}");
        assert!(found[0].found.contains(words), "{found:?}");
        assert!(found[0].remedy.contains("floor_m"), "{found:?}");
    }
}

#[test]
fn a_field_in_millimetres_and_a_narrow_one_are_suspect() {
    let wide = with_field([-4000.0, -3000.0, -300.0], [4000.0, 3000.0, 2400.0]);
    assert_eq!(wide.len(), 1, "{wide:?}");
    assert!(wide[0].found.contains("8000 m by 6000 m"), "{wide:?}");
    assert!(wide[0].remedy.contains("millimetres by 0.001"), "{wide:?}");
    let narrow = with_field([-0.15, -3.0, -0.3], [0.15, 3.0, 2.4]);
    assert_eq!(narrow.len(), 1, "{narrow:?}");
    assert!(narrow[0].found.contains("0.30 m by 6.00 m"), "{narrow:?}");
}

#[test]
fn fields_of_treadmill_stage_and_stadium_have_no_findings() {
    assert_eq!(with_field([-0.225, -1.0, -0.1], [0.225, 1.0, 2.2]), []);
    assert_eq!(with_field([-5.0, -3.0, 0.9], [5.0, 3.0, 3.5]), []);
    assert_eq!(with_field([-150.0, -110.0, -0.5], [150.0, 110.0, 2.6]), []);
}

#[test]
fn cameras_above_people_that_all_look_up_are_a_mirror_image() {
    let looking_at = |z_m: f64, height_m: f64| {
        with_all(|camera| {
            camera.center_m.z = height_m;
            let at_m = Vector3::new(0.0, 0.0, z_m);
            camera.rotation = looking(camera.center_m, at_m);
        })
    };
    let causes = |cameras: &[Given]| -> Vec<Cause> {
        findings(cameras)
            .iter()
            .map(|finding| finding.cause)
            .collect()
    };
    let mirrored = looking_at(4.0, 2.5);
    assert!(
        causes(&mirrored).contains(&Cause::LookUp),
        "{:?}",
        findings(&mirrored)
    );
    // Level on tripods, from the ground, and one that looks up among others.
    let mut one = hall();
    one[1] = mirrored[1].clone();
    for (what, cameras) in [
        ("level", looking_at(1.8, 1.6)),
        ("from the ground", looking_at(1.5, 0.3)),
        ("one", one),
    ] {
        assert!(!causes(&cameras).contains(&Cause::LookUp), "{what}");
    }
}
