//! Files as other tools write them, with the details that readers get wrong.

#![expect(
    clippy::float_cmp,
    reason = "a decimal of a file is read as the same decimal of the test"
)]
use super::*;

const MATRIX: &str = "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 800., 0., 319.5, 0., 810., 239.5, 0., 0., 1. ]\n";
const FIVE: &str = "!!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n   data: [ -0.1, 0.02, 1.e-03, -2.e-03, 3.e-03 ]\n";

fn read_with(files: &[(&str, String)], options: &ImportOptions) -> Result<Imported, FileError> {
    let files: Vec<TextFile> = files
        .iter()
        .map(|(path, text)| TextFile {
            path: (*path).into(),
            text: text.clone(),
        })
        .collect();
    import(&files, options)
}

fn read(files: &[(&str, String)]) -> Result<Imported, FileError> {
    read_with(files, &ImportOptions::default())
}

fn coefficients(camera: &CameraRecord) -> Vec<f64> {
    camera.lens.coefficients()
}

#[test]
fn opencv_files_with_invalid_yaml_heads_and_numbers_are_read() {
    for head in ["%YAML:1.0\n---\n", "%YAML 1.2\n---\n"] {
        let text = format!(
            "{head}calibration_time: \"Mon\"\nimage_width: 640\nimage_height: 480\navg_reprojection_error: .Nan\n\
             camera_matrix: {MATRIX}distortion_coefficients: {FIVE}"
        );
        let found = read(&[("left.yml", text)]).expect("OpenCV's own file");
        let camera = &found.cameras[0];
        assert_eq!((camera.name.as_str(), camera.size_px), ("left", [640, 480]));
        assert_eq!(coefficients(camera), [-0.1, 0.02, 1e-3, -2e-3, 3e-3]);
    }
}

#[test]
fn a_missing_number_among_the_coefficients_is_refused_by_name() {
    let text = format!(
        "%YAML:1.0\n---\ncamera_matrix: {MATRIX}distortion_coefficients: {}",
        FIVE.replace("0.02", ".Nan")
    );
    let error = read(&[("left.yml", text)]).expect_err("no number");
    assert_eq!(
        error.to_string(),
        "left.yml:8: `distortion_coefficients`: found nothing or no finite number, expected finite numbers"
    );
}

#[test]
fn the_rectification_of_ros_is_not_a_pose() {
    let text = "image_width: 640\nimage_height: 480\ncamera_name: front\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [800, 0, 320, 0, 800, 240, 0, 0, 1]\n\
                distortion_model: equidistant\ndistortion_coefficients:\n  rows: 1\n  cols: 4\n  data: [0.1, 0.2, 0.3, 0.4]\n\
                R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n";
    let found = read(&[("x.yaml", text.to_owned())]).expect("ROS");
    let camera = &found.cameras[0];
    assert_eq!(
        (camera.name.as_str(), camera.camera_from_world),
        ("front", None)
    );
    assert_eq!(camera.lens, LensModel::KannalaBrandt([0.1, 0.2, 0.3, 0.4]));
}

#[test]
fn four_coefficients_without_a_model_are_a_fisheye_only_on_request() {
    let four =
        "!!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: [ 0.1, 0.2, 0.01, 0.02 ]\n";
    let text = format!("%YAML:1.0\n---\nK: {MATRIX}D: {four}");
    let files = [("a.yml", text)];
    let found = read(&files).expect("read");
    assert!(!found.cameras[0].lens.is_fisheye());
    assert!(
        found
            .remarks
            .iter()
            .any(|r| r.text.contains("k1, k2, p1, p2")),
        "{:?}",
        found.remarks
    );
    let options = ImportOptions {
        four_are_fisheye: true,
        ..ImportOptions::default()
    };
    assert!(
        read_with(&files, &options).expect("read").cameras[0]
            .lens
            .is_fisheye()
    );
}

