//! `farfield init`: a venue from a folder of recordings and a calibration.

use std::fs;
use std::path::Path;

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;

use crate::data::{SampleFolder, checkout};

#[test]
fn a_folder_of_recordings_and_a_calibration_become_a_venue_that_runs() {
    let folder = SampleFolder::new();
    fs::remove_file(folder.path("venue.toml")).unwrap();
    fs::rename(
        folder.path("north-east.jsonl"),
        folder.path("take 2 North_East.jsonl"),
    )
    .unwrap();
    let finished = folder.farfield(&["init", ".", "--rate", "30"]);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    assert!(
        finished
            .stdout
            .ends_with("next: farfield run ./venue.toml --overlay\n"),
        "{}",
        finished.stdout
    );
    let text = fs::read_to_string(folder.path("venue.toml")).unwrap();
    for part in ["rate_hz = 30.0", "take 2 North_East.jsonl", "[field]", "# "] {
        assert!(text.contains(part), "{part} in\n{text}");
    }
    let finished = folder.farfield(&["run", "venue.toml", "--ticks", "0..10", "--out", "out"]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
}

#[test]
fn an_existing_venue_file_is_not_overwritten() {
    let folder = SampleFolder::new();
    let before = fs::read(folder.path("venue.toml")).unwrap();
    let finished = folder.farfield(&["init", ".", "--rate", "30"]);
    assert_eq!(finished.code, 2);
    assert!(
        finished.stderr.contains("venue.toml already exists"),
        "{}",
        finished.stderr
    );
    assert_eq!(fs::read(folder.path("venue.toml")).unwrap(), before);
}

#[test]
fn missing_input_is_refused_with_the_flag_or_the_names() {
    let folder = SampleFolder::new();
    fs::remove_file(folder.path("venue.toml")).unwrap();
    let refused = |args: &[&str], words: &[&str]| {
        let finished = folder.farfield(&[&["init", "."], args].concat());
        assert_eq!(finished.code, 2, "{}", finished.stdout);
        for word in words {
            assert!(
                finished.stderr.contains(word),
                "{word}: {}",
                finished.stderr
            );
        }
        assert!(!folder.path("venue.toml").exists());
    };
    refused(&[], &["no frame rate", "--rate"]);
    refused(
        &["--rate", "30", "--viewpoint", "a=nort-east"],
        &["did you mean `north-east`"],
    );
    fs::rename(folder.path("south-west.jsonl"), folder.path("south.jsonl")).unwrap();
    refused(
        &["--rate", "30"],
        &[
            "`south` is of no camera",
            "camera `south-west` has no recording",
            "cameras of the calibration: north-east,",
        ],
    );
    fs::rename(
        folder.path("calibration.toml"),
        folder.path("calibration.txt"),
    )
    .unwrap();
    // The content makes it a calibration; the unmatched recording is still refused.
    refused(&["--rate", "30"], &["`south` is of no camera"]);
    let text = fs::read_to_string(folder.path("calibration.txt")).unwrap();
    let place = "translation = [1.7763568394002505e-15,";
    assert!(text.contains(place));
    let moved = text.replace(place, "translation = [0.5,");
    fs::write(folder.path("older.toml"), moved).unwrap();
    refused(
        &["--rate", "30"],
        &[
            "found several different calibrations in .",
            "./calibration.txt (20",
            "it places camera north-east 0.500 m away",
            "--calibration FILE",
        ],
    );
    fs::remove_file(folder.path("older.toml")).unwrap();
    fs::remove_file(folder.path("calibration.txt")).unwrap();
    refused(
        &["--rate", "30"],
        &["found no calibration in .", "--calibration"],
    );
}

#[test]
fn an_invalid_card_is_refused_before_a_file_is_written() {
    let folder = SampleFolder::new();
    fs::remove_file(folder.path("venue.toml")).unwrap();
    let card = checkout().join("edge/testdata/hues17_128x96.toml");
    let card = card.to_str().unwrap();
    for (args, words) in [
        (["--network", "no.toml"], ["the card", "no.toml"]),
        (
            ["--network", "calibration.toml"],
            ["calibration.toml", "kind"],
        ),
        (["--detector", card], [card, "expected \"detector\""]),
    ] {
        let finished = folder.farfield(&[&["init", ".", "--rate", "30"], &args[..]].concat());
        assert_eq!(finished.code, 2, "{}", finished.stdout);
        for word in words {
            assert!(
                finished.stderr.contains(word),
                "{word}: {}",
                finished.stderr
            );
        }
        assert!(!folder.path("venue.toml").exists());
    }
}

#[test]
fn named_cameras_make_a_viewpoint_and_others_are_left_out() {
    let folder = SampleFolder::new();
    let finished = folder.farfield(&[
        "init",
        ".",
        "--rate",
        "30",
        "--out",
        "two.toml",
        "--field=-3,-3,3,3",
        "--viewpoint",
        "north=north-east,north-west",
        "--viewpoint",
        "south=south-east",
    ]);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    let text = fs::read_to_string(folder.path("two.toml")).unwrap();
    assert_eq!(text.matches("[[viewpoint]]").count(), 2, "{text}");
    assert_eq!(text.matches("[[viewpoint.camera]]").count(), 3, "{text}");
    assert!(text.contains("min_m = [-3.0, -3.0, -0.3]"), "{text}");
}

#[test]
fn a_calibration_of_another_program_is_converted() {
    let folder = SampleFolder::new();
    fs::remove_file(folder.path("venue.toml")).unwrap();
    let to_theirs = [
        "calibrate",
        "convert",
        "calibration.toml",
        "--out",
        "theirs",
    ];
    let converted = folder.farfield(&[&to_theirs[..], &["--to", "qualisys"]].concat());
    assert_eq!(converted.code, 0, "{}", converted.stderr);
    let theirs = fs::read_dir(folder.path("theirs")).unwrap().next();
    fs::rename(theirs.unwrap().unwrap().path(), folder.path("session.txt")).unwrap();
    let before = fs::read_to_string(folder.path("calibration.toml")).unwrap();
    fs::remove_file(folder.path("calibration.toml")).unwrap();
    let finished = folder.farfield(&["init", ".", "--rate", "30"]);
    assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
    let read = |text: &str| Calibration::parse(text, Path::new("calibration.toml")).unwrap();
    let after = fs::read_to_string(folder.path("venue-calibration.toml")).unwrap();
    let [before, after] = [read(&before), read(&after)];
    for (name, was) in &before.cameras {
        let is = &after.cameras[name];
        let apart_m = (was.center().coordinates_m() - is.center().coordinates_m()).norm();
        assert!(apart_m < 0.001, "{name}: {apart_m} m");
    }
    let finished = folder.farfield(&["run", "venue.toml", "--ticks", "0..10", "--out", "out"]);
    assert_eq!(finished.code, 0, "{}", finished.stderr);
}

#[test]
fn pictures_without_padding_are_accepted_unless_exact_sizes_are_requested() {
    let folder = SampleFolder::new();
    fs::remove_file(folder.path("venue.toml")).unwrap();
    let calibration = fs::read_to_string(folder.path("calibration.toml")).unwrap();
    let calibration = Calibration::parse(&calibration, Path::new("calibration.toml")).unwrap();
    let cut_px = |camera: &CameraModel| {
        let [width, height] = camera.size_px();
        [width, height - 8]
    };
    for (name, camera) in &calibration.cameras {
        fs::remove_file(folder.path(&format!("{name}.jsonl"))).unwrap();
        fs::create_dir(folder.path(name)).unwrap();
        let [width, height] = cut_px(camera);
        let picture = image::RgbImage::new(width, height);
        for file in ["000000.png", "000001.png"] {
            picture
                .save(folder.path(&format!("{name}/{file}")))
                .unwrap();
        }
    }
    let card = checkout().join("edge/testdata/hues17_128x96.toml");
    let card = card.to_str().unwrap();
    let init = ["init", ".", "--rate", "30", "--network", card];
    let exact = folder.farfield(&[&init[..], &["--exact-sizes"]].concat());
    assert_eq!(exact.code, 1, "{}", exact.stderr);
    assert!(
        exact.stdout.contains("the calibration's `size`"),
        "{}",
        exact.stdout
    );
    assert!(!folder.path("venue-calibration.toml").exists());
    fs::remove_file(folder.path("venue.toml")).unwrap();
    folder.farfield(&init);
    let text = fs::read_to_string(folder.path("venue-calibration.toml")).unwrap();
    let adapted = Calibration::parse(&text, Path::new("calibration.toml")).unwrap();
    for (name, was) in &calibration.cameras {
        let is = &adapted.cameras[name];
        assert_eq!(is.size_px(), cut_px(was));
        assert_eq!(is.intrinsics(), was.intrinsics());
    }
}
