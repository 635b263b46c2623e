//! Calibrations by a user: from a light carried through the room of the sample, from images of a board, from a file of
//! another program.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::Command;

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use nalgebra::Point3;
use serde_json::Value;

use crate::data::{SampleFolder, print_skipped, recording};
use crate::farfield::{FinishedCommand, farfield};

/// Frames in which the light is carried.
const FRAMES: u32 = 600;

/// Position of the light, world, metres: all over the field, from the knee to the reach of an arm.
fn light_m(frame: u32) -> Point3<f64> {
    let t = 0.05 * f64::from(frame);
    Point3::new(
        3.0 * (0.37 * t).sin(),
        3.0 * (0.23 * t + 1.0).sin(),
        1.2 + 0.9 * (0.71 * t + 0.4).sin(),
    )
}

/// Reproducible noise of up to 0.35 pixels.
fn jitter_px(frame: u32, camera: usize) -> [f64; 2] {
    let seed = f64::from(frame) + 1000.0 * camera as f64;
    [12.9898, 78.233].map(|by| {
        let wild = 43758.5453 * (by * seed).sin();
        0.7 * (wild - wild.floor() - 0.5)
    })
}

/// Pixels of the light in `camera`, one line per frame.
fn seen_by(camera: &CameraModel, number: usize) -> String {
    let mut text = "frame x y\n".to_owned();
    for frame in 0..FRAMES {
        let pixel = camera.project(Point::new(light_m(frame)));
        let pixel = pixel.filter(|pixel| camera.sees(*pixel));
        if let Some(pixel) = pixel.and_then(|pixel| camera.distort(pixel)) {
            let [dx, dy] = jitter_px(frame, number);
            let line = format!("{frame} {:.3} {:.3}\n", pixel.x() + dx, pixel.y() + dy);
            text.push_str(&line);
        }
    }
    text
}

pub(super) fn carried_light() -> SeenHall {
    SeenHall::new("txt", seen_by)
}

/// Positions of three cameras as `--at` options.
fn places(hall: &SeenHall) -> Vec<String> {
    let known = hall.truth.cameras.values().take(3);
    known
        .map(|camera| {
            let at_m = camera.center().coordinates_m();
            format!("--at={}={},{},{}", camera.name(), at_m.x, at_m.y, at_m.z)
        })
        .collect()
}

#[test]
fn a_light_carried_through_the_room_calibrates_its_cameras() {
    let light = carried_light();
    let places = places(&light);
    let places: Vec<&str> = places.iter().map(String::as_str).collect();
    let done = light.calibrate("points", &places);
    println!("{}", done.stdout);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let found = calibration(&light.folder.path("found.toml"));
    for (name, camera) in &light.truth.cameras {
        let at_m = found.cameras[name].center().coordinates_m();
        let apart_m = (at_m - camera.center().coordinates_m()).norm();
        println!("{name}: {:.1} mm from the truth", 1000.0 * apart_m);
        assert!(apart_m < 0.005, "{name}: {apart_m} m");
    }
    let sheet = fs::read_to_string(light.folder.path("found.html")).unwrap();
    assert!(
        sheet.contains("It passes.") && sheet.contains("<svg"),
        "{sheet}"
    );
    assert!(
        sheet.contains(&found.hash),
        "the sheet says which calibration it is of"
    );

    let again = light.calibrate("points", &places);
    assert_eq!(again.code, 2, "{}", again.stdout);
    assert!(again.stderr.contains("--replace"), "{}", again.stderr);
}

#[test]
fn a_calibration_without_a_length_is_written_and_does_not_pass() {
    let light = carried_light();
    let done = light.calibrate("points", &["--json"]);
    assert_eq!(done.code, 1, "{}\n{}", done.stdout, done.stderr);
    // With `--json`, standard output is one document.
    let report: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(report["passes"], false);
    assert_eq!(report["exit_code"], 1);
    assert!(report["findings"].to_string().contains("metre"), "{report}");
    let sheet = fs::read_to_string(light.folder.path("found.failed.html")).unwrap();
    assert!(sheet.contains("It does not pass."), "{sheet}");
    assert!(light.folder.path("found.failed.toml").is_file());
    assert!(
        !light.folder.path("found.toml").exists(),
        "a failed calibration replaces none"
    );
}