#[test]
fn four_coefficients_without_a_model_are_reported_unless_zero() {
    let remarks_about_four = |path: &str, four: &str| {
        let list =
            format!("!!opencv-matrix\n   rows: 4\n   cols: 1\n   dt: d\n   data: [ {four} ]\n");
        let identity = "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]\n";
        let vector =
            "!!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ -0.2, 0., 0.01 ]\n";
        let text = match path {
            "intri.yml" => format!("K_01: {MATRIX}dist_01: {list}K_02: {MATRIX}dist_02: {list}"),
            "stereo.yml" => {
                format!("M1: {MATRIX}D1: {list}M2: {MATRIX}D2: {list}R: {identity}T: {vector}")
            }
            _ => format!("K: {MATRIX}D: {list}"),
        };
        let found = read(&[(path, format!("%YAML:1.0\n---\n{text}"))]).expect("read");
        let texts = found.remarks.into_iter().map(|remark| remark.text);
        let about_four = texts.filter(|text| text.contains("taken as k1, k2, p1, p2"));
        about_four.collect::<Vec<_>>()
    };
    let none: [String; 0] = [];
    for (path, cameras) in [
        ("intri.yml", "`01`, `02`"),
        ("stereo.yml", "`1`, `2`"),
        ("a.yml", "`a`"),
    ] {
        let remarks = remarks_about_four(path, "0.1, 0.2, 0.01, 0.02");
        let [only] = remarks.as_slice() else {
            panic!("{path}: {remarks:?}")
        };
        assert!(only.contains(&format!("of {cameras} are")), "{only}");
        assert_eq!(remarks_about_four(path, "0., 0., 0., 0."), none, "{path}");
    }
}

#[test]
fn the_two_files_of_opencvs_stereo_sample_are_two_cameras() {
    let intrinsics = format!("%YAML:1.0\n---\nM1: {MATRIX}D1: {FIVE}M2: {MATRIX}D2: {FIVE}");
    let vector = "!!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ -0.2, 0., 0.01 ]\n";
    let identity = "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]\n";
    let extrinsics = format!("%YAML:1.0\n---\nR: {identity}T: {vector}");
    let found = read(&[
        ("intrinsics.yml", intrinsics.clone()),
        ("extrinsics.yml", extrinsics),
    ])
    .expect("stereo");
    let second = found.cameras[1].camera_from_world.expect("placed");
    assert!((second.translation.vector - nalgebra::Vector3::new(-0.2, 0.0, 0.01)).norm() < 1e-12);
    let error = read(&[("intrinsics.yml", intrinsics)]).expect_err("no extrinsics");
    assert!(error.problem.contains("extrinsics"), "{error}");
}

#[test]
fn the_two_rotations_in_an_easymocap_file_must_agree() {
    let intri = format!("%YAML:1.0\n---\nnames:\n   - \"01\"\nK_01: {MATRIX}dist_01: {FIVE}");
    let extri = |rodrigues: &str| {
        format!(
            "%YAML:1.0\n---\nnames:\n   - \"01\"\nR_01: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ {rodrigues} ]\n\
             Rot_01: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ 1., 0., 0., 0., 0., -1., 0., 1., 0. ]\n\
             T_01: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: [ 0., 1.5, 4. ]\n"
        )
    };
    let good = read(&[
        ("intri.yml", intri.clone()),
        ("extri.yml", extri("1.5707963267948966, 0., 0.")),
    ])
    .expect("read");
    assert_eq!(
        (good.format, good.cameras[0].name.as_str()),
        (Format::EasyMocap, "01")
    );
    assert_eq!(good.cameras[0].size_px, [640, 480]);
    assert!(
        good.remarks.iter().any(|r| r.kind == RemarkKind::Assumed),
        "the size is not in the file"
    );
    let error =
        read(&[("intri.yml", intri), ("extri.yml", extri("90., 0., 0."))]).expect_err("degrees");
    assert!(
        error
            .to_string()
            .starts_with("extri.yml:5: `R_01`: found a vector of length 90"),
        "{error}"
    );
}

