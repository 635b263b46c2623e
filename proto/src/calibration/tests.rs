//! Calibration files of both formats, and the errors of invalid ones.

use super::*;

const CAMERA: &str = r#"
name = "a"
size = [1280, 720]
matrix = [[900.0, 0.0, 640.0], [0.0, 910.0, 360.0], [0.0, 0.0, 1.0]]
distortions = [-0.1, 0.02, 0.001, -0.001, 0.0]
rotation = [1.2, -0.3, 0.4]
translation = [0.5, 1.0, 3.0]
fisheye = false
"#;

fn parse(text: &str) -> Result<Calibration, FileError> {
    Calibration::parse(text, Path::new("cal.toml"))
}

/// The error for the camera with one line changed.
fn refusal(from: &str, to: &str) -> String {
    assert!(CAMERA.contains(from));
    parse(&format!("[one]{}", CAMERA.replace(from, to)))
        .unwrap_err()
        .to_string()
}

#[test]
fn one_table_per_camera_is_read() {
    let text = format!("[one]{CAMERA}error = 0.3\n[metadata]\nadjusted = true\nsize = 3\n");
    let calibration = parse(&text).unwrap();
    let camera = &calibration.cameras["a"];
    assert_eq!(camera.size_px(), [1280, 720]);
    assert!((camera.intrinsics().fy_px - 910.0).abs() < 1e-12);
    let LensModel::Rational(lens) = camera.lens() else {
        panic!("{:?}", camera.lens())
    };
    assert!((lens.p2 - -0.001).abs() < 1e-12);
    let moved = camera.camera_from_world().isometry();
    assert!((moved.rotation.scaled_axis() - Vector3::new(1.2, -0.3, 0.4)).norm() < 1e-12);
    assert_eq!(calibration.hash.len(), 16);
}

#[test]
fn both_tables_of_caliscope_are_read() {
    let camera = "cam_id = 3\nrotation_count = 0\nsize = [1280, 720]\n\
        matrix = [[900.0, 0.0, 640.0], [0.0, 910.0, 360.0], [0.0, 0.0, 1.0]]\n\
        distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\ntranslation = [0.1, 0.2, 0.3]\n\
        rotation = [[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]\n";
    let rest = "[capture_volume]\nstage = 2\n[charuco]\ncolumns = 4\n";
    for table in ["[cameras.3]", "[cam_3]"] {
        let text = format!("CreationDate = 2023-03-31T09:56:43.193358\n{table}\n{camera}{rest}");
        let calibration = parse(&text).unwrap();
        let motion = calibration.cameras["cam_3"].camera_from_world().isometry();
        let turned = motion.rotation * Vector3::x();
        assert!((turned - Vector3::new(0.0, 0.0, -1.0)).norm() < 1e-12);
    }
}

#[test]
fn errors_name_table_field_and_line() {
    assert_eq!(
        refusal("fisheye = false", "fisheye = true"),
        "cal.toml:5: `one.distortions`: found 5 values, expected 4 of a fisheye lens: k1, k2, k3, k4 of OpenCV's \
         fisheye model"
    );
    assert_eq!(
        refusal("fisheye = false", "fisheye = 1"),
        "cal.toml:8: `one.fisheye`: found integer, expected true or false"
    );
    assert_eq!(
        refusal(
            "translation = [0.5, 1.0, 3.0]",
            "translation = [0.5, nan, 3.0]"
        ),
        "cal.toml:7: `one.translation`: found NaN, expected finite numbers"
    );
    assert_eq!(
        refusal("size = [1280, 720]", "size = [1280, -720]"),
        "cal.toml:3: `one.size`: found [1280.0, -720.0], expected [width, height] in pixels above 0"
    );
    assert_eq!(
        refusal("-0.001, 0.0]", "-0.001, 0.0, 0.1]"),
        "cal.toml:5: `one.distortions`: found 6 values, expected 4, 5 or 8 in OpenCV's order"
    );
}

