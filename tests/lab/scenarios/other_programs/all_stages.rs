//! From recordings of a ball to a calibration, in one run, and in two after the first was interrupted.

use std::fs;
use std::path::Path;
use std::process::Command;

use image::{Rgb, RgbImage};
use nalgebra::Vector3;

use crate::farfield::{FinishedCommand, command, finish};

/// Frames in which the ball is carried.
const FRAMES: u32 = 150;
/// Frames of the last camera: its sightings do not fit into [`LARGEST_FILE`].
const LATE_FRAMES: u32 = 900;
/// Limit of file sizes (`ulimit -f`, blocks of 512 or 1024 bytes). Sightings of the last camera exceed it, which kills the
/// process; those of other cameras do not.
const LARGEST_FILE: &str = "12";
/// Size of an image and focal length, pixels; radius of the ball, metres.
pub(super) const SIZE_PX: [u32; 2] = [320, 240];
const FOCAL_PX: f64 = 300.0;
const RADIUS_M: f64 = 0.12;
/// Positions of the cameras, metres; all face the same point.
pub(super) const CAMERAS_M: [(&str, [f64; 3]); 3] = [
    ("east", [4.0, 0.5, 2.0]),
    ("north", [-1.5, 4.2, 2.4]),
    ("west", [-3.0, -2.8, 1.8]),
];

/// Position of the ball, metres.
fn ball_m(frame: u32) -> Vector3<f64> {
    let t = 0.07 * f64::from(frame);
    Vector3::new(
        0.9 * (1.1 * t).sin(),
        0.8 * (0.83 * t + 1.0).sin(),
        1.0 + 0.6 * (0.61 * t + 0.4).sin(),
    )
}

/// Centre and radius of the ball in a camera's image, pixels.
fn drawn_px(camera_m: [f64; 3], frame: u32) -> ([f64; 2], f64) {
    let centre = Vector3::from(camera_m);
    let ahead = (Vector3::new(0.0, 0.0, 1.0) - centre).normalize();
    let right = ahead.cross(&Vector3::z()).normalize();
    let down = ahead.cross(&right);
    let to = ball_m(frame) - centre;
    let depth_m = to.dot(&ahead);
    let at = |axis: &Vector3<f64>, middle: f64| FOCAL_PX * to.dot(axis) / depth_m + middle;
    let px = [at(&right, 159.5), at(&down, 119.5)];
    (px, FOCAL_PX * RADIUS_M / depth_m)
}

/// Writes numbered images of each camera.
pub(super) fn record(recordings: &Path) {
    for (name, camera_m) in CAMERAS_M {
        let folder = recordings.join(name);
        fs::create_dir_all(&folder).unwrap();
        let frames = if name == "west" { LATE_FRAMES } else { FRAMES };
        for frame in 0..frames {
            let ([x_px, y_px], radius_px) = drawn_px(camera_m, frame);
            let picture = RgbImage::from_fn(SIZE_PX[0], SIZE_PX[1], |column, row| {
                let apart_px = (f64::from(column) - x_px).hypot(f64::from(row) - y_px);
                let ball = (radius_px + 0.5 - apart_px).clamp(0.0, 1.0);
                let level = |ball_level: f64| (ball * ball_level + (1.0 - ball) * 100.0) as u8;
                Rgb([level(240.0), level(120.0), level(20.0)])
            });
            picture
                .save(folder.join(format!("{frame:06}.png")))
                .unwrap();
        }
    }
}

/// Writes images of a camera that never sees the ball.
fn record_nothing(recordings: &Path, name: &str) {
    let folder = recordings.join(name);
    fs::create_dir_all(&folder).unwrap();
    let picture = RgbImage::from_pixel(SIZE_PX[0], SIZE_PX[1], Rgb([100, 100, 100]));
    for frame in 0..10 {
        let path = folder.join(format!("{frame:06}.png"));
        picture.save(path).unwrap();
    }
}

/// Writes the lenses of all cameras.
fn write_lenses(path: &Path) {
    let each = ["east", "north", "south", "west"].map(|name| {
        format!(
            "[{name}]\nname = \"{name}\"\nsize = [320, 240]\n\
             matrix = [[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]]\n\
             distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n\
             rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n"
        )
    });
    fs::write(path, each.concat()).unwrap();
}

