//! The sample files next to the code parse, and state the true defaults.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use clap::Parser as _;
use farfield_proto::calibration::Calibration;
use farfield_proto::venue::parameters::sample;
use farfield_proto::venue::{Parameters, Venue};
use farfield_sim::fault_profile::FaultProfile;
use farfield_sim::scene::Scene;
use toml::{Table, Value};

use crate::cli::{FarfieldCli, joined};

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn read(name: &str) -> String {
    std::fs::read_to_string(path(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

#[test]
fn the_sample_venue_parses_and_states_every_default() {
    let text = read("venue.sample.toml");
    let calibration_path = path("calibration.sample.toml");
    let calibration =
        Calibration::parse(&read("calibration.sample.toml"), &calibration_path).unwrap();
    let venue = Venue::parse(&text, &path("venue.sample.toml"), calibration).unwrap();
    assert_eq!(venue.cameras.len(), 3);
    assert_eq!(venue.parameters, Parameters::default());
    // After a change of a parameter, copy the text printed here into the sample.
    let parameters = sample();
    assert!(
        text.ends_with(&parameters),
        "the sample venue must end with:\n{parameters}"
    );
}

#[test]
fn the_sample_venue_lists_optional_fields_and_live_sources() {
    let text = read("venue.sample.toml");
    // Fields without a default, and live sources, which no sample can open.
    for shown in [
        "# margin = 1.25",
        "# quality = \"default\"",
        "`farfield parameters`",
        "kind = \"v4l\"",
        "kind = \"ffmpeg\"",
        "kind = \"simulated\", path = \"scene.toml\", content = \"maps\"",
    ] {
        assert!(text.contains(shown), "{shown}");
    }
    let sample: Table = toml::from_str(&text).unwrap();
    let mut tables: Vec<&str> = sample
        .iter()
        .filter(|(_, v)| matches!(v, Value::Table(_)))
        .map(|(k, _)| k.as_str())
        .collect();
    tables.sort_unstable();
    let known = [
        "births",
        "boxes",
        "field",
        "fusion",
        "inference",
        "link",
        "range_of_motion",
        "recording",
        "security",
        "smoothing",
    ];
    assert_eq!(tables, known);
}

#[test]
fn the_sample_scene_parses_and_states_the_standard_faults() {
    let scene = Scene::load(&path("scene.sample.toml")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!((scene.people().len(), scene.cameras().len()), (2, 8));
    assert_eq!(*scene.faults(), FaultProfile::standard());
}

/// The command of a unit, as a shell takes it.
fn command_of(unit: &str) -> Vec<String> {
    let text = read(unit);
    for section in ["[Unit]", "[Service]", "[Install]"] {
        assert!(
            text.lines().any(|line| line == section),
            "{unit} has no {section}"
        );
    }
    let known = |line: &str| {
        line.is_empty() || line.starts_with(['#', '[']) || line.split_once('=').is_some()
    };
    assert!(
        text.lines().all(known),
        "{unit} has a line that is no setting"
    );
    let start = text
        .lines()
        .find_map(|line| line.strip_prefix("ExecStart="))
        .unwrap();
    start
        .split_whitespace()
        .map(|word| word.replace("%i", "north-east"))
        .collect()
}

#[test]
fn the_units_start_nodes_with_valid_arguments() {
    for (unit, node) in [
        ("systemd/farfield-edge@.service", "edge"),
        ("systemd/farfield-fusion.service", "fusion"),
    ] {
        let command = command_of(unit);
        assert!(command[0].ends_with("/farfield"), "{}", command[0]);
        assert_eq!(command[1], node);
        let command = joined(command.into_iter().map(OsString::from));
        FarfieldCli::try_parse_from(command).unwrap_or_else(|error| panic!("{unit}: {error}"));
    }
}

/// Checks the units with systemd itself; prints that it was skipped without systemd.
#[test]
fn systemd_finds_nothing_wrong_with_the_units() {
    let folder = tempfile::tempdir().unwrap();
    let units = ["farfield-fusion.service", "farfield-edge@.service"].map(|unit| {
        // The programs are not installed here.
        let text: Vec<String> = read(&format!("systemd/{unit}"))
            .lines()
            .map(|line| match line.strip_prefix("ExecStart=") {
                Some(command) => {
                    let arguments = command.split_once(' ').map_or("", |(_, rest)| rest);
                    format!("ExecStart=/bin/true {arguments}")
                }
                None => line.to_owned(),
            })
            .collect();
        let copy = folder.path().join(unit.replace('@', "@north-east"));
        std::fs::write(&copy, text.join("\n")).unwrap();
        copy
    });
    let verify = std::process::Command::new("systemd-analyze")
        .arg("verify")
        .args(&units)
        .output();
    let Ok(verify) = verify else {
        println!("SKIPPED: systemd-analyze is not there");
        return;
    };
    let errors = String::from_utf8_lossy(&verify.stderr);
    let own = errors.lines().filter(|line| line.contains("farfield"));
    assert_eq!(own.collect::<Vec<_>>(), [""; 0], "{errors}");
}