#[test]
fn a_rotation_in_degrees_is_refused_and_long_ones_are_recorded() {
    let message = refusal("[1.2, -0.3, 0.4]", "[96.7, 3.0, 0.4]");
    assert!(
        message.starts_with(
            "cal.toml:6: `one.rotation`: found a vector of length 96.7, expected radians"
        ),
        "{message}"
    );
    let long = CAMERA.replace("[1.2, -0.3, 0.4]", "[0.0, 4.0, 3.0]");
    let calibration = parse(&format!("[one]{long}")).unwrap();
    assert!((calibration.rotation_lengths_rad["a"] - 5.0).abs() < 1e-12);
}

#[test]
fn wrong_matrices_are_refused() {
    let singular = refusal("[0.0, 910.0, 360.0]", "[0.0, 0.0, 360.0]");
    assert!(
        singular.starts_with("cal.toml:4: `one.matrix`") && singular.contains("singular"),
        "{singular}"
    );
    let skew = refusal("[900.0, 0.0, 640.0]", "[900.0, 0.2, 640.0]");
    assert!(skew.contains("skew"), "{skew}");
    let shape = refusal("[0.0, 910.0, 360.0], ", "");
    assert!(shape.contains("expected 3 rows of 3 numbers"), "{shape}");
    let stretched = refusal(
        "rotation = [1.2, -0.3, 0.4]",
        "rotation = [[1, 0, 0], [0, 2, 0], [0, 0, 1]]",
    );
    assert!(stretched.contains("not a rotation"), "{stretched}");
    let mirrored = refusal(
        "rotation = [1.2, -0.3, 0.4]",
        "rotation = [[1, 0, 0], [0, -1, 0], [0, 0, 1]]",
    );
    assert!(mirrored.contains("not a rotation"), "{mirrored}");
}

#[test]
fn a_missing_field_is_named() {
    let missing = refusal("translation = [0.5, 1.0, 3.0]", "");
    assert_eq!(
        missing,
        "cal.toml:1: `one.translation`: the field is missing"
    );
}

#[test]
fn a_lens_that_folds_is_refused_at_its_distortions() {
    let folds = refusal("[-0.1, 0.02,", "[-2.0, 0.02,");
    assert!(
        folds.starts_with("cal.toml:5: `one.distortions`: camera `a`: its lens distortion folds"),
        "{folds}"
    );
}

#[test]
fn cameras_in_millimetres_are_refused() {
    let far = CAMERA
        .replace("\"a\"", "\"b\"")
        .replace("[0.5, 1.0, 3.0]", "[500.0, 1000.0, 3000.0]");
    let refused = parse(&format!("[one]{CAMERA}[two]{far}"))
        .unwrap_err()
        .to_string();
    assert!(refused.contains("looks like millimetres"), "{refused}");
}

#[test]
fn implausible_numbers_are_refused_with_their_field() {
    for (from, to, expected) in [
        (
            "[900.0, 0.0, 640.0]",
            "[1e300, 0.0, 640.0]",
            "4: `one.matrix`: camera `a`: `fx`: found 1e300, expected a number from 1 to 1000000 pixels",
        ),
        (
            "[0.0, 910.0, 360.0]",
            "[0.0, 0.5, 360.0]",
            "4: `one.matrix`: camera `a`: `fy`: found 0.5, expected a number from 1 to 1000000 pixels",
        ),
        (
            "[900.0, 0.0, 640.0]",
            "[900.0, 0.0, -2e6]",
            "4: `one.matrix`: camera `a`: `cx`: found -2000000.0, expected a number from -1000000 to 1000000 pixels",
        ),
        (
            "[0.5, 1.0, 3.0]",
            "[0.5, 1e300, 3.0]",
            "7: `one.translation`: camera `a`: found [0.5, 1e300, 3.0], expected metres from -100000 to 100000",
        ),
    ] {
        assert_eq!(refusal(from, to), format!("cal.toml:{expected}"));
    }
}

#[test]
fn duplicate_names_and_empty_files_are_refused() {
    let twice = parse(&format!("[one]{CAMERA}[two]{CAMERA}"))
        .unwrap_err()
        .to_string();
    assert!(
        twice.ends_with("`two.name`: a second camera is called `a`"),
        "{twice}"
    );
    assert!(
        parse("[metadata]\nsize = 3\n")
            .unwrap_err()
            .problem
            .contains("no camera")
    );
}

