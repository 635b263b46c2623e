//! Names and edits of people: of a run, of a recording, in exports, and undone.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::data::SampleFolder;
use crate::farfield::{FinishedCommand, farfield, run};

/// A run of the sample with its recording.
fn recorded_run() -> SampleFolder {
    let sample = SampleFolder::new();
    run(
        &sample.path("venue.toml"),
        &sample.path("out"),
        &["--record"],
    );
    sample
}

fn people(run: &Path, words: &[&str]) -> FinishedCommand {
    let run = run.to_str().unwrap();
    farfield(&[&["people", run], words].concat())
}

/// `farfield people RUN --json WORDS`.
fn listed(run: &Path, words: &[&str]) -> Value {
    let done = people(run, &[words, &["--json"]].concat());
    assert_eq!(done.code, 0, "{words:?}\n{}\n{}", done.stdout, done.stderr);
    serde_json::from_str(&done.stdout).unwrap()
}

fn edit(run: &Path, words: &[&str]) -> String {
    let done = people(run, words);
    assert_eq!(done.code, 0, "{words:?}\n{}\n{}", done.stdout, done.stderr);
    println!("{}", done.stdout.trim());
    done.stdout
}

fn refused(run: &Path, words: &[&str], message: &str) {
    let done = people(run, words);
    assert_eq!(done.code, 2, "{words:?}\n{}", done.stdout);
    assert!(done.stderr.contains(message), "{message}: {}", done.stderr);
    println!("{}", done.stderr.trim());
}

/// The files of an export by name.
fn exported(run: &Path, to: &Path, words: &[&str]) -> BTreeMap<String, Vec<u8>> {
    let words = [
        &[
            "export",
            run.to_str().unwrap(),
            "--out",
            to.to_str().unwrap(),
        ],
        words,
    ];
    let done = farfield(&words.concat());
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    println!("{}", done.stderr.trim());
    let entries = fs::read_dir(to).unwrap().map(|entry| entry.unwrap());
    entries
        .map(|entry| {
            let name = entry.file_name().into_string().unwrap();
            (name, fs::read(entry.path()).unwrap())
        })
        .collect()
}

fn names(files: &BTreeMap<String, Vec<u8>>) -> Vec<&str> {
    files.keys().map(String::as_str).collect()
}

fn text(files: &BTreeMap<String, Vec<u8>>, name: &str) -> String {
    String::from_utf8_lossy(&files[name]).into_owned()
}

#[test]
fn names_splits_and_merges_are_exported_and_undone_to_the_last_byte() {
    let sample = recorded_run();
    let out = sample.path("out");
    let formats = ["--format", "bvh,gltf,c3d,csv,csv-tidy,parquet,osim,trc,mot"];
    let before = exported(&out, &sample.path("before"), &formats);

    let people_before = listed(&out, &[]);
    let rows = people_before["people"].as_array().unwrap();
    let ids: Vec<u64> = rows
        .iter()
        .map(|row| row["person"].as_u64().unwrap())
        .collect();
    let [one, other] = ids.as_slice() else {
        panic!("the sample has two people: {ids:?}");
    };
    let (one, other) = (one.to_string(), other.to_string());
    assert!(rows[0]["sigma_m"].as_f64().unwrap() > 0.0);

    refused(&out, &["merge", &other, "--into", &one], "both at ticks");
    refused(
        &out,
        &["name", "77", "Cleo"],
        "found person 77, expected one of",
    );
    edit(&out, &["name", &one, "Anna/Ž"]);
    edit(&out, &["name", &other, "Bo"]);
    let split = edit(&out, &["split", &one, "--at", "60"]);
    let new = (other.parse::<u64>().unwrap() + 1).to_string();
    assert!(
        split.contains(&format!("{one} is {new} from tick 60 on")),
        "{split}"
    );
    edit(&out, &["name", &new, "Bo"]);
    let table = edit(&out, &[]);
    assert!(
        table.contains("Anna/Ž") && table.contains("edits in"),
        "{table}"
    );

    let edited = exported(&out, &sample.path("edited"), &formats);
    // Characters that file names cannot have are replaced, and two people with the same name get their ids added.
    for name in [
        "poses_Anna_Ž.bvh".to_owned(),
        format!("poses_Bo_{other}.csv"),
        format!("model_Bo_{new}.osim"),
    ] {
        assert!(edited.contains_key(&name), "{name}: {:?}", names(&edited));
    }
    let gltf = text(&edited, "poses.gltf");
    assert!(gltf.contains("Anna/Ž") && gltf.contains(&format!("Bo {new}")));
    assert!(text(&edited, "poses_tidy.csv").contains("Anna/Ž"));

    // The two halves merged again are the original person.
    edit(&out, &["merge", &new, "--into", &one]);
    let named = exported(&out, &sample.path("named"), &["--format", "csv"]);
    assert_eq!(named.len(), 2);
    let whole = text(&before, &format!("poses_{one}.csv"));
    assert_eq!(
        text(&named, "poses_Anna_Ž.csv").lines().count(),
        whole.lines().count()
    );

    let left_out = sample.path("as-found");
    assert!(
        exported(
            &out,
            &left_out,
            &[&formats[..], &["--without-edits"]].concat()
        ) == before
    );
    refused(&out, &["undo", "3"], "undo edit 4 before");
    for _ in 0..5 {
        edit(&out, &["undo"]);
    }
    refused(&out, &["undo"], "there is no edit to undo");
    assert!(exported(&out, &sample.path("after"), &formats) == before);
}

