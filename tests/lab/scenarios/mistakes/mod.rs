//! Mistakes of new users in files and on command lines: exit code and message.
//!
//! The list was written before the mistakes were tried. The scenarios of `agreement` cover cameras that disagree.

mod input;
mod newer;
mod usage;

use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::OnceLock;

use crate::data::checkout;
use crate::farfield::{command, finish, run};

/// A mistake of a new user.
struct Mistake {
    what: &'static str,
    /// Makes the mistake in a folder that holds the sample venue.
    make: fn(&Path),
    /// Arguments of `farfield` in that folder, separated by spaces.
    words: &'static str,
    code: i32,
    /// Parts of the message on standard error.
    expected: &'static [&'static str],
}

/// Makes each mistake in a folder of its own, and checks exit code and message.
fn check_mistakes(mistakes: &[Mistake]) {
    let mut faults = Vec::new();
    for mistake in mistakes {
        let folder = sample();
        (mistake.make)(folder.path());
        let mut command = command();
        command
            .current_dir(folder.path())
            .args(mistake.words.split(' '));
        let output = finish(&command.output().unwrap());
        let Mistake { what, code, .. } = mistake;
        println!("{what} -> {}: {}", output.code, output.stderr.trim());
        let is_reported = mistake
            .expected
            .iter()
            .all(|word| output.stderr.contains(word));
        let is_panic = output.stderr.contains("panicked");
        if output.code != *code || !is_reported || is_panic || mistake.expected.is_empty() {
            faults.push(format!(
                "{what}: expected exit code {code} and {:?}, found {}:\n{}{}",
                mistake.expected, output.code, output.stdout, output.stderr
            ));
        }
        // The named folder of results, and the default one.
        let is_left = ["out", "farfield-out"].map(|name| folder.path().join(name).is_dir());
        if *code == 2 && is_left.contains(&true) {
            faults.push(format!("{what}: refused, and results were written"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
}

/// The sample venue with its truth, and the results of a run in `good`.
fn sample() -> tempfile::TempDir {
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

fn nothing(_: &Path) {}

/// Replaces all occurrences of a text that must exist.
fn replace(folder: &Path, file: &str, from: &str, to: &str) {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    assert!(text.contains(from), "{file} has no {from:?} to spoil");
    fs::write(folder.join(file), text.replace(from, to)).unwrap();
}

fn write(folder: &Path, file: &str, text: &str) {
    fs::write(folder.join(file), text).unwrap();
}

/// Shifts the ticks of a file of JSON lines.
fn change_ticks(folder: &Path, file: &str, by: i64) {
    change_lines(folder, file, |line| {
        line["tick"] = (line["tick"].as_i64().unwrap() + by).into();
    });
}

/// Cuts a file after its first `n` lines.
fn keep_lines(folder: &Path, file: &str, n: usize) {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    let kept: Vec<&str> = text.lines().take(n).collect();
    fs::write(folder.join(file), kept.join("\n") + "\n").unwrap();
}

/// Changes every line of a file of JSON lines.
fn change_lines(folder: &Path, file: &str, change: impl Fn(&mut serde_json::Value)) {
    let text = fs::read_to_string(folder.join(file)).unwrap();
    let lines = text.lines().map(|line| {
        let mut line = serde_json::from_str(line).unwrap();
        change(&mut line);
        format!("{line}\n")
    });
    let changed: String = lines.collect();
    fs::write(folder.join(file), changed).unwrap();
}

/// Makes a file by ffmpeg; without ffmpeg the file is missing.
fn ffmpeg(folder: &Path, options: &str, file: &str) {
    let mut command = Command::new("ffmpeg");
    command
        .args(["-loglevel", "error"])
        .args(options.split(' '));
    drop(command.arg(folder.join(file)).status());
}

/// Gives the first camera a video instead of keypoints.
fn with_video(folder: &Path, file: &str) {
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
