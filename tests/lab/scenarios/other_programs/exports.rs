//! The poses of the sample in the formats of other programs.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::data::SampleFolder;
use crate::farfield::{farfield, poses, run};

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_run_is_exported_in_every_format_with_the_same_bytes_again() {
    let sample = SampleFolder::new();
    let out = sample.path("out");
    run(&sample.path("venue.toml"), &out, &[]);
    let person = poses(&out)[0]["person"].to_string();
    let (folder, called) = (sample.path("taken"), format!("{person}=Ada"));
    let words = [
        "export",
        out.to_str().unwrap(),
        "--format",
        "all",
        "--out",
        folder.to_str().unwrap(),
        "--name",
        &called,
    ];
    let done = farfield(&[&words[..], &["--json"]].concat());
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let files: Vec<Value> = serde_json::from_str(&done.stdout).unwrap();
    let written = names(&folder);
    println!("{written:?}");
    assert_eq!(files.len(), written.len());
    for of_person in [
        "poses_Ada.bvh",
        "poses_Ada.c3d",
        "poses_Ada.csv",
        "model_Ada.osim",
    ] {
        assert!(written.iter().any(|it| it == of_person), "{of_person}");
    }
    let read = || -> Vec<Vec<u8>> {
        let paths = written.iter().map(|name| folder.join(name));
        paths.map(|path| fs::read(path).unwrap()).collect()
    };
    let first = read();

    let again = farfield(&words);
    assert_eq!(again.code, 2, "{}", again.stdout);
    assert!(
        again.stderr.contains("already exists: --replace"),
        "{}",
        again.stderr
    );
    let replaced = farfield(&[&words[..], &["--replace"]].concat());
    assert_eq!(replaced.code, 0, "{}", replaced.stderr);
    assert!(replaced.stdout.contains("person "), "{}", replaced.stdout);
    assert!(first == read(), "other bytes the second time");
    assert_eq!(names(&folder), written, "nothing is left over");
}

#[test]
fn impossible_exports_are_refused_and_leave_nothing() {
    let sample = SampleFolder::new();
    let out = sample.path("out");
    run(&sample.path("venue.toml"), &out, &["--ticks", "0..30"]);
    let out = out.to_str().unwrap().to_owned();
    for (words, message) in [
        (
            vec![out.as_str(), "--format", "fbx"],
            "`fbx` is not one of bvh, glb",
        ),
        (vec![&out, "--format", "bvh", "--person", "77"], "77"),
        (
            vec![&out, "--format", "bvh", "--gaps", "mark"],
            "bvh has no place for marks",
        ),
        (vec![&out, "--format", "csv", "--ticks", "900..990"], "900"),
        (
            vec!["hall.mcap", "--format", "csv"],
            "the recording does not exist",
        ),
        (vec!["nowhere", "--format", "csv"], "nowhere"),
    ] {
        let done = farfield(&[&["export"], &words[..]].concat());
        assert_eq!(done.code, 2, "{words:?}\n{}\n{}", done.stdout, done.stderr);
        assert!(done.stderr.contains(message), "{message}: {}", done.stderr);
        println!("{}", done.stderr.trim());
    }
    let files = names(Path::new(&out));
    assert!(
        files
            .iter()
            .all(|name| !name.contains("export") && !name.contains(".tmp")),
        "{files:?}"
    );
}