#[test]
fn dropped_people_are_in_no_file() {
    let sample = recorded_run();
    let out = sample.path("out");
    let rows = listed(&out, &[]);
    let one = rows["people"][0]["person"].to_string();
    let left = listed(&out, &["drop", &one]);
    assert_eq!(left["people"].as_array().unwrap().len(), 1);
    assert_eq!(left["edits"][0]["text"], format!("{one} is left out"));
    let files = exported(&out, &sample.path("left"), &["--format", "bvh,csv-tidy"]);
    assert_eq!(files.len(), 2, "{:?}", names(&files));
}

#[test]
fn an_invalid_list_of_edits_is_refused_with_its_line() {
    let sample = recorded_run();
    let out = sample.path("out");
    let one = listed(&out, &[])["people"][0]["person"].to_string();
    edit(&out, &["name", &one, "Anna"]);
    let edits = out.join("edits.jsonl");
    let good = fs::read_to_string(&edits).unwrap();
    fs::write(
        &edits,
        format!("{good}{{\"at\":\"now\",\"edit\":\"rename\"}}\n"),
    )
    .unwrap();
    refused(&out, &[], "edits.jsonl:2: `edit`: found \"rename\"");
    refused(&out, &["name", &one, "Bo"], "edits.jsonl:2: ");
    let out = out.to_str().unwrap();
    let done = farfield(&["export", out, "--format", "bvh"]);
    assert_eq!(done.code, 2, "{}", done.stdout);
    assert!(done.stderr.contains("edits.jsonl:2: "), "{}", done.stderr);
    assert!(!Path::new(out).join("export").exists());
}

/// The rows of a table by their first column, the time.
fn rows(table: &str) -> BTreeMap<String, String> {
    let rows = table.lines().skip(1).filter_map(|row| row.split_once(','));
    rows.map(|(time, rest)| (time.to_owned(), rest.to_owned()))
        .collect()
}

#[test]
fn a_recording_exports_like_its_run_after_people_are_confirmed() {
    let sample = recorded_run();
    let (out, recording) = (
        sample.path("out"),
        sample.path("out").join("recording.mcap"),
    );
    let one = listed(&recording, &[])["people"][0]["person"].to_string();
    edit(&recording, &["name", &one, "Anna"]);
    edit(&out, &["name", &one, "Anna"]);
    assert!(out.join("recording.edits.jsonl").is_file());

    let formats = ["--format", "csv,bvh"];
    let from_run = exported(&out, &sample.path("of-run"), &formats);
    let from_recording = exported(&recording, &sample.path("of-recording"), &formats);
    assert_eq!(names(&from_run), names(&from_recording));
    let (ours, theirs) = (
        text(&from_run, "poses_Anna.csv"),
        text(&from_recording, "poses_Anna.csv"),
    );
    let (ours, theirs) = (rows(&ours), rows(&theirs));
    assert!(ours.keys().eq(theirs.keys()), "other ticks");
    let (mut equal, mut only_run) = (0, 0);
    for (second, row) in &ours {
        let other = &theirs[second];
        if other == row {
            equal += 1;
        } else {
            assert!(other.contains("absent"), "second {second}: {other}");
            only_run += 1;
        }
    }
    println!("{equal} rows are equal, {only_run} are of the run only");
    assert!(equal > 60 && only_run < 45, "{equal} {only_run}");
    let left = fs::read_dir(sample.path("of-recording")).unwrap().count();
    assert_eq!(left, from_recording.len());
}
