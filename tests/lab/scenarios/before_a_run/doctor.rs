//! `farfield doctor` on this machine: what is wrong with a process or a disk of its own. The other faults are tests of the
//! doctor's parts.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use super::{lines, says};
use crate::data::SampleFolder;
use crate::farfield::{FinishedCommand, command, finish};

/// Longest that a doctor may take, seconds; the tests' machine is shared.
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
fn this_machine_fails_in_nothing_and_is_done_in_seconds() {
    let folder = tempfile::tempdir().unwrap();
    let start = Instant::now();
    let finished = doctor(folder.path(), |_| (), &[]);
    let took_s = start.elapsed().as_secs_f64();
    println!("doctor took {took_s:.1} s\n{}", finished.stdout);
    let said = lines(&finished);
    for group in ["machine", "inference", "programs", "disk", "clock", "ports"] {
        assert!(
            said.iter().any(|line| line[0] == group),
            "{group}: {said:#?}"
        );
    }
    // Without ffmpeg, or with fusion's port in use, it is right to complain.
    let may_fail = |group: &str| ["programs", "ports"].contains(&group);
    let failed: Vec<_> = said
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
fn an_onnx_runtime_that_is_not_there_or_is_none_is_found() {
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
            says(&lines(&finished), "failed", &words),
            "{}",
            finished.stdout
        );
    }
}

/// The library that inference uses here, where there is one.
fn library_of_this_machine(folder: &Path) -> Option<PathBuf> {
    let said = lines(&doctor(folder, |_| (), &[]));
    let words = said.iter().find_map(|line| {
        let (_, path) = line[2].split_once("inference by ONNX Runtime (`")?;
        Some(path.split_once('`')?.0.into())
    });
    if words.is_none() {
        println!("skipped a copy that is cut off: ONNX Runtime is not installed");
    }
    words
}

#[test]
fn libraries_that_cannot_be_used_are_named_and_the_next_place_is_tried() {
    // Symptom: the first file that could not be used ended the program, by a panic or by SIGBUS. Cause: it was loaded
    // in this process, and `ort` keeps what a failure leaves.
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
    let said = lines(&finished);
    for (path, why) in &refused {
        let words = [path.to_str().unwrap(), *why];
        assert!(says(&said, "warning", &words), "{words:?}: {said:#?}");
    }
    let used = library.as_ref().and_then(|path| path.to_str());
    let words = [used.unwrap_or("ort-tract"), "inference by"];
    assert!(says(&said, "warning", &words), "{said:#?}");
    assert!(says(&said, "ok", &["network of the demo"]), "{said:#?}");
}

#[test]
fn a_temporary_folder_that_is_not_there_is_found_and_no_venue_is_blamed() {
    let folder = tempfile::tempdir().unwrap();
    let finished = doctor(
        folder.path(),
        |it| {
            it.env("TMPDIR", "/nowhere");
        },
        &[],
    );
    assert_eq!(finished.code, 1);
    let said = lines(&finished);
    let words = ["no temporary folder", "/nowhere", "set TMPDIR"];
    assert!(says(&said, "failed", &words), "{said:#?}");
    assert!(!says(&said, "failed", &["correct `network`"]), "{said:#?}");
}

#[test]
fn both_networks_are_run_and_timed() {
    let folder = tempfile::tempdir().unwrap();
    let said = lines(&doctor(folder.path(), |_| (), &[]));
    for words in [
        ["network of the demo", "crops per second"],
        ["detector of the demo", "ms per picture of"],
    ] {
        assert!(says(&said, "ok", &words), "{words:?}: {said:#?}");
    }
}

#[test]
fn a_search_path_without_ffmpeg_is_found() {
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
        says(&lines(&finished), "failed", &words),
        "{}",
        finished.stdout
    );
}

#[test]
fn a_full_disk_is_found() {
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
    let said = lines(&finished);
    assert!(
        says(&said, "failed", &["disk cannot be written", "--out DIR"]),
        "{said:#?}"
    );
}

#[test]
fn the_network_of_a_venue_that_is_not_there_is_found_and_a_venue_that_is_not_is_refused() {
    let folder = SampleFolder::new();
    folder.replace(
        "venue.toml",
        "rate_hz = 30.0",
        "rate_hz = 30.0\nnetwork = \"models/no.toml\"",
    );
    let finished = doctor(folder.folder(), |_| (), &["venue.toml"]);
    assert_eq!(finished.code, 1);
    assert!(
        says(
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
    let said = lines(&finished);
    assert!(says(&said, "failed", &words), "{said:#?}");
    // They were looked for meanwhile.
    assert_eq!(said.last().unwrap()[0], "nodes", "{said:#?}");
    let finished = doctor(folder.folder(), |_| (), &["no.toml"]);
    assert_eq!(finished.code, 2, "{}", finished.stderr);
}
