//! Fisheye cameras in the whole system: images are rendered through them, read by the embedded networks and fused; a check
//! of their venue; people beyond 120 degrees of view are left out and reported.

use std::fs;
use std::path::{Path, PathBuf};

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::{CameraModel, Intrinsics};
use farfield_proto::frames::Transform;
use farfield_sim::scene::write::calibration_text;
use nalgebra::{UnitQuaternion, Vector3};

use crate::data::{checkout, onnx_runtime};
use crate::farfield::{FinishedCommand, farfield};

/// Four cameras close to a small field, so that each needs more than 100 degrees of view.
const SCENE: &str = r#"
rate_hz = 30.0
seconds = 4.0
seed = 3
size_m = [7.0, 5.0]
[cameras]
viewpoints = 4
per_viewpoint = 1
height_m = 2.6
setback_m = 0.9
size_px = [1280, 800]
FISHEYES
[[person]]
name = "1"
clips = ["CLIPS/walk.bvh"]
at_m = [-1.2, 0.4]
heading_rad = 0.3
height_m = 1.78
[[person]]
name = "2"
clips = ["CLIPS/guard.bvh"]
at_m = [1.3, -0.8]
heading_rad = 2.4
height_m = 1.70
"#;

/// Makes two of the four cameras fisheyes.
const TWO: &str = "fisheye = [-0.02, 0.005, -0.002, 0.0003]\nfisheye_viewpoints = [\"north-east\", \"south-west\"]";

fn scene(folder: &Path, name: &str, fisheyes: &str) -> PathBuf {
    let clips = checkout().join("sim/clips").canonicalize().unwrap();
    let path = folder.join(format!("{name}.toml"));
    let text = SCENE
        .replace("CLIPS", clips.to_str().unwrap())
        .replace("FISHEYES", fisheyes);
    fs::write(&path, text).unwrap();
    path
}

fn demo(scene: &Path, out: &Path, more: &[&str]) -> FinishedCommand {
    let [scene, out] = [scene, out].map(|path| path.to_str().unwrap());
    let mut args = vec!["demo", "--scene", scene, "--out", out];
    args.extend(more);
    let finished = farfield(&args);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    finished
}

/// Mean error of each of the two people, millimetres; both are tracked all the time.
fn errors_mm(out: &Path) -> Vec<f64> {
    let [poses, truth] = ["poses.jsonl", "truth.jsonl"].map(|file| out.join(file));
    let scored = farfield(&[
        "evaluate",
        poses.to_str().unwrap(),
        truth.to_str().unwrap(),
        "--json",
    ]);
    let score: serde_json::Value =
        serde_json::from_str(&scored.stdout).unwrap_or_else(|e| panic!("{e}: {}", scored.stderr));
    let actors = score["actors"].as_object().unwrap();
    assert_eq!(actors.len(), 2, "{score}");
    assert_eq!(score["identity"]["switches"], 0, "{score}");
    let error_mm = |actor: &serde_json::Value| {
        assert_eq!(actor["gaps"], 0, "{score}");
        actor["mpjpe_mm"].as_f64().unwrap()
    };
    actors.values().map(error_mm).collect()
}

#[test]
fn fisheyes_track_people_as_well_as_pinholes_from_maps() {
    let dir = tempfile::tempdir().unwrap();
    let worst = ["", TWO].map(|fisheyes| {
        let name = if fisheyes.is_empty() {
            "pinholes"
        } else {
            "fisheyes"
        };
        let out = dir.path().join(name);
        demo(
            &scene(dir.path(), &format!("{name}-scene"), fisheyes),
            &out,
            &["--maps", "--ticks", "60"],
        );
        let errors_mm = errors_mm(&out);
        println!("from maps, {name}: {errors_mm:.1?} mm");
        errors_mm.into_iter().fold(0.0, f64::max)
    });
    assert!(worst[1] < 40.0 && worst[1] < 1.5 * worst[0], "{worst:?}");
}

#[test]
fn fisheyes_track_people_as_well_as_pinholes_from_images() {
    if !onnx_runtime("fisheyes from pictures") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let worst = ["", TWO].map(|fisheyes| {
        let name = if fisheyes.is_empty() {
            "pinholes"
        } else {
            "fisheyes"
        };
        let out = dir.path().join(name);
        demo(
            &scene(dir.path(), &format!("{name}-scene"), fisheyes),
            &out,
            &["--ticks", "24"],
        );
        let errors_mm = errors_mm(&out);
        println!("from pictures, {name}: {errors_mm:.1?} mm");
        errors_mm.into_iter().fold(0.0, f64::max)
    });
    // The network is small and was not trained on fisheyes, but crops are undistorted.
    assert!(
        worst[1] < 200.0 && worst[1] < 1.6 * worst[0] + 20.0,
        "{worst:?}"
    );
}

