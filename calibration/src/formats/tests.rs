//! Round trips through every format, and common mistakes in files.

use std::fmt::Write as _;

use farfield_proto::camera::{Distortion, Intrinsics};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;

pub(super) fn file(path: &str, text: impl Into<String>) -> TextFile {
    TextFile {
        path: path.into(),
        text: text.into(),
    }
}

fn import_text(path: &str, text: &str) -> Result<Imported, FileError> {
    import(&[file(path, text)], &ImportOptions::default())
}

/// A camera at `center` that looks at the origin; `up` is the world's.
fn looking(name: &str, center: [f64; 3], up: Vector3<f64>, lens: LensModel) -> CameraRecord {
    let eye = Point3::from(Vector3::from(center));
    let view = Isometry3::look_at_rh(&eye, &Point3::origin(), &up);
    // nalgebra looks along -z with y up.
    let flip = Isometry3::from_parts(
        Translation3::identity(),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
    );
    CameraRecord {
        name: name.to_owned(),
        size_px: [1920, 1080],
        intrinsics: Intrinsics {
            fx_px: 1500.0,
            fy_px: 1500.0,
            cx_px: 959.5,
            cy_px: 539.5,
        },
        lens,
        camera_from_world: Some(flip * view),
    }
}

pub(super) fn ring(up: Vector3<f64>, lens: LensModel) -> Vec<CameraRecord> {
    let corners = [
        [4.0, 3.0, 2.5],
        [-4.0, 3.5, 2.0],
        [-3.0, -4.0, 2.2],
        [3.5, -3.0, 3.0],
    ];
    let turned = |c: [f64; 3]| {
        let turn =
            Rotation3::rotation_between(&Vector3::z(), &up).unwrap_or_else(Rotation3::identity);
        (turn * Vector3::from(c)).into()
    };
    corners
        .iter()
        .enumerate()
        .map(|(i, c)| looking(&format!("cam{i}"), turned(*c), up, lens))
        .collect()
}

fn any_camera(fisheye: bool) -> impl Strategy<Value = CameraRecord> {
    (
        prop::array::uniform3(-20.0f64..20.0),
        prop::array::uniform3(-3.0f64..3.0),
        prop::array::uniform4(500.0f64..2500.0),
        prop::array::uniform5(-0.3f64..0.3),
        [2u32..5000, 2u32..5000],
    )
        .prop_map(move |(t, r, f, k, size_px)| CameraRecord {
            name: "north_1".to_owned(),
            size_px,
            intrinsics: Intrinsics {
                fx_px: f[0],
                fy_px: f[1],
                cx_px: f[2],
                cy_px: f[3],
            },
            lens: if fisheye {
                LensModel::KannalaBrandt([k[0], k[1], k[2], k[3]])
            } else {
                LensModel::Rational(Distortion {
                    k1: k[0].signum() * k[0].abs().max(0.001),
                    k2: k[1],
                    p1: k[2] * 0.01,
                    p2: k[3] * 0.01,
                    k3: k[4],
                    ..Distortion::default()
                })
            },
            camera_from_world: Some(Isometry3::new(t.into(), r.into())),
        })
}

/// The camera with the part of its lens that the format supports.
fn fitting(mut camera: CameraRecord, format: Format) -> CameraRecord {
    if let LensModel::Rational(d) = &mut camera.lens {
        match format {
            Format::Kalibr => d.k3 = 0.0,
            Format::Vicon => (d.p1, d.p2) = (0.0, 0.0),
            _ => {}
        }
    }
    camera
}