/// Arguments of `farfield calibrate all` for the recordings.
fn words(recordings: &Path, more: &[&str]) -> Vec<String> {
    let options = "--lens lenses.toml --colour #f07814 --out found.toml";
    let mut words = vec!["calibrate".to_owned(), "all".to_owned()];
    words.push(recordings.display().to_string());
    words.extend(options.split(' ').map(str::to_owned));
    for (name, [x, y, z]) in CAMERAS_M {
        words.push(format!("--at={name}={x},{y},{z}"));
    }
    words.extend(more.iter().map(|word| (*word).to_owned()));
    words
}

/// Runs `farfield calibrate all` in `folder`.
fn calibrate_all(folder: &Path, recordings: &Path, more: &[&str]) -> FinishedCommand {
    let mut command = command();
    command
        .args(words(recordings, more))
        .env("RAYON_NUM_THREADS", "1")
        .current_dir(folder);
    finish(&command.output().unwrap())
}

/// [`calibrate_all`], killed while it writes the sightings of the last camera.
fn killed_at_the_last(folder: &Path, recordings: &Path) -> FinishedCommand {
    let limited = format!("ulimit -c 0; ulimit -f {LARGEST_FILE}; exec \"$@\"");
    let mut shell = Command::new("sh");
    shell
        .args(["-c", &limited, "sh"])
        .arg(command().get_program())
        .args(words(recordings, &[]))
        .env("RAYON_NUM_THREADS", "1")
        .current_dir(folder);
    finish(&shell.output().unwrap())
}

/// A folder with the lenses.
fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_lenses(&folder.path().join("lenses.toml"));
    folder
}

/// The sightings of each camera, and the calibration, whether it passes or not.
fn results(folder: &Path, done: &FinishedCommand) -> Vec<Vec<u8>> {
    assert!(done.code <= 1, "{}\n{}", done.stdout, done.stderr);
    let calibration = ["found.failed.toml", "found.toml"][usize::from(done.code == 0)];
    let seen = CAMERAS_M.map(|(name, _)| format!("seen/{name}.txt"));
    let files = seen.iter().map(String::as_str).chain([calibration]);
    files
        .map(|name| fs::read(folder.join(name)).unwrap())
        .collect()
}

/// The names in a folder, sorted.
pub(super) fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let entries = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}

#[test]
fn a_stopped_calibration_resumes_with_the_same_bytes() {
    let recorded = tempfile::tempdir().unwrap();
    let recordings = recorded.path().join("recordings");
    record(&recordings);
    let at_once = workplace();
    let whole = calibrate_all(at_once.path(), &recordings, &[]);
    println!("{}\n{}", whole.stdout, whole.stderr);
    let expected = results(at_once.path(), &whole);

    let stopped = workplace();
    let killed = killed_at_the_last(stopped.path(), &recordings);
    assert_ne!(killed.code, 0, "{}\n{}", killed.stdout, killed.stderr);
    let left = names(&stopped.path().join("seen"));
    let is_whole = |it: &&String| Path::new(it).extension() != Some("tmp".as_ref());
    let whole: Vec<&String> = left.iter().filter(is_whole).collect();
    assert_eq!(whole, ["east.txt", "north.txt"], "{}", killed.stderr);
    assert_eq!(names(stopped.path()), ["lenses.toml", "seen"]);

    let again = calibrate_all(stopped.path(), &recordings, &[]);
    assert_eq!(results(stopped.path(), &again), expected);
    // Finished sightings are reused, and the rest is computed.
    let taken_up = again
        .stderr
        .matches("from an earlier scan is reused")
        .count();
    assert_eq!(taken_up, 2, "{}", again.stderr);
    for name in ["east", "north"] {
        let message = format!("{name}.txt from an earlier scan");
        assert!(again.stderr.contains(&message), "{}", again.stderr);
    }
    let seen = names(&stopped.path().join("seen"));
    assert_eq!(seen, ["east.txt", "north.txt", "west.txt"]);

    // With another option existing sightings cannot be reused, and are not replaced without `--replace`.
    for name in names(stopped.path()) {
        if name.starts_with("found") {
            fs::remove_file(stopped.path().join(name)).unwrap();
        }
    }
    let other = ["--diameter-px", "6,300"];
    let refused = calibrate_all(stopped.path(), &recordings, &other);
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    let why = "seen/east.txt already exists: --replace replaces it";
    assert!(refused.stderr.contains(why), "{}", refused.stderr);
    assert_eq!(names(stopped.path()), ["lenses.toml", "seen"]);
}

