//! Valid calibrations give no finding: those of the project, of every scene, and of other programs.

use std::fmt::Write as _;
use std::path::Path;

use farfield_node::files::load_venue;
use farfield_proto::calibration::Calibration;
use farfield_proto::plausibility::{Cause, Finding, of_rotations, of_venue};
use farfield_proto::venue::{Parameters, Venue};
use farfield_sim::scene::Scene;
use farfield_sim::simulated::in_memory::{Input, venue_of};
use serde_json::Value;

use crate::data::{checkout, recording};

fn assert_no_finding(what: &Path, findings: &[Finding]) {
    let texts: Vec<String> = findings.iter().map(Finding::to_string).collect();
    assert!(findings.is_empty(), "{}: {texts:#?}", what.display());
}

#[test]
fn the_samples_give_no_finding() {
    for name in ["deploy/venue.sample.toml", "examples/walk/venue.toml"] {
        let path = checkout().join(name);
        assert_no_finding(&path, &of_venue(&load_venue(&path).unwrap()));
    }
}

#[test]
fn scenes_give_no_finding() {
    let mut seen = 0;
    for entry in std::fs::read_dir(checkout().join("sim/scenes")).unwrap() {
        let path = entry.unwrap().path();
        // The cameras of this scene stand in pairs at one place and are turned alike, which is a finding.
        if path.ends_with("stage.toml") {
            continue;
        }
        // Overlays of scenes are no scenes.
        if !std::fs::read_to_string(&path).unwrap().contains("rate_hz") {
            continue;
        }
        let scene = Scene::load(&path).unwrap_or_else(|error| panic!("{error}"));
        let venue = venue_of(&scene, &Input::Maps, Parameters::default());
        assert_no_finding(&path, &of_venue(&venue));
        seen += 1;
    }
    assert!(seen >= 10, "the scenes were read");
}

/// A venue of a calibration with one viewpoint per camera.
fn alone(calibration: Calibration, path: &Path) -> Venue {
    let mut text = "name = \"a\"\nrate_hz = 30.0\ncalibration = \"c.toml\"\n".to_owned();
    for name in calibration.cameras.keys() {
        write!(
            text,
            "[[viewpoint]]\nname = \"{name}\"\n[[viewpoint.camera]]\nname = \"{name}\"\n\
             source = {{ kind = \"keypoints\", path = \"k.jsonl\" }}\n"
        )
        .unwrap();
    }
    Venue::parse(&text, path, calibration).unwrap()
}

#[test]
fn real_calibrations_give_no_finding() {
    let scenario = "plausible calibrations";
    for name in ["shelf/venue.toml", "pose2sim/single/venue.toml"] {
        let Some(path) = recording(scenario, &format!("data/{name}")) else {
            return;
        };
        assert_no_finding(&path, &of_venue(&load_venue(&path).unwrap()));
    }
    for name in [
        "caliscope/camera_array.toml",
        "caliscope/config.toml",
        "pose2sim/single/calibration.toml",
    ] {
        let Some(path) = recording(scenario, &format!("data/{name}")) else {
            return;
        };
        let text = std::fs::read_to_string(&path).unwrap();
        let calibration = Calibration::parse(&text, &path).unwrap();
        assert_no_finding(&path, &of_rotations(&calibration));
        assert_no_finding(&path, &of_venue(&alone(calibration, &path)));
    }
}

/// Consumer cameras with known lenses only; their poses are arbitrary.
#[test]
fn real_lenses_give_no_finding() {
    let Some(folder) = recording("plausible lenses", "data/drone/intrinsics") else {
        return;
    };
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let lens: Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let text = format!(
            "[a]\nname = \"a\"\nsize = {}\nmatrix = {}\ndistortions = {}\nrotation = [1.57, 0.0, 0.0]\ntranslation = [0.0, 0.0, 9.0]\n",
            lens["resolution"], lens["K-matrix"], lens["distCoeff"]
        );
        // A lens that folds the image is refused by the reader.
        let Ok(calibration) = Calibration::parse(&text, &path) else {
            continue;
        };
        let is_lens = |it: &Finding| {
            matches!(
                it.cause,
                Cause::FieldOfView | Cause::PixelShape | Cause::PrincipalPoint | Cause::Distortion
            )
        };
        let findings = of_venue(&alone(calibration, &path));
        let lens_findings: Vec<Finding> = findings.into_iter().filter(is_lens).collect();
        assert_no_finding(&path, &lens_findings);
    }
}