/// [`CAMERA`] with another lens.
fn with_lens(distortions: &str) -> Result<Calibration, FileError> {
    let text = CAMERA
        .replace("[-0.1, 0.02, 0.001, -0.001, 0.0]", distortions)
        .replace("fisheye = false", "fisheye = true")
        .replace("900.0", "400.0")
        .replace("910.0", "400.0");
    parse(&format!("[one]{text}"))
}

#[test]
fn a_fisheye_of_aniposelib_and_freemocap_is_read() {
    let calibration = with_lens("[-0.02, 0.005, -0.002, 0.0003]").unwrap();
    assert_eq!(
        *calibration.cameras["a"].lens(),
        LensModel::KannalaBrandt([-0.02, 0.005, -0.002, 0.0003])
    );
}

#[test]
fn a_fisheye_of_caliscope_is_read() {
    let text = "[cameras.3]\ncam_id = 3\nsize = [1280, 720]\nrotation = [0.1, 0.2, 0.3]\ntranslation = [0.1, 0.2, 0.3]\n\
        matrix = [[400.0, 0.0, 640.0], [0.0, 400.0, 360.0], [0.0, 0.0, 1.0]]\n\
        distortions = [0.01, 0.0, 0.0, 0.0]\nfisheye = true\n";
    let calibration = parse(text).unwrap();
    assert!(calibration.cameras["cam_3"].lens().is_fisheye());
}

#[test]
fn a_fisheye_that_folds_in_its_used_part_is_refused() {
    // Its drawn radius is largest at 33 degrees; the corners of the picture are beyond it.
    let refused = with_lens("[-1.0, 0.0, 0.0, 0.0]").unwrap_err().to_string();
    assert!(
        refused.starts_with(
            "cal.toml:5: `one.distortions`: camera `a`: its lens distortion folds inside its image"
        ),
        "{refused}"
    );
    // Largest at 66 degrees, beyond the used part.
    with_lens("[-0.25, 0.0, 0.0, 0.0]").unwrap();
}

#[test]
fn a_file_that_is_not_toml_gets_the_hint_to_convert_it() {
    let refused = |name: &str| {
        let parsed = Calibration::parse("%YAML:1.0\nnames: []\n", Path::new(name));
        parsed.unwrap_err().to_string()
    };
    assert!(refused("hall.yml").contains("`farfield calibrate convert`"));
    assert!(!refused("hall.toml").contains("convert"));
}

/// [`CAMERA`] at `center_m` with the name `name`.
fn camera_at(name: &str, center_m: [f64; 3]) -> String {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(1.2, -0.3, 0.4));
    let translation = -(rotation * Vector3::from(center_m));
    let camera = CAMERA.replace("name = \"a\"", &format!("name = \"{name}\""));
    let [x, y, z]: [f64; 3] = translation.into();
    let camera = camera.replace("[0.5, 1.0, 3.0]", &format!("[{x:?}, {y:?}, {z:?}]"));
    format!("[{name}]{camera}")
}

#[test]
fn surveyed_coordinates_are_refused_with_the_offset_to_subtract() {
    let surveyed = camera_at("a", [500_003.0, 5_000_004.0, 122.0])
        + &camera_at("b", [499_996.0, 4_999_997.0, 122.0]);
    let message = parse(&surveyed).unwrap_err().to_string();
    assert!(
        message.starts_with(
            "cal.toml:7: `a.translation`: the cameras stand at about (500000, 5000000, 120) m"
        ),
        "{message}"
    );
    assert!(
        message.contains("`farfield calibrate convert FILE --origin 500000,5000000,120 --out DIR`"),
        "{message}"
    );
    // Scattered cameras have another unit.
    let scattered = camera_at("a", [500_003.0, 0.0, 0.0]) + &camera_at("b", [0.0, 400_000.0, 0.0]);
    let message = parse(&scattered).unwrap_err().to_string();
    assert!(
        message.contains("expected metres from -100000 to 100000"),
        "{message}"
    );
}