#[test]
fn a_pickle_dumped_to_json_by_python_is_read() {
    // json.dump of a dictionary of NumPy arrays, as OpenCap pickles it. Columns are lists of lists; the size is [rows, columns].
    let json = r#"{"distortion": [[0.1, -0.2, 0.0, 0.0, 0.05]], "intrinsicMat": [[1600.0, 0.0, 640.0], [0.0, 1600.0, 360.0],
        [0.0, 0.0, 1.0]], "imageSize": [[720.0], [1280.0]], "rotation": [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        "translation": [[100.0], [800.0], [3500.0]]}"#;
    let read = read(&[("cam0.json", json.to_owned())]).expect("a camera");
    let camera = &read.cameras[0];
    assert_eq!(camera.size_px, [1280, 720]);
    let at_mm = camera.camera_from_world.expect("placed").translation.vector * 1e3;
    assert!((at_mm - nalgebra::Vector3::new(100.0, 800.0, 3500.0)).norm() < 1e-9);
    let kinds: Vec<RemarkKind> = read.remarks.iter().map(|r| r.kind).collect();
    assert!(kinds.contains(&RemarkKind::Corrected), "{:?}", read.remarks);
    let texts: Vec<&str> = read.remarks.iter().map(|r| r.text.as_str()).collect();
    assert!(
        texts
            .iter()
            .any(|text| text.contains("taken as 1280 x 720")),
        "{texts:?}"
    );
    assert!(
        texts.iter().any(|text| text.contains("millimetres")),
        "{texts:?}"
    );
}

/// One camera of a `.qca.txt` whose view begins at (100, 50); `root` holds the attributes of the root element.
fn qca(root: &str) -> String {
    format!(
        "<?xml version='1.0'?>\n<calibration{root}>\n<cameras>\n<camera active=\"1\" serial=\"7\" model=\"Miqus Video\" viewrotation=\"90\">\n\
         <fov_video left=\"100\" top=\"50\" right=\"739\" bottom=\"529\"/>\n\
         <transform x=\"1000\" y=\"2000\" z=\"3000\" r11=\"0\" r12=\"1\" r13=\"0\" r21=\"0\" r22=\"0\" r23=\"1\" r31=\"1\" r32=\"0\" r33=\"0\"/>\n\
         <intrinsic sensorMaxU=\"81856\" sensorMaxV=\"65472\" focalLengthU=\"64000\" focalLengthV=\"64064\" centerPointU=\"26848\" \
         centerPointV=\"18528\" skew=\"0\" radialDistortion1=\"-0.05\" radialDistortion2=\"0.14\" radialDistortion3=\"0\" \
         tangentalDistortion1=\"0.001\" tangentalDistortion2=\"0.002\"/>\n</camera>\n\
         <camera active=\"1\" serial=\"8\" model=\"Miqus M3\" viewrotation=\"0\"/>\n</cameras>\n</calibration>\n"
    )
}