#[test]
fn wrong_options_and_points_are_refused() {
    let light = carried_light();
    let refused = |more: &[&str], words: &str| {
        let done = light.calibrate("points", more);
        assert_eq!(done.code, 2, "{words}\n{}\n{}", done.stdout, done.stderr);
        assert!(done.stderr.contains(words), "{words}: {}", done.stderr);
        println!("{}", done.stderr.lines().last().unwrap());
    };
    refused(&["--at", "norht=0,0,3"], "unknown camera `norht`");
    refused(&["--distance", "north-east=3"], "A,B=METRES");
    refused(
        &["--clocks", "given"],
        "set it with --rate-hz north-east=HZ",
    );
    refused(&["--rate-hz", "50"], "--clocks given, or unknown");
    let broken = light.folder.path("north-east.txt");
    fs::write(&broken, "frame x y\n0 1.0 2.0\n1 1.0\n").unwrap();
    refused(&[], "north-east.txt:3");
}

#[test]
fn a_calibration_survives_a_round_trip_through_another_format() {
    let sample = SampleFolder::new();
    let ours = sample.path("calibration.toml");
    let convert = |from: &Path, to: &str, out: &Path| {
        let words = [
            "calibrate",
            "convert",
            from.to_str().unwrap(),
            "--to",
            to,
            "--out",
        ];
        let done = farfield(&[&words[..], &[out.to_str().unwrap()]].concat());
        assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
        println!("{}", done.stdout);
    };
    let (there, back) = (sample.path("there"), sample.path("back"));
    convert(&ours, "qualisys", &there);
    convert(&there.join("calibration.qca.txt"), "farfield", &back);
    let (first, second) = (
        calibration(&ours),
        calibration(&back.join("calibration.toml")),
    );
    assert_eq!(first.cameras.len(), second.cameras.len());
    for (name, camera) in &first.cameras {
        let same = &second.cameras[name];
        let apart_m = (camera.center().coordinates_m() - same.center().coordinates_m()).norm();
        assert!(apart_m < 1e-6, "{}: {apart_m} m", camera.name());
    }
}

#[test]
fn images_of_a_chessboard_calibrate_a_lens() {
    let needed = "data/pose2sim/single/intrinsics/int_cam01_img";
    let Some(pictures) = recording("pictures of a chessboard", needed) else {
        return;
    };
    let out = tempfile::tempdir().unwrap();
    let words = [
        "calibrate",
        "board",
        pictures.to_str().unwrap(),
        "--chessboard",
        "4x7",
    ];
    let more = ["--square-mm", "60", "--camera", "cam01", "--out"];
    let done = farfield(&[&words[..], &more, &[out.path().to_str().unwrap()]].concat());
    println!("{}", done.stdout);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    assert!(out.path().join("cam01.yml").is_file() || out.path().join("cam01.yaml").is_file());
    let eight = [
        &words[..],
        &more,
        &[
            out.path().to_str().unwrap(),
            "--coefficients",
            "8",
            "--replace",
        ],
    ];
    let done = farfield(&eight.concat());
    assert_eq!(
        done.code, 2,
        "eight coefficients of seven pictures: {}",
        done.stdout
    );
    assert!(
        done.stderr.contains("do not carry 8 coefficients"),
        "{}",
        done.stderr
    );
}

