//! `farfield doctor` on this machine, with faults of a process or a disk. Unit tests of the doctor cover the other faults.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use super::{has_line, lines};
use crate::data::SampleFolder;
use crate::farfield::{FinishedCommand, command, finish};

/// Longest accepted duration of the doctor, seconds; the test machine is shared.
const PATIENCE_S: f64 = 5.0;

fn doctor(folder: &Path, change: impl FnOnce(&mut Command), more: &[&str]) -> FinishedCommand {
    let mut command = command();
    command
        .current_dir(folder)
        .args(["doctor", "--json"])
        .args(more);
    change(&mut command);
    finish(&command.output().unwrap())
}

#[test]
#[expect(
    clippy::disallowed_methods,
    reason = "how long the doctor takes is what is measured"
)]
fn this_machine_passes_within_seconds() {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let finished = doctor(folder.path(), |_| (), &[]);
    let took_s = start.elapsed().as_secs_f64();
    println!("doctor took {took_s:.1} s\n{}", finished.stdout);
    let report = lines(&finished);
    for group in ["machine", "inference", "programs", "disk", "clock", "ports"] {
        assert!(
            report.iter().any(|line| line[0] == group),
            "{group}: {report:#?}"
        );
    }
    // A missing ffmpeg and a used port of fusion are correct findings.
    let may_fail = |group: &str| ["programs", "ports"].contains(&group);
    let failed: Vec<_> = report
        .iter()
        .filter(|it| it[1] == "failed" && !may_fail(&it[0]))
        .collect();
    assert!(failed.is_empty(), "{failed:#?}");
    assert!(took_s < 3.0 * PATIENCE_S, "{took_s} s");
    assert_eq!(
        fs::read_dir(folder.path()).unwrap().count(),
        0,
        "nothing is left over"
    );
}

#[test]
fn a_missing_or_invalid_onnx_runtime_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("libonnxruntime.so");
    fs::write(&text, "no library").unwrap();
    for path in [Path::new("/nowhere/libonnxruntime.so"), &text] {
        let finished = doctor(
            folder.path(),
            |it| {
                it.env("ORT_DYLIB_PATH", path);
            },
            &[],
        );
        assert_eq!(finished.code, 1);
        let words = [path.to_str().unwrap(), "unset ORT_DYLIB_PATH"];
        assert!(
            has_line(&lines(&finished), "failed", &words),
            "{}",
            finished.stdout
        );
    }
}

/// The ONNX Runtime library of this machine, if it is installed.
fn library_of_this_machine(folder: &Path) -> Option<PathBuf> {
    let report = lines(&doctor(folder, |_| (), &[]));
    let words = report.iter().find_map(|line| {
        let (_, path) = line[2].split_once("inference by ONNX Runtime (`")?;
        Some(path.split_once('`')?.0.into())
    });
    if words.is_none() {
        println!("skipped a copy that is cut off: ONNX Runtime is not installed");
    }
    words
}

#[test]
fn unusable_libraries_are_reported_and_the_next_place_is_tried() {
    // Symptom to prevent: the first unusable file ended the program, by a panic or by SIGBUS. Cause: it was loaded in this
    // process, and `ort` keeps the state of a failed load.
    const NAME: &str = "libonnxruntime.so";
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).join(NAME);
    let library = library_of_this_machine(folder.path());
    fs::create_dir_all(at("a_folder")).unwrap();
    let mut refused = vec![(at("a_folder"), "it is a folder")];
    for name in ["text", "cut_off"] {
        fs::create_dir_all(folder.path().join(name)).unwrap();
    }
    fs::write(at("text"), "no library").unwrap();
    refused.push((at("text"), "failed to load"));
    if let Some(library) = &library {
        let bytes = fs::read(library).unwrap();
        fs::write(at("cut_off"), &bytes[..bytes.len() / 30]).unwrap();
        refused.push((at("cut_off"), "SIGBUS"));
    }
    let places = std::env::join_paths(refused.iter().filter_map(|(path, _)| path.parent()));
    let places = places.unwrap();
    let finished = doctor(
        folder.path(),
        |it| {
            it.env("LD_LIBRARY_PATH", &places);
        },
        &[],
    );
    let report = lines(&finished);
    for (path, why) in &refused {
        let words = [path.to_str().unwrap(), *why];
        assert!(
            has_line(&report, "warning", &words),
            "{words:?}: {report:#?}"
        );
    }
    let used = library.as_ref().and_then(|path| path.to_str());
    let words = [used.unwrap_or("ort-tract"), "inference by"];
    assert!(has_line(&report, "warning", &words), "{report:#?}");
    assert!(
        has_line(&report, "ok", &["network of the demo"]),
        "{report:#?}"
    );
}