/// The calibration with `camera` turned about y and its focal length times 0.6.
fn turned(calibration: &str, camera: &str, angle_deg: f64) -> String {
    let parsed = Calibration::parse(calibration, Path::new("calibration.toml")).unwrap();
    let cameras: Vec<CameraModel> = parsed
        .cameras
        .values()
        .map(|model| {
            if model.name() != camera {
                return model.clone();
            }
            let k = *model.intrinsics();
            let intrinsics = Intrinsics {
                fx_px: 0.6 * k.fx_px,
                fy_px: 0.6 * k.fy_px,
                ..k
            };
            let mut pose = *model.camera_from_world().isometry();
            let turn = UnitQuaternion::from_scaled_axis(Vector3::y() * angle_deg.to_radians());
            pose.rotation = turn * pose.rotation;
            pose.translation.vector = turn * pose.translation.vector;
            CameraModel::new(
                camera,
                model.size_px(),
                intrinsics,
                *model.lens(),
                Transform::new(pose),
            )
            .unwrap()
        })
        .collect();
    calibration_text(&cameras)
}

#[test]
fn a_check_of_fisheyes_reports_and_draws_the_used_angle() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    demo(
        &scene(dir.path(), "scene", TWO),
        &out,
        &["--maps", "--ticks", "6"],
    );
    let venue = out.join("venue");
    let calibration = venue.join("calibration.toml");
    let text = fs::read_to_string(&calibration).unwrap();
    assert_eq!(text.matches("fisheye = true").count(), 2, "{text}");
    fs::write(&calibration, turned(&text, "north-east-1", 0.0)).unwrap();
    let drawn = dir.path().join("drawn");
    let check = || {
        let [venue, drawn] = [venue.join("venue.toml"), drawn.clone()];
        farfield(&[
            "check",
            venue.to_str().unwrap(),
            "--out",
            drawn.to_str().unwrap(),
        ])
    };
    let finished = check();
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    let words = " % of its fisheye image";
    assert!(finished.stdout.contains(words), "{}", finished.stdout);
    let picture = image::open(drawn.join("check_north-east-1.png"))
        .unwrap()
        .into_rgb8();
    let white = picture
        .pixels()
        .filter(|p| p.0.iter().all(|&c| c > 240))
        .count();
    assert!(
        white > 500,
        "the rim of the used angle is not drawn: {white}"
    );
    // Turned so far that the field lies outside the used angle of view.
    fs::write(&calibration, turned(&text, "north-east-1", 150.0)).unwrap();
    let finished = check();
    let words =
        "it sees no point of the field within the 120 degrees of view of a fisheye that are used";
    assert!(finished.stdout.contains(words), "{}", finished.stdout);
    // A fisheye has no five coefficients.
    fs::write(
        &calibration,
        text.replacen(", 0.0003]", ", 0.0003, 0.0]", 1),
    )
    .unwrap();
    let finished = check();
    assert_eq!(finished.code, 1, "{}", finished.stdout);
    assert!(
        finished
            .stdout
            .contains("found 5 values, expected 4 of a fisheye lens"),
        "{}",
        finished.stdout
    );
}

#[test]
fn people_beyond_sixty_degrees_are_left_out_and_reported() {
    if !onnx_runtime("people beyond sixty degrees") {
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let made = scene(dir.path(), "scene", TWO);
    demo(&made, &out, &["--maps", "--ticks", "6"]);
    // The same scene with one fisheye turned so that people are at the rim of the used angle of view, and beyond.
    let text = fs::read_to_string(out.join("venue/calibration.toml")).unwrap();
    fs::write(
        dir.path().join("turned.toml"),
        turned(&text, "north-east-1", 48.0),
    )
    .unwrap();
    let text = fs::read_to_string(&made).unwrap();
    let (head, rest) = text.split_once("[cameras]").unwrap();
    let (_, people) = rest.split_once("[[person]]").unwrap();
    let viewpoints = ["north-east", "north-west", "south-west", "south-east"].map(|name| {
        format!("[[viewpoint]]\nname = \"{name}\"\n[[viewpoint.camera]]\nname = \"{name}-1\"\n")
    });
    let viewpoints = viewpoints.concat();
    fs::write(
        &made,
        format!("{head}calibration = \"turned.toml\"\n{viewpoints}[[person]]{people}"),
    )
    .unwrap();
    let turned_out = dir.path().join("turned");
    let finished = demo(&made, &turned_out, &["--ticks", "24"]);
    let line = finished
        .stderr
        .lines()
        .find(|line| line.contains("beyond 120 degrees of view"));
    let line = line.unwrap_or_else(|| panic!("{}\n{}", finished.stdout, finished.stderr));
    println!("{line}");
    assert!(line.contains("camera `north-east-1`: "), "{line}");
    let errors_mm = errors_mm(&turned_out);
    println!("with people beyond: {errors_mm:.1?} mm");
    assert!(errors_mm.iter().all(|mm| *mm < 200.0), "{errors_mm:?}");
}