#[test]
fn an_upright_phone_video_of_a_chessboard_calibrates_a_lens() {
    let needed = "data/pose2sim/single/intrinsics/int_cam01_img";
    let Some(pictures) = recording("a video of a chessboard", needed) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let film = |args: &[&str], name: &str| {
        let filmed = Command::new("ffmpeg")
            .args(["-nostdin", "-v", "error"])
            .args(args)
            .arg(name)
            .current_dir(folder.path())
            .status();
        match filmed {
            Err(error) if error.kind() == ErrorKind::NotFound => false,
            filmed => filmed.unwrap().success(),
        }
    };
    // Images with growing intervals, which a run would refuse.
    let shown = fs::read_dir(&pictures).unwrap();
    let shown = shown.map(|entry| entry.unwrap().path().display().to_string());
    let mut shown: Vec<String> = shown.filter(|path| path.ends_with("_int.jpg")).collect();
    shown.sort();
    let shown = shown.iter().enumerate();
    let shown = shown.map(|(i, path)| format!("file '{path}'\nduration 0.{}\n", i + 2));
    let shown: String = shown.take(8).collect();
    fs::write(folder.path().join("shown.txt"), shown).unwrap();
    let varying = ["-f", "concat", "-safe", "0", "-i", "shown.txt"];
    let slower = ["-fps_mode", "passthrough", "-bf", "0"];
    let codec = ["-c:v", "libx264", "-crf", "10", "-pix_fmt", "yuv420p"];
    fs::create_dir(folder.path().join("videos")).unwrap();
    if !film(&[&varying[..], &slower, &codec].concat(), "level.mp4") {
        print_skipped("a video of a chessboard: no ffmpeg with libx264");
        return;
    }
    let turned = ["-i", "level.mp4", "-c", "copy"];
    let how = ["-metadata:s:v:0", "rotate=90"];
    assert!(film(
        &[turned.as_slice(), how.as_slice()].concat(),
        "videos/upright.mp4"
    ));
    let path = |name: &str| folder.path().join(name).display().to_string();
    let calibrate_board = |recorded: &[&str], board: &str| {
        let words = [
            "calibrate",
            "board",
            "--camera",
            "phone",
            "--json",
            "--replace",
        ];
        let out = path("lens");
        let more = ["--chessboard", board, "--square-mm", "60", "--out", &out];
        farfield(&[&words[..], &more, recorded].concat())
    };
    let [videos, level] = [path("videos"), path("level.mp4")];
    let done = calibrate_board(&[&videos], "4x7");
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let report: Value = serde_json::from_str(&done.stdout).unwrap();
    assert!(report["rms_px"].as_f64().unwrap() < 0.5, "{report}");

    let refused = calibrate_board(&[&videos], "3x4");
    assert_eq!(refused.code, 2, "{}", refused.stdout);
    let counted = "expected 3 x 4: count the corners";
    assert!(refused.stderr.contains(counted), "{}", refused.stderr);

    // If this ffmpeg writes the orientation of the phone, the two videos are not of one camera.
    let unrotated = calibrate_board(&[&level], "4x7");
    let unrotated: Value = serde_json::from_str(&unrotated.stdout).unwrap();
    if report["size_px"] != unrotated["size_px"] {
        let refused = calibrate_board(&[&level, &videos], "4x7");
        assert_eq!(refused.code, 2, "{}", refused.stdout);
        let why = "the camera was turned on its side";
        assert!(refused.stderr.contains(why), "{}", refused.stderr);
    }
}

/// The calibration in a file.
pub(super) fn calibration(path: &Path) -> Calibration {
    Calibration::parse(&fs::read_to_string(path).unwrap(), path).unwrap()
}

/// The sample with observations and the true calibration.
pub(super) struct SeenHall {
    pub(super) folder: SampleFolder,
    pub(super) truth: Calibration,
    files: Vec<PathBuf>,
}

impl SeenHall {
    /// Writes a file `CAMERA.extension` with `seen_by(camera, index)` for each camera.
    pub(super) fn new(extension: &str, seen_by: impl Fn(&CameraModel, usize) -> String) -> Self {
        let folder = SampleFolder::new();
        let truth = calibration(&folder.path("calibration.toml"));
        let mut files = Vec::new();
        for (number, camera) in truth.cameras.values().enumerate() {
            let path = folder.path(&format!("{}.{extension}", camera.name()));
            fs::write(&path, seen_by(camera, number)).unwrap();
            files.push(path);
        }
        Self {
            folder,
            truth,
            files,
        }
    }

    /// Runs `farfield calibrate KIND` with the true lenses.
    pub(super) fn calibrate(&self, kind: &str, more: &[&str]) -> FinishedCommand {
        let lens = self.folder.path("calibration.toml");
        let out = self.folder.path("found.toml");
        let mut words = vec!["calibrate".to_owned(), kind.to_owned()];
        words.extend(self.files.iter().map(|path| path.display().to_string()));
        words.extend(["--lens".to_owned(), lens.display().to_string()]);
        words.extend(["--out".to_owned(), out.display().to_string()]);
        words.extend(more.iter().map(|word| (*word).to_owned()));
        farfield(&words)
    }
}