#[test]
fn a_missing_temporary_folder_is_reported_and_the_venue_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let finished = doctor(
        folder.path(),
        |it| {
            it.env("TMPDIR", "/nowhere");
        },
        &[],
    );
    assert_eq!(finished.code, 1);
    let report = lines(&finished);
    let words = ["temporary folder", "/nowhere", "set TMPDIR"];
    assert!(has_line(&report, "failed", &words), "{report:#?}");
    assert!(
        !has_line(&report, "failed", &["correct `network`"]),
        "{report:#?}"
    );
}

#[test]
fn both_networks_are_run_and_timed() {
    let folder = tempfile::tempdir().unwrap();
    let report = lines(&doctor(folder.path(), |_| (), &[]));
    for words in [
        ["network of the demo", "crops per second"],
        ["detector of the demo", "ms per image of"],
    ] {
        assert!(has_line(&report, "ok", &words), "{words:?}: {report:#?}");
    }
}

#[test]
fn a_search_path_without_ffmpeg_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let finished = doctor(
        folder.path(),
        |it| {
            it.env("PATH", folder.path());
        },
        &[],
    );
    assert_eq!(finished.code, 1);
    let words = ["`ffmpeg` cannot be started", "apt install ffmpeg"];
    assert!(
        has_line(&lines(&finished), "failed", &words),
        "{}",
        finished.stdout
    );
}

#[test]
fn a_full_disk_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let disk = folder.path().join("disk");
    fs::create_dir(&disk).unwrap();
    let mount = Command::new("mount")
        .args(["-t", "tmpfs", "-o", "size=256k", "tmpfs"])
        .arg(&disk)
        .status();
    if !mount.is_ok_and(|status| status.success()) {
        println!("SKIPPED a full disk: mounting one takes root");
        return;
    }
    let finished = doctor(folder.path(), |_| (), &["--out", "disk"]);
    let unmounted = Command::new("umount").arg(&disk).status();
    assert!(unmounted.unwrap().success());
    assert_eq!(finished.code, 1);
    let report = lines(&finished);
    assert!(
        has_line(&report, "failed", &["disk cannot be written", "--out DIR"]),
        "{report:#?}"
    );
}

#[test]
fn a_missing_network_is_reported_and_a_missing_venue_is_refused() {
    let folder = SampleFolder::new();
    folder.replace(
        "venue.toml",
        "rate_hz = 30.0",
        "rate_hz = 30.0\nnetwork = \"models/no.toml\"",
    );
    let finished = doctor(folder.folder(), |_| (), &["venue.toml"]);
    assert_eq!(finished.code, 1);
    assert!(
        has_line(
            &lines(&finished),
            "failed",
            &["models/no.toml", "correct `network`"]
        ),
        "{}",
        finished.stdout
    );
    folder.replace("venue.toml", "network = ", "detector = ");
    let finished = doctor(folder.folder(), |_| (), &["venue.toml"]);
    assert_eq!(finished.code, 1);
    let words = ["models/no.toml", "correct `detector`"];
    let report = lines(&finished);
    assert!(has_line(&report, "failed", &words), "{report:#?}");
    // The search for nodes ran at the same time.
    assert_eq!(report.last().unwrap()[0], "nodes", "{report:#?}");
    let finished = doctor(folder.folder(), |_| (), &["no.toml"]);
    assert_eq!(finished.code, 2, "{}", finished.stderr);
}