#[test]
fn wrong_options_are_refused_before_images_are_read() {
    let recorded = tempfile::tempdir().unwrap();
    let recordings = recorded.path().join("recordings");
    for (name, _) in CAMERAS_M {
        record_nothing(&recordings, name);
    }
    let place = workplace();
    let marks = "[camera.nrth]\npost = [3.0, 4.0]\n[places]\npost = [1.0, 2.0, 0.0]\n";
    fs::write(place.path().join("marks.toml"), marks).unwrap();
    let lenses = fs::read_to_string(place.path().join("lenses.toml")).unwrap();
    let one = lenses.split("[north]").next().unwrap();
    fs::write(place.path().join("one.toml"), one).unwrap();
    fs::write(place.path().join("broken.toml"), "court = 3\n").unwrap();
    let cases: [(&[&str], &str); 13] = [
        (
            &["--at", "norht=0,0,3"],
            "--distance: unknown camera `norht`, expected one of east, north, west",
        ),
        (
            &["--at", "north=0,0,3"],
            "--at: found two positions of camera `north`",
        ),
        (&["--distance", "north,suoth=3"], "unknown camera `suoth`"),
        (
            &["--distance", "north,north=3"],
            "distance of `north` to itself",
        ),
        (
            &["--lens", "norht=one.toml"],
            "--lens: unknown camera `norht`",
        ),
        (
            &["--lens", "south=lenses.toml"],
            "found two files for camera `south`",
        ),
        (&["--lens", "nowhere.toml"], "nowhere.toml"),
        (&["--marks", "marks.toml"], "--marks: unknown camera `nrth`"),
        (&["--marks", "broken.toml"], "broken.toml:1: `court`"),
        (&["--marks", "nowhere.toml"], "nowhere.toml"),
        (
            &["--clocks", "given", "--rate-hz", "50"],
            "no offset of camera `east`: set it with --offset-s",
        ),
        (&["--gate-px", "0"], "`gate_px`: found 0"),
        (&["--diameter-px", "9,3"], "found 9 to 3"),
    ];
    for (more, words) in cases {
        let refused = calibrate_all(place.path(), &recordings, more);
        assert_eq!(refused.code, 2, "{more:?}: {}", refused.stderr);
        assert!(
            refused.stderr.contains(words),
            "{more:?}: {}",
            refused.stderr
        );
        // These recordings have no ball, which a search would have reported.
        assert!(!refused.stderr.contains("no moving ball"), "{more:?}");
        assert!(!place.path().join("seen").exists(), "{more:?}");
    }
}

#[test]
fn a_known_place_that_is_not_finite_is_refused_before_images_are_read() {
    let recorded = tempfile::tempdir().unwrap();
    let recordings = recorded.path().join("recordings");
    for (name, _) in CAMERAS_M {
        record_nothing(&recordings, name);
    }
    let place = workplace();
    let words = words(&recordings, &[]).into_iter();
    let words = words.map(|word| {
        if word.starts_with("--at=north=") {
            return "--at=north=0,0,nan".to_owned();
        }
        word
    });
    let mut calibrate = command();
    calibrate.args(words).current_dir(place.path());
    let refused = finish(&calibrate.output().unwrap());
    assert_eq!(refused.code, 2, "{}", refused.stderr);
    assert!(
        refused.stderr.contains("known place of `north`: found"),
        "{}",
        refused.stderr
    );
    assert!(!place.path().join("seen").exists());
}

#[test]
fn a_camera_that_never_saw_the_ball_has_no_pose() {
    let recorded = tempfile::tempdir().unwrap();
    let recordings = recorded.path().join("recordings");
    record(&recordings);
    record_nothing(&recordings, "south");
    let place = workplace();
    let known = ["--at", "south=0,-4,2", "--distance", "south,north=8.3"];
    let done = calibrate_all(place.path(), &recordings, &known);
    assert!(done.code <= 1, "{}\n{}", done.stdout, done.stderr);
    let message = "camera south: not found in 10 frames";
    assert!(done.stderr.contains(message), "{}", done.stderr);
    let left_out = "camera south has no sightings: its known facts are ignored";
    assert!(done.stderr.contains(left_out), "{}", done.stderr);
    let no_pose = "camera south: no pose";
    assert!(done.stdout.contains(no_pose), "{}", done.stdout);
}
