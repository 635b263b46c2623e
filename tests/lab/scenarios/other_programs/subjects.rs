//! Subjects of a venue: a body saved in one session is recognised by name in the next, in its exports and its replay.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::data::checkout;
use crate::farfield::{farfield, poses, run};
use crate::recording::replayed;

/// Writes the demo's court as maps to `folder`; returns its venue file.
fn court(folder: &Path) -> PathBuf {
    let scene = checkout().join("sim/scenes/court.toml");
    let (scene, out) = (scene.to_str().unwrap(), folder.join("court"));
    let words = ["simulate", scene, "--as", "maps", "--ticks", "0..300"];
    succeed(&[&words[..], &["--out", out.to_str().unwrap()]].concat());
    out.join("venue.toml")
}

fn succeed(words: &[&str]) -> String {
    let done = farfield(words);
    assert_eq!(done.code, 0, "{words:?}\n{}\n{}", done.stdout, done.stderr);
    done.stdout
}

/// The lines of a list of edits.
fn edits(file: &Path) -> Vec<Value> {
    let text = fs::read_to_string(file).unwrap();
    let lines = text.lines().filter(|line| !line.is_empty());
    lines
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// Writes the venue file with subjects added.
fn with_subjects(venue: &Path, name: &str, subjects: &str) -> PathBuf {
    let text = fs::read_to_string(venue).unwrap();
    let at = text.find("[[viewpoint]]").unwrap();
    let path = venue.with_file_name(name);
    let text = format!("{}{subjects}\n{}", &text[..at], &text[at..]);
    fs::write(&path, text).unwrap();
    path
}

#[test]
fn a_saved_body_is_recognised_in_later_sessions_and_exports() {
    let dir = tempfile::tempdir().unwrap();
    let venue = court(dir.path());
    let first = dir.path().join("first");
    run(&venue, &first, &[]);
    let words = |of: &Path| of.to_str().unwrap().to_owned();
    let profile = dir.path().join("court/anna.toml");
    succeed(&["people", &words(&first), "name", "1", "Anna"]);
    succeed(&[
        "people",
        &words(&first),
        "save",
        "1",
        "--to",
        &words(&profile),
    ]);

    // No person on the court matches the other subject, so it names none.
    let subjects =
        "[[subject]]\nprofile = \"anna.toml\"\n[[subject]]\nname = \"Giant\"\nstature_m = 2.4\n";
    let known = with_subjects(&venue, "known.toml", subjects);
    let second = dir.path().join("second");
    let finished = run(&known, &second, &["--record"]);
    let guesses = edits(&second.join("edits.jsonl"));
    println!("{guesses:?}\n{}", finished.stdout);
    let [guess] = guesses.as_slice() else {
        panic!("one is known: {guesses:?}")
    };
    assert_eq!(guess["edit"], "guess");
    assert_eq!(
        (&guess["person"], &guess["name"]),
        (&1.into(), &"Anna".into())
    );
    assert!(
        finished.stdout.contains("person 1 (Anna): "),
        "{}",
        finished.stdout
    );
    let check = farfield(&[
        "check",
        &words(&known),
        "--out",
        &words(&dir.path().join("check")),
    ]);
    assert!(check.stdout.contains("Anna, Giant"), "{}", check.stdout);

    let export = dir.path().join("export");
    succeed(&[
        "export",
        &words(&second),
        "--format",
        "csv",
        "--out",
        &words(&export),
    ]);
    assert!(export.join("poses_Anna.csv").is_file());
    assert_eq!(fs::read_dir(&export).unwrap().count(), 4);

    // Link lengths are drawn to those of the profile, and so differ from the first session.
    assert!(poses(&first) != poses(&second), "the profile has no effect");

    // The recording contains the profile: a replay elsewhere gives the same.
    fs::remove_file(&profile).unwrap();
    let again = dir.path().join("again");
    let recording = second.join("recording.mcap");
    let report = replayed(&recording, &again, &[]);
    assert_eq!(report["replay"]["different_ticks"], 0);
    assert!(poses(&second) == poses(&again), "poses.jsonl differs");
    let again = edits(&again.join("edits.jsonl"));
    assert_eq!(again.len(), 1);
    assert_eq!(again[0]["name"], "Anna");

    // Without the profile the venue is refused before the run starts.
    let third = dir.path().join("third");
    let refused = farfield(&["run", &words(&known), "--out", &words(&third)]);
    assert_eq!(refused.code, 2, "{}", refused.stdout);
    let message = "`subject[0].profile`: cannot read ";
    assert!(refused.stderr.contains(message), "{}", refused.stderr);
    assert!(!third.exists());
}

#[test]
fn a_replay_carries_over_the_edits_of_its_recording() {
    let dir = tempfile::tempdir().unwrap();
    let venue = court(dir.path());
    let words = |of: &Path| of.to_str().unwrap().to_owned();
    let out = dir.path().join("out");
    run(&venue, &out, &["--record", "--ticks", "0..90"]);
    let recording = out.join("recording.mcap");
    for (person, name) in [("1", "Anna"), ("2", "Bo")] {
        succeed(&["people", &words(&recording), "name", person, name]);
    }
    succeed(&["people", &words(&recording), "drop", "3"]);
    let list = fs::read_to_string(out.join("recording.edits.jsonl")).unwrap();

    // An identical replay copies the list.
    let again = dir.path().join("again");
    replayed(&recording, &again, &[]);
    assert_eq!(fs::read_to_string(again.join("edits.jsonl")).unwrap(), list);

    // A replay with other parameters matches people by place.
    let otherwise = dir.path().join("otherwise");
    replayed(&recording, &otherwise, &["--set", "smoothing.cutoff_hz=3"]);
    let made: Vec<(String, u64)> = edits(&otherwise.join("edits.jsonl"))
        .iter()
        .map(|edit| {
            let what = edit["name"].as_str().or(edit["edit"].as_str()).unwrap();
            (what.to_owned(), edit["person"].as_u64().unwrap())
        })
        .collect();
    let expected = [("Anna", 1), ("Bo", 2), ("drop", 3)];
    assert_eq!(made, expected.map(|(what, id)| (what.to_owned(), id)));
}
