//! Compares files of other tools with what those tools read from them. Skipped without the recordings.

use std::path::PathBuf;

use farfield_calibration::formats::{
    Format, ImportOptions, Imported, LensModel, RemarkKind, TextFile, import,
};
use farfield_proto::calibration::Calibration;

/// The text of a recording: below `$FARFIELD_DATA`, else below `../shared` next to the checkout.
fn recording(name: &str) -> Option<TextFile> {
    let default = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let root = std::env::var_os("FARFIELD_DATA").map_or(default, PathBuf::from);
    let path = root.join("data").join(name);
    let text = std::fs::read_to_string(&path);
    if text.is_err() {
        println!(
            "skipped: {} is not there (FARFIELD_DATA names its folder)",
            path.display()
        );
    }
    Some(TextFile {
        path,
        text: text.ok()?,
    })
}

fn read(name: &str) -> Option<Imported> {
    let file = recording(name)?;
    Some(import(&[file], &ImportOptions::default()).expect("a file that its tool reads"))
}

/// Pose2Sim's conversion keeps 8 digits of the pose and sets the distortion to zero; two pictures were cropped to 1080 columns.
#[test]
fn qualisys_files_are_read_as_by_pose2sim_except_the_distortion() {
    let Some(found) = read("pose2sim/single/Calib.qca.txt") else {
        return;
    };
    let Some(theirs) = recording("pose2sim/single/calibration.toml") else {
        return;
    };
    let theirs = Calibration::parse(&theirs.text, &theirs.path).expect("Pose2Sim's calibration");
    assert_eq!(found.format, Format::Qualisys);
    assert_eq!(found.cameras.len(), 4);
    assert!(
        found.remarks.iter().all(|r| r.kind != RemarkKind::Doubtful),
        "{:?}",
        found.remarks
    );
    for camera in &found.cameras {
        let their = &theirs.cameras[&camera.name];
        let (a, b) = (camera.intrinsics, their.intrinsics());
        for (a, b) in [
            (a.fx_px, b.fx_px),
            (a.fy_px, b.fy_px),
            (a.cx_px, b.cx_px),
            (a.cy_px, b.cy_px),
        ] {
            assert!((a - b).abs() < 1e-6, "{}: {a} {b}", camera.name);
        }
        let pose = camera.camera_from_world.expect("placed").to_homogeneous();
        let off = (pose - their.camera_from_world().isometry().to_homogeneous())
            .abs()
            .max();
        assert!(off < 1e-7, "{}: {off}", camera.name);
        assert_eq!(camera.size_px, [1088, 1920]);
        let LensModel::Rational(d) = camera.lens else {
            panic!("a pinhole")
        };
        // These are the file's values; Pose2Sim divides by 64.
        assert!(
            (d.k1 + 0.047).abs() < 0.002 && (d.k2 - 0.137).abs() < 0.004,
            "{d:?}"
        );
    }
}

#[test]
fn caliscope_files_are_recognised() {
    let Some(found) = read("caliscope/camera_array.toml") else {
        return;
    };
    assert_eq!(found.format, Format::Caliscope);
    let names: Vec<&str> = found.cameras.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["cam_0", "cam_1", "cam_2", "cam_3"]);
}

#[test]
fn json_files_with_opencv_parameters_are_read() {
    let Some(found) = read("drone/intrinsics/gopro3.json") else {
        return;
    };
    assert_eq!(found.format, Format::OpenCvJson);
    let camera = &found.cameras[0];
    assert_eq!(
        (camera.name.as_str(), camera.size_px),
        ("gopro3", [1920, 1080])
    );
    assert!((camera.intrinsics.fx_px - 874.472_184_604_778_6).abs() < 1e-9);
    assert!(camera.camera_from_world.is_none());
}