#[test]
fn qualisys_stores_positions_and_theia_rigid_motions_both_in_64ths() {
    let qualisys = read(&[("a.qca.txt", qca(" qtm-version=\"2021\""))]).expect("Qualisys");
    let theia = read(&[("a.txt", qca(""))]).expect("Theia");
    assert_eq!(
        (qualisys.format, theia.format),
        (Format::Qualisys, Format::Theia)
    );
    let camera = &qualisys.cameras[0];
    let k = camera.intrinsics;
    assert_eq!(
        [k.fx_px, k.fy_px, k.cx_px, k.cy_px],
        [1000.0, 1001.0, 319.5, 239.5]
    );
    assert_eq!(camera.size_px, [640, 480]);
    assert_eq!(coefficients(camera), [-0.05, 0.14, 0.001, 0.002, 0.0]);
    let center = camera
        .camera_from_world
        .expect("placed")
        .inverse()
        .translation
        .vector;
    assert!((center - nalgebra::Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
    let moved = theia.cameras[0]
        .camera_from_world
        .expect("placed")
        .translation
        .vector;
    assert!((moved - nalgebra::Vector3::new(1.0, 2.0, 3.0)).norm() < 1e-12);
    let texts: Vec<&str> = qualisys.remarks.iter().map(|r| r.text.as_str()).collect();
    assert!(
        texts.iter().any(|text| text.contains("turned by 90"))
            && texts.iter().any(|text| text.contains("no video")),
        "{texts:?}"
    );
}

/// The cameras that an import uses of a `.qca.txt` with these models, and its remarks.
fn selected(models: &[&str], change: impl Fn(String) -> String) -> (Vec<String>, String) {
    let whole = qca(" qtm-version=\"2021\"");
    let begin = whole.find("<camera ").expect("a camera");
    let end = whole.find("</camera>").expect("its end") + "</camera>\n".len();
    let cameras: String = models
        .iter()
        .enumerate()
        .map(|(i, model)| {
            let camera = whole[begin..end].replace("Miqus Video", model);
            camera.replace("serial=\"7\"", &format!("serial=\"cam{i}\""))
        })
        .collect();
    let tail = whole.find("</cameras>").expect("the end");
    let text = change([&whole[..begin], &cameras, &whole[tail..]].concat());
    let read = read(&[("a.qca.txt", text)]).expect("Qualisys");
    let remarks: Vec<String> = read.remarks.iter().map(ToString::to_string).collect();
    (
        read.cameras.into_iter().map(|it| it.name).collect(),
        remarks.join("\n"),
    )
}

#[test]
fn marker_cameras_of_qualisys_are_left_out_and_unknown_models_used() {
    let same = |text: String| text;
    let (cameras, remarks) = selected(&["Miqus Hybrid", "Miqus Video", "Miqus Video"], same);
    assert_eq!(cameras, ["cam0", "cam1", "cam2"]);
    assert!(!remarks.contains("model"), "{remarks}");
    let (cameras, remarks) = selected(&["Miqus Hybrid", "Miqus Hybrid", "Miqus M3"], same);
    assert_eq!(cameras, ["cam0", "cam1"]);
    assert!(
        remarks
            .contains("camera `cam2`: model `Miqus M3` sees markers and films no video: left out"),
        "{remarks}"
    );
    let models = [
        "Miqus Ultra 9",
        "Oqus 7+",
        "Oqus 210c",
        "Arqus A12",
        "Miqus M5u",
        "M1",
    ];
    let (cameras, remarks) = selected(&models, same);
    assert_eq!(cameras, ["cam0", "cam2"]);
    assert!(
        remarks.contains("camera `cam0`: model `Miqus Ultra 9` is not known: taken"),
        "{remarks}"
    );
    assert!(!remarks.contains("camera `cam2`: model"), "{remarks}");
    // Cameras are not left out if none would remain.
    let (cameras, remarks) = selected(&["Oqus 7+", "Oqus 5+"], same);
    assert_eq!(cameras, ["cam0", "cam1"]);
    assert!(remarks.contains("like all others: taken"), "{remarks}");
}

#[test]
fn video_fields_of_a_qualisys_file_outrank_the_model() {
    let films = |text: String| {
        text.replace(
            "model=\"Oqus 7+\"",
            "model=\"Oqus 7+\" videoresolution=\"1080p\"",
        )
    };
    assert_eq!(
        selected(&["Miqus Video", "Oqus 7+"], films).0,
        ["cam0", "cam1"]
    );
    let empty = |text: String| {
        let view = "left=\"100\" top=\"50\" right=\"739\" bottom=\"529\"";
        text.replacen(view, "left=\"0\" top=\"0\" right=\"0\" bottom=\"0\"", 1)
    };
    assert_eq!(
        selected(&["Miqus Ultra 9", "Miqus Video"], empty).0,
        ["cam1"]
    );
}

#[test]
fn a_missing_attribute_is_refused_with_its_line() {
    let text =
        qca(" qtm-version=\"2021\"").replace("focalLengthU=\"64000\"", "focalLengthU=\"wide\"");
    let error = read(&[("a.qca.txt", text)]).expect_err("no number");
    assert_eq!(
        error.to_string(),
        "a.qca.txt:7: `intrinsic.focalLengthU`: found `wide`, expected a finite number"
    );
}

fn xcp(radial: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<Cameras VERSION=\"1.0\">\n<Camera DEVICEID=\"2101\" DISPLAY_TYPE=\"Vue\" TYPE=\"VideoCamera\" \
         PIXEL_ASPECT_RATIO=\"1\" SENSOR_SIZE=\"2048 1088\" SKEW=\"0\">\n<KeyFrames>\n<KeyFrame FOCAL_LENGTH=\"1700\" \
         ORIENTATION=\"0 0 0.7071067811865476 0.7071067811865476\" POSITION=\"100 200 -3000\" PRINCIPAL_POINT=\"1030 540\" \
         VICON_RADIAL2=\"ViconRadial2 1030 540 {radial}\"/>\n</KeyFrames>\n</Camera>\n\
         <Camera DEVICEID=\"3\" TYPE=\"VeroCamera\" SENSOR_SIZE=\"1 1\"><KeyFrames/></Camera>\n</Cameras>\n"
    )
}

#[test]
fn a_focal_length_of_zero_is_refused_with_its_camera() {
    let text = xcp("0 0 0").replace("FOCAL_LENGTH=\"1700\"", "FOCAL_LENGTH=\"0\"");
    let error = read(&[("system.xcp", text)])
        .expect_err("nothing can be drawn")
        .to_string();
    assert!(
        error.contains("system.xcp") && error.contains("focal length"),
        "{error}"
    );
    let text = format!(
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: {MATRIX}distortion_coefficients: {}",
        FIVE.replace("0.02", ".Nan")
    );
    let error = read(&[("left.yml", text)])
        .expect_err("nothing can be drawn")
        .to_string();
    assert!(error.contains("left"), "{error}");
}

#[test]
fn two_cameras_are_not_written_to_one_file() {
    let text = format!(
        "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: {MATRIX}distortion_coefficients: {FIVE}"
    );
    let mut cameras = read(&[("left.yml", text)])
        .expect("OpenCV's own file")
        .cameras;
    cameras.push(CameraRecord {
        name: "Left".to_owned(),
        ..cameras[0].clone()
    });
    let found = export(&cameras, Format::OpenCvYaml);
    assert!(
        matches!(found, Err(ExportError::SameFile { .. })),
        "{found:?}"
    );
}

#[test]
fn vicon_pixels_and_quaternions_follow_the_conventions_of_vicon() {
    let options = ImportOptions {
        video_px: Some([1920, 1080]),
        ..ImportOptions::default()
    };
    let files = [("a.xcp", xcp("-0.1 0.02 0.003"))];
    let found = read_with(&files, &options).expect("Vicon");
    let camera = &found.cameras[0];
    assert_eq!(
        [camera.intrinsics.cx_px, camera.intrinsics.cy_px],
        [1030.0 - 64.0, 540.0 - 4.0]
    );
    assert_eq!(coefficients(camera), [-0.1, 0.02, 0.0, 0.0, 0.003]);
    let pose = camera.camera_from_world.expect("placed");
    assert!(
        (pose.inverse().translation.vector - nalgebra::Vector3::new(0.1, 0.2, -3.0)).norm() < 1e-12
    );
    // A quarter turn about z takes x to y.
    assert!((pose.rotation * nalgebra::Vector3::x() - nalgebra::Vector3::y()).norm() < 1e-12);
    assert!(
        read(&files)
            .expect("Vicon")
            .remarks
            .iter()
            .any(|r| r.text.contains("cropped"))
    );
    assert!(
        found
            .remarks
            .iter()
            .any(|r| r.camera.as_deref() == Some("3")),
        "{:?}",
        found.remarks
    );
}

#[test]
fn vicon_coefficients_per_pixel_are_inverted_with_a_remark() {
    let found = read(&[("a.xcp", xcp("3e-8 0 0"))]).expect("Vicon");
    let k1 = coefficients(&found.cameras[0])[0];
    assert!((k1 + 3e-8 * 1700.0 * 1700.0).abs() < 0.02, "{k1}");
    assert!(
        found
            .remarks
            .iter()
            .any(|r| r.kind == RemarkKind::Corrected),
        "{:?}",
        found.remarks
    );
}

#[test]
fn colmap_pixels_start_at_a_half_and_point_lines_may_be_empty() {
    let cameras = "# a comment\n1 SIMPLE_RADIAL 640 480 800 320 240 -0.1\n2 OPENCV_FISHEYE 640 480 500 500 320 240 .1 .2 .3 .4\n";
    let images = "# comment\n1 0.5 0.5 0.5 0.5 1 2 3 1 north.jpg\n\n2 1 0 0 0 4 5 6 2 south.jpg\n12.5 3.5 -1\n";
    let found = read(&[
        ("cameras.txt", cameras.to_owned()),
        ("images.txt", images.to_owned()),
    ])
    .expect("COLMAP");
    let names: Vec<&str> = found.cameras.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["north", "south"]);
    let first = &found.cameras[0];
    assert_eq!(
        [first.intrinsics.cx_px, first.intrinsics.fy_px],
        [319.5, 800.0]
    );
    assert_eq!(coefficients(first), [-0.1, 0.0, 0.0, 0.0, 0.0]);
    // (0.5, 0.5, 0.5, 0.5) takes x to y, with the real part first.
    let turned = first.camera_from_world.expect("placed").rotation * nalgebra::Vector3::x();
    assert!((turned - nalgebra::Vector3::y()).norm() < 1e-12);
    assert!(
        found.remarks.iter().any(|r| r.text.contains("no unit")),
        "{:?}",
        found.remarks
    );
    let error =
        read(&[("cameras.txt", "1 OPENCV 640 480 1 2 3\n".to_owned())]).expect_err("too few");
    assert_eq!(
        error.to_string(),
        "cameras.txt:1: found 3 parameters, `OPENCV` has 8"
    );
    let error = read(&[(
        "cameras.txt",
        "1 THIN_PRISM_FISHEYE 640 480 1 2 3\n".to_owned(),
    )])
    .expect_err("unknown");
    assert!(error.problem.contains("OPENCV_FISHEYE"), "{error}");
}

