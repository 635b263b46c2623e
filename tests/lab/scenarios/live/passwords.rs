//! Passwords of cameras: in the venue file, and in no output or file of a run.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use farfield_sim::embedded::{write_detector, write_network};

use crate::data::SampleFolder;
use crate::farfield::{command, finish};

const PASSWORD: &str = "geheim-42";
const TOKEN: &str = "t0ken-7";
/// Long enough for two attempts to open a camera, and for statuses.
const RUNS_FOR: Duration = Duration::from_secs(6);

/// All files below `folder`.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let below = |path: PathBuf| {
        if path.is_dir() {
            files(&path)
        } else {
            vec![path]
        }
    };
    paths.flat_map(below).collect()
}

fn holds_secret(bytes: &[u8]) -> bool {
    [PASSWORD, TOKEN].iter().any(|secret| {
        let mut windows = bytes.windows(secret.len());
        windows.any(|window| window == secret.as_bytes())
    })
}

#[test]
fn a_live_run_neither_prints_nor_writes_passwords_of_cameras() {
    let sample = SampleFolder::new();
    let network = write_network(sample.folder()).unwrap();
    let detector = write_detector(sample.folder()).unwrap();
    let cards = format!(
        "calibration = \"calibration.toml\"\nnetwork = \"{network}\"\ndetector = \"{detector}\""
    );
    sample.replace("venue.toml", "calibration = \"calibration.toml\"", &cards);
    for corner in ["north-east", "north-west", "south-west", "south-east"] {
        // No server runs at this port, so ffmpeg prints an error with the address.
        let url = format!("http://admin:{PASSWORD}@127.0.0.1:1/{corner}?token={TOKEN}");
        let file = format!("kind = \"keypoints\", path = \"{corner}.jsonl\"");
        sample.replace(
            "venue.toml",
            &file,
            &format!("kind = \"ffmpeg\", url = \"{url}\""),
        );
    }
    let (venue, out) = (sample.path("venue.toml"), sample.path("run"));
    let mut run = command();
    run.arg("run")
        .arg(&venue)
        .args(["--live", "--record", "--out"])
        .arg(&out);
    let run = run
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(RUNS_FOR);
    let status = command()
        .arg("status")
        .arg(&venue)
        .arg("--json")
        .output()
        .unwrap();
    let stopped = Command::new("kill")
        .args(["-INT", &run.id().to_string()])
        .status();
    assert!(stopped.unwrap().success());
    let output = run.wait_with_output().unwrap();

    let finished = finish(&output);
    assert!(
        finished.stderr.contains("camera `north-east`"),
        "{}",
        finished.stderr
    );
    for (what, bytes) in [
        ("stdout", &output.stdout),
        ("stderr", &output.stderr),
        ("status", &status.stdout),
        ("stderr of status", &status.stderr),
    ] {
        assert!(
            !holds_secret(bytes),
            "{what}: {}",
            String::from_utf8_lossy(bytes)
        );
    }
    // The venue file itself holds the secrets.
    let mut written = files(sample.folder());
    written.retain(|path| *path != venue);
    assert!(
        written.iter().any(|path| path.ends_with("summary.json")),
        "{written:?}"
    );
    let mut recordings = written
        .iter()
        .filter(|path| path.extension().is_some_and(|it| it == "mcap"));
    assert!(recordings.next().is_some(), "{written:?}");
    for path in &written {
        assert!(
            !holds_secret(&fs::read(path).unwrap()),
            "{}",
            path.display()
        );
    }
}