fn check_round_trip(camera: &CameraRecord, format: Format) -> Result<(), TestCaseError> {
    let camera = fitting(camera.clone(), format);
    let files = export(std::slice::from_ref(&camera), format)
        .map_err(|e| TestCaseError::fail(e.to_string()))?;
    let options = ImportOptions {
        format: Some(format),
        ..ImportOptions::default()
    };
    let back = import(&files, &options).map_err(|e| TestCaseError::fail(e.to_string()))?;
    let [read] = back.cameras.as_slice() else {
        return Err(TestCaseError::fail("one camera"));
    };
    prop_assert_eq!(read.size_px, camera.size_px);
    prop_assert_eq!(read.lens.is_fisheye(), camera.lens.is_fisheye());
    for (a, b) in read
        .lens
        .coefficients()
        .iter()
        .zip(camera.lens.coefficients())
    {
        prop_assert!((a - b).abs() < 1e-15, "{a} {b}");
    }
    let both = |i: &Intrinsics| [i.fx_px, i.fy_px, i.cx_px, i.cy_px];
    for (a, b) in both(&read.intrinsics)
        .into_iter()
        .zip(both(&camera.intrinsics))
    {
        prop_assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
    let (Some(a), Some(b)) = (read.camera_from_world, camera.camera_from_world) else {
        return Err(TestCaseError::fail("a pose"));
    };
    // Kalibr uses the first camera as the world.
    if format != Format::Kalibr {
        let off = (a.to_homogeneous() - b.to_homogeneous()).abs().max();
        prop_assert!(off < 1e-9, "{off}");
    }
    Ok(())
}

proptest! {
    #[test]
    fn a_camera_comes_back_from_every_format(camera in any_camera(false)) {
        for format in Format::ALL {
            check_round_trip(&camera, format)?;
        }
    }

    #[test]
    fn a_fisheye_comes_back_from_every_format_that_has_one(camera in any_camera(true)) {
        use Format as F;
        for format in [F::Farfield, F::FreeMoCap, F::Caliscope, F::OpenCvYaml, F::OpenCvJson, F::Colmap, F::Kalibr] {
            check_round_trip(&camera, format)?;
        }
        for format in [F::Qualisys, F::Theia, F::EasyMocap, F::Vicon] {
            let refused = matches!(export(std::slice::from_ref(&camera), format), Err(ExportError::Lens { .. }));
            prop_assert!(refused, "{}", format);
        }
    }

    #[test]
    fn no_text_makes_a_reader_panic(text in "[\\[\\]{}:,.!%<>/=a-zA-Z0-9_\" \n-]{0,200}", format in 0usize..11) {
        let options = ImportOptions { format: Some(Format::ALL[format]), ..ImportOptions::default() };
        _ = import(&[file("x", text.clone())], &options);
        _ = import(&[file("x", text)], &ImportOptions::default());
    }
}

#[test]
fn formats_are_recognised_by_content_and_a_good_ring_causes_no_warning() {
    let cameras = ring(Vector3::z(), LensModel::ideal());
    for format in Format::ALL {
        let files = export(&cameras, format).expect("these cameras fit every format");
        let found = import(&files, &ImportOptions::default()).expect("what was written is read");
        let same = match format {
            // The same file in millimetres.
            Format::FreeMoCap => Format::Farfield,
            other => other,
        };
        assert_eq!(found.format, same);
        let doubtful = found
            .remarks
            .iter()
            .filter(|remark| remark.kind == RemarkKind::Doubtful);
        let expected = usize::from(format == Format::Kalibr);
        assert_eq!(doubtful.count(), expected, "{format}: {:?}", found.remarks);
        if format == Format::Kalibr {
            continue;
        }
        for (read, written) in found.cameras.iter().zip(&cameras) {
            let both = [read, written].map(|c| c.camera_from_world.map(|p| p.to_homogeneous()));
            let [Some(a), Some(b)] = both else {
                panic!("a pose")
            };
            assert!((a - b).abs().max() < 1e-9, "{format}");
        }
    }
}

#[test]
fn millimetres_in_a_file_of_metres_are_corrected_with_a_remark() {
    let files =
        export(&ring(Vector3::z(), LensModel::ideal()), Format::FreeMoCap).expect("written");
    let found = import(&files, &ImportOptions::default()).expect("read");
    let is_reported = found
        .remarks
        .iter()
        .any(|r| r.kind == RemarkKind::Corrected && r.text.contains("millimetres"));
    assert!(is_reported, "{:?}", found.remarks);
    let center = found.cameras[0]
        .camera_from_world
        .map(|p| p.inverse().translation.vector.norm());
    assert!(
        center.is_some_and(|c| (c - 5.59).abs() < 0.01),
        "{center:?}"
    );
}

#[test]
fn a_world_with_y_up_is_reported_and_rotated_on_request() {
    let files = export(&ring(Vector3::y(), LensModel::ideal()), Format::Farfield).expect("written");
    let found = import(&files, &ImportOptions::default()).expect("read");
    let is_reported = found
        .remarks
        .iter()
        .any(|r| r.kind == RemarkKind::Doubtful && r.text.contains("y is up there"));
    assert!(is_reported, "{:?}", found.remarks);
    let only_lenses = ImportOptions {
        only_lenses: true,
        ..ImportOptions::default()
    };
    let lenses = import(&files, &only_lenses).expect("read");
    assert!(
        lenses.remarks.is_empty(),
        "a lens has no place: {:?}",
        lenses.remarks
    );
    let options = ImportOptions {
        up: Some(WorldAxis::Y),
        ..ImportOptions::default()
    };
    let turned = import(&files, &options).expect("read");
    assert_eq!(turned.remarks, Vec::new());
    let heights = turned
        .cameras
        .iter()
        .filter_map(|c| Some(c.camera_from_world?.inverse().translation.z));
    let heights: Vec<f64> = heights.collect();
    for (height, expected) in heights.iter().zip([2.5, 2.0, 2.2, 3.0]) {
        assert!((height - expected).abs() < 1e-9, "{heights:?}");
    }
}

/// Texts of the warnings about `cameras`, written in `format` and read with `options`.
fn warnings(cameras: &[CameraRecord], format: Format, options: &ImportOptions) -> String {
    let files = export(cameras, format).expect("written");
    let found = import(&files, options).expect("read");
    let doubtful = found.remarks.into_iter();
    let doubtful = doubtful.filter(|remark| remark.kind == RemarkKind::Doubtful);
    let texts: Vec<String> = doubtful.map(|remark| remark.text).collect();
    texts.join("\n")
}

#[test]
fn a_stated_axis_that_the_pictures_contradict_causes_a_warning() {
    let up = |axis| ImportOptions {
        up: Some(axis),
        ..ImportOptions::default()
    };
    let z_up = ring(Vector3::z(), LensModel::ideal());
    let text = warnings(&z_up, Format::Farfield, &up(WorldAxis::Y));
    assert!(text.contains("option `up` states y"), "{text}");
    assert!(text.contains("leave the option out"), "{text}");
    assert_eq!(warnings(&z_up, Format::Farfield, &up(WorldAxis::Z)), "");
    let mut y_up = ring(Vector3::y(), LensModel::ideal());
    let text = warnings(&y_up, Format::Farfield, &up(WorldAxis::MinusY));
    assert!(text.contains("give the option as y"), "{text}");
    // With the right axis, cameras under the floor cause a warning as they do without one.
    for camera in &mut y_up {
        let down = Isometry3::translation(0.0, 10.0, 0.0);
        camera.camera_from_world = camera.camera_from_world.map(|pose| pose * down);
    }
    let text = warnings(&y_up, Format::Farfield, &up(WorldAxis::Y));
    assert!(text.contains("all cameras stand below 0"), "{text}");
}

#[test]
fn a_stated_unit_is_checked_against_the_distances_of_the_cameras() {
    let cameras = ring(Vector3::z(), LensModel::ideal());
    // The cameras are 9.9 m apart, written as millimetres.
    for (metres_per_unit, expected) in [
        (1.0, "farther than the 500 m that a run takes"),
        (1e-6, "nearer than cameras stand"),
    ] {
        let options = ImportOptions {
            metres_per_unit: Some(metres_per_unit),
            ..ImportOptions::default()
        };
        let text = warnings(&cameras, Format::FreeMoCap, &options);
        assert!(text.contains(expected), "{metres_per_unit}: {text}");
        assert!(
            text.contains(&format!("with {metres_per_unit} metres per unit")),
            "{text}"
        );
    }
    // True size, and the size of a stadium.
    for metres_per_unit in [1e-3, 0.01] {
        let options = ImportOptions {
            metres_per_unit: Some(metres_per_unit),
            ..ImportOptions::default()
        };
        assert_eq!(warnings(&cameras, Format::FreeMoCap, &options), "");
    }
}

#[test]
fn every_axis_can_be_up() {
    for up in WorldAxis::ALL {
        let turn = super::axes::turn_up(up);
        assert!((turn.determinant() - 1.0).abs() < 1e-12, "{}", up.name());
        let vector = turn * Vector3::z();
        assert_eq!(super::axes::WorldAxis::from_name(up.name()), Some(up));
        assert!((vector - up.vector()).norm() < 1e-12, "{}", up.name());
    }
}

/// `ring` with its world mirrored along z, as Caliscope's TOML.
fn left_handed() -> String {
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    let mut text = String::new();
    for (i, camera) in ring(Vector3::z(), LensModel::ideal()).iter().enumerate() {
        let pose = camera.camera_from_world.expect("placed");
        let r = pose.rotation.to_rotation_matrix().into_inner() * flip;
        let rows: Vec<[f64; 3]> = (0..3).map(|i| [r[(i, 0)], r[(i, 1)], r[(i, 2)]]).collect();
        let t: [f64; 3] = pose.translation.vector.into();
        _ = write!(
            text,
            "[cam_{i}]\nsize = [1920, 1080]\nmatrix = [[1500.0, 0, 959.5], [0, 1500.0, 539.5], [0, 0, 1]]\n\
             distortions = [0, 0, 0, 0, 0]\nrotation = {rows:?}\ntranslation = {t:?}\n"
        );
    }
    text
}

#[test]
fn a_left_handed_world_is_refused_until_an_axis_is_stated() {
    let text = left_handed();
    let error = import_text("left.toml", &text).expect_err("mirrored");
    assert!(error.problem.contains("left-handed"), "{error}");
    let options = ImportOptions {
        mirrored: Some(WorldAxis::Z),
        ..ImportOptions::default()
    };
    let found = import(&[file("left.toml", text)], &options).expect("the axis is stated");
    for (read, written) in found
        .cameras
        .iter()
        .zip(ring(Vector3::z(), LensModel::ideal()))
    {
        let both = [read.camera_from_world, written.camera_from_world];
        let [Some(a), Some(b)] = both.map(|p| p.map(|p| p.to_homogeneous())) else {
            panic!("a pose")
        };
        assert!((a - b).abs().max() < 1e-9);
    }
    let right = export(&ring(Vector3::z(), LensModel::ideal()), Format::Farfield).expect("written");
    let error = import(&right, &options).expect_err("nothing is mirrored");
    assert!(error.problem.contains("right-handed"), "{error}");
}

#[test]
fn inverse_poses_and_opengl_axes_are_distinguished() {
    let cameras = ring(Vector3::z(), LensModel::ideal());
    let flip = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    for (change, expected) in [
        (0, "camera to world: option `pose`"),
        (1, "OpenGL): option `camera_axes`"),
    ] {
        let changed: Vec<CameraRecord> = cameras
            .iter()
            .map(|camera| {
                let pose = camera.camera_from_world.expect("placed");
                let pose = if change == 0 {
                    pose.inverse()
                } else {
                    flip * pose
                };
                CameraRecord {
                    camera_from_world: Some(pose),
                    ..camera.clone()
                }
            })
            .collect();
        let files = export(&changed, Format::Farfield).expect("written");
        let found = import(&files, &ImportOptions::default()).expect("read");
        assert!(
            found.remarks.iter().any(|r| r.text.contains(expected)),
            "{:?}",
            found.remarks
        );
    }
}

#[test]
fn cameras_that_all_stand_under_the_floor_cause_a_warning() {
    let mut cameras = ring(Vector3::z(), LensModel::ideal());
    for camera in &mut cameras {
        let down = Isometry3::translation(0.0, 0.0, 10.0);
        camera.camera_from_world = camera.camera_from_world.map(|pose| pose * down);
    }
    let files = export(&cameras, Format::Farfield).expect("written");
    let found = import(&files, &ImportOptions::default()).expect("read");
    assert!(
        found.remarks.iter().any(|r| r.text.contains("mirrored")),
        "{:?}",
        found.remarks
    );
}

#[test]
fn a_negative_focal_length_projects_alike_with_reversed_axes() {
    let text = "[a]\nsize = [640, 480]\nmatrix = [[-600.0, 0, 320], [0, -600.0, 240], [0, 0, 1]]\ndistortions = [0.1, 0, 0.01, 0.02, 0]\n\
                rotation = [0.1, 0.2, 0.3]\ntranslation = [0.1, 0.2, 4.0]\n";
    let found = import_text("a.toml", text).expect("read");
    let camera = &found.cameras[0];
    assert!((camera.intrinsics.fx_px - 600.0).abs() < 1e-12);
    let pose = camera.camera_from_world.expect("placed");
    let LensModel::Rational(d) = camera.lens else {
        panic!("a pinhole")
    };
    let x = pose * Point3::new(0.3, -0.2, 0.5);
    let original = Isometry3::new(Vector3::new(0.1, 0.2, 4.0), Vector3::new(0.1, 0.2, 0.3))
        * Point3::new(0.3, -0.2, 0.5);
    let draw = |p: Point3<f64>, f: f64, p1: f64, p2: f64| {
        let (x, y) = (p.x / p.z, p.y / p.z);
        let r2 = x * x + y * y;
        let g = 1.0 + 0.1 * r2;
        (
            f * (x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)) + 320.0,
            f * (y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y) + 240.0,
        )
    };
    let (a, b) = (
        draw(original, -600.0, 0.01, 0.02),
        draw(x, 600.0, d.p1, d.p2),
    );
    assert!(
        (a.0 - b.0).abs() < 1e-9 && (a.1 - b.1).abs() < 1e-9,
        "{a:?} {b:?}"
    );
}

#[test]
fn unknown_formats_are_refused_with_the_list_of_formats() {
    let error = import_text("notes.txt", "Dear diary, today").expect_err("no calibration");
    assert!(error.problem.contains("kalibr"), "{error}");
    let error = import_text("a.xml", "<svg/>").expect_err("other XML");
    assert!(error.problem.contains("Vicon"), "{error}");
    let error = import_text("a.toml", "name = 3\n").expect_err("no camera");
    assert!(error.problem.contains("no camera"), "{error}");
}

#[test]
fn a_camera_without_a_pose_is_named_in_the_error() {
    let mut camera = looking("east", [4.0, 0.0, 2.0], Vector3::z(), LensModel::ideal());
    camera.camera_from_world = None;
    assert!(export(std::slice::from_ref(&camera), Format::OpenCvYaml).is_ok());
    let error = export(&[camera], Format::Farfield).expect_err("no pose");
    assert!(
        matches!(&error, ExportError::NoPose { camera, .. } if camera == "east"),
        "{error}"
    );
}