#[test]
fn kalibr_poses_are_chained() {
    let camera = |i: usize, step: &str| {
        format!(
            "cam{i}:\n{step}  camera_model: pinhole\n  distortion_coeffs: [0.1, 0.2, 0.01, 0.02]\n  distortion_model: radtan\n  \
             intrinsics: [800.0, 801.0, 320.0, 240.0]\n  resolution: [640, 480]\n  rostopic: /cam{i}\n"
        )
    };
    let step = "  T_cn_cnm1:\n  - [0.0, -1.0, 0.0, 0.5]\n  - [1.0, 0.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n  - [0.0, 0.0, 0.0, 1.0]\n";
    let text = [camera(0, ""), camera(1, step), camera(2, step)].concat();
    let found = read(&[("camchain.yaml", text.clone())]).expect("Kalibr");
    let third = found.cameras[2].camera_from_world.expect("placed");
    // Two quarter turns: (0.5, 0, 0) becomes (0, 0.5, 0), and another (0.5, 0, 0) is added.
    assert!((third.translation.vector - nalgebra::Vector3::new(0.5, 0.5, 0.0)).norm() < 1e-12);
    let error = read(&[("camchain.yaml", text.replace("pinhole", "omni"))]).expect_err("omni");
    assert!(error.to_string().contains("camera_model"), "{error}");
}

#[test]
fn a_fisheye_of_aniposelib_has_four_coefficients() {
    let text = |list: &str| {
        format!(
            "[cam_0]\nname = \"a\"\nsize = [640, 480]\nmatrix = [[500.0, 0, 320], [0, 500.0, 240], [0, 0, 1]]\ndistortions = {list}\n\
             rotation = [0, 0, 0]\ntranslation = [0, 0, 1]\nfisheye = true\n"
        )
    };
    let found = read(&[("a.toml", text("[0.1, 0.2, 0.3, 0.4]"))]).expect("fisheye");
    assert_eq!(
        found.cameras[0].lens,
        LensModel::KannalaBrandt([0.1, 0.2, 0.3, 0.4])
    );
    let error = read(&[("a.toml", text("[0.1, 0.2, 0.3, 0.4, 0.5]"))]).expect_err("five");
    assert_eq!(
        error.to_string(),
        "a.toml:5: `cam_0.distortions`: found 5 values, expected 4 of a fisheye lens"
    );
}
