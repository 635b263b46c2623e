//! Folders with the sample venue, and ways to spoil what is in them.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use crate::data::checkout;
use crate::farfield::run;

/// The sample venue with a truth and, in `good`, what a run of it has left.
pub(super) fn sample() -> tempfile::TempDir {
    static GOOD: OnceLock<tempfile::TempDir> = OnceLock::new();
    let walk = checkout().join("examples/walk");
    let good = GOOD.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        run(
            &walk.join("venue.toml"),
            &folder.path().join("good"),
            &["--record"],
        );
        folder
    });
    let folder = tempfile::tempdir().unwrap();
    copy(&walk, folder.path());
    fs::create_dir(folder.path().join("good")).unwrap();
    copy(&good.path().join("good"), &folder.path().join("good"));
    folder
}

fn copy(from: &Path, to: &Path) {
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
    }
}

pub(super) fn nothing(_: &Path) {}

/// Replaces what must be there, everywhere.
pub(super) fn replace(folder: &Path, file: &str, from: &str, to: &str) {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    assert!(text.contains(from), "{file} has no {from:?} to spoil");
    fs::write(folder.join(file), text.replace(from, to)).unwrap();
}

pub(super) fn write(folder: &Path, file: &str, text: &str) {
    fs::write(folder.join(file), text).unwrap();
}

/// Moves the ticks of a file of lines.
pub(super) fn change_ticks(folder: &Path, file: &str, by: i64) {
    change_lines(folder, file, |line| {
        line["tick"] = (line["tick"].as_i64().unwrap() + by).into();
    });
}

/// Cuts a file after its first `n` lines.
pub(super) fn keep_lines(folder: &Path, file: &str, n: usize) {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    let kept: Vec<&str> = text.lines().take(n).collect();
    fs::write(folder.join(file), kept.join("\n") + "\n").unwrap();
}

/// Changes every line of a file of JSON lines.
pub(super) fn change_lines(folder: &Path, file: &str, change: impl Fn(&mut serde_json::Value)) {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    let lines = text.lines().map(|line| {
        let mut line = serde_json::from_str(line).unwrap();
        change(&mut line);
        format!("{line}\n")
    });
    let changed: String = lines.collect();
    fs::write(folder.join(file), changed).unwrap();
}

/// Makes a file by ffmpeg, of what its options say; nothing without ffmpeg, and then the file is missing.
pub(super) fn ffmpeg(folder: &Path, options: &str, file: &str) {
    let mut command = Command::new("ffmpeg");
    command
        .args(["-loglevel", "error"])
        .args(options.split(' '));
    drop(command.arg(folder.join(file)).status());
}

/// Lets the first camera have a video in place of its keypoints.
pub(super) fn with_video(folder: &Path, file: &str) {
    let card = checkout().join("edge/testdata/hues17_128x96.toml");
    let rate = "rate_hz = 30.0";
    replace(
        folder,
        "venue.toml",
        rate,
        &format!("{rate}\nnetwork = \"{}\"", card.display()),
    );
    replace(
        folder,
        "venue.toml",
        "kind = \"keypoints\", path = \"north-east.jsonl\"",
        &format!("kind = \"video\", path = \"{file}\""),
    );
}
