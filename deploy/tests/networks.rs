//! Tests of the real `farfield` with installed networks: none of them needs a connection.
#![expect(
    clippy::unwrap_used,
    reason = "what goes wrong in a test fails it, with its place"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const CARD: &str = r#"kind = "heatmap"
file = "own.onnx"
input = { name = "image", width = 192, height = 256, channels = "rgb" }
normalize = { scale = 0.00392156862745098, mean = [0.0, 0.0, 0.0], std = [1.0, 1.0, 1.0] }
output = { name = "heatmaps", width = 48, height = 64, keypoints = "coco17" }
cell_to_input = { scale = 4.0, offset = 0.0 }
box_margin = 1.25
"#;

/// A folder with recordings `recordings` of the sample's cameras, and installed networks `networks`.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let recordings = folder.path().join("recordings");
        fs::create_dir_all(&recordings).unwrap();
        for camera in ["ne-left", "ne-right", "sw"] {
            fs::write(recordings.join(camera).with_extension("mp4"), "").unwrap();
        }
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("calibration.sample.toml");
        fs::copy(sample, recordings.join("calibration.toml")).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Installs the network `own`, whose ONNX file is not one.
    fn install_own(&self) {
        let own = self.path("networks/own");
        fs::create_dir_all(&own).unwrap();
        fs::write(own.join("own.toml"), CARD).unwrap();
        fs::write(own.join("own.onnx"), "weights").unwrap();
    }

    /// Runs the built program in the folder, without any package manager.
    fn farfield(&self, args: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_farfield"))
            .args(args)
            .current_dir(self.folder.path())
            .stdin(Stdio::null())
            .env("FARFIELD_NETWORKS", self.path("networks"))
            .env("PATH", self.path("no-programs"))
            .env_remove("RUST_LOG")
            .output()
            .unwrap()
    }

    /// The error of a command that is refused.
    fn refusal(&self, args: &[&str]) -> String {
        let output = self.farfield(args);
        let error = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{args:?}: {error}");
        error
    }
}

#[test]
fn init_without_a_network_names_the_command_that_installs_one() {
    let place = Place::new();
    let error = place.refusal(&["init", "recordings", "--rate", "60"]);
    assert!(
        error.contains("`farfield networks install blazepose movenet-people`"),
        "{error}"
    );
}

#[test]
fn init_writes_the_name_of_an_installed_network() {
    let place = Place::new();
    place.install_own();
    let output = place.farfield(&["init", "recordings", "--rate", "60"]);
    let printed = String::from_utf8_lossy(&output.stderr);
    assert!(
        printed.contains("using the network own; installed: own;"),
        "{printed}"
    );
    let venue = fs::read_to_string(place.path("recordings/venue.toml")).unwrap();
    assert!(venue.contains("\nnetwork = \"own\" "), "{venue}");
    // The venue's network is the installed file.
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(report.contains("networks/own/own.onnx"), "{report}");
}

#[test]
fn a_venue_with_a_network_that_is_not_installed_names_the_command() {
    let place = Place::new();
    place.install_own();
    place.farfield(&["init", "recordings", "--rate", "60"]);
    fs::remove_dir_all(place.path("networks")).unwrap();
    let output = place.farfield(&["check", "recordings/venue.toml"]);
    let report = String::from_utf8_lossy(&output.stdout);
    assert!(
        report.contains("`farfield networks install own`"),
        "{report}"
    );
}

#[test]
fn networks_are_listed_and_wrong_requests_refused() {
    let place = Place::new();
    place.install_own();
    let list = place.farfield(&["networks", "list", "--json"]);
    let list: serde_json::Value = serde_json::from_slice(&list.stdout).unwrap();
    assert_eq!(list["installed"][0]["name"], "own");
    assert_eq!(list["installed"][0]["task"], "keypoints");
    assert_eq!(list["known"][0]["name"], "blazepose");

    let error = place.refusal(&["networks", "install", "blazepos"]);
    assert!(error.contains("blazepose"), "{error}");
    let error = place.refusal(&["networks", "install", "blazepose"]);
    for part in [
        "npm, pip",
        "npm pack @mediapipe/pose@0.5.1675469404",
        "mediapipe==0.10.21",
        "--from FILE",
    ] {
        assert!(error.contains(part), "{error}");
    }
    let video = [
        "networks",
        "install",
        "blazepose",
        "--from",
        "recordings/sw.mp4",
    ];
    let error = place.refusal(&video);
    assert!(error.contains("the file is not used"), "{error}");
    let error = place.refusal(&["networks", "check", "none"]);
    assert!(error.contains("not installed"), "{error}");
    assert_eq!(
        place.farfield(&["networks", "check", "own"]).status.code(),
        Some(1)
    );
}

#[test]
fn the_cards_of_the_documentation_are_valid() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs");
    let mut cards = 0;
    for page in ["networks.md", "venue.md"] {
        let text = fs::read_to_string(docs.join(page)).unwrap();
        let blocks = text.split("```toml\n").skip(1);
        let blocks = blocks.filter_map(|it| it.split("```").next());
        for card in blocks.filter(|it| it.starts_with("kind = ")) {
            farfield_proto::model_card::ModelCard::parse(card, Path::new("card.toml")).unwrap();
            cards += 1;
        }
    }
    assert_eq!(cards, 4);
}

/// Writes `card` with `changes` as `NAME.toml` to the folder, and returns what `networks check` prints.
fn checked(place: &Place, card: &str, name: &str, changes: &[(&str, &str)]) -> String {
    let mut card = card.to_owned();
    for (from, to) in changes {
        assert!(card.contains(from), "{from}");
        card = card.replace(from, to);
    }
    fs::write(place.path(&format!("{name}.toml")), card).unwrap();
    let output = place.farfield(&["networks", "check", &format!("{name}.toml")]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    println!("{name}: {text}");
    text
}

/// Each of these errors lets a network run, and makes all poses a little wrong.
#[test]
fn a_card_that_does_not_fit_its_network_is_found_on_rendered_people() {
    let place = Place::new();
    let card = farfield_sim::embedded::write_network(place.folder.path()).unwrap();
    let text = fs::read_to_string(place.path(card)).unwrap();
    let fine = checked(&place, &text, "fine", &[]);
    assert!(
        fine.contains("24 rendered people") && !fine.contains("failed"),
        "{fine}"
    );
    assert!(!fine.contains("rendered people better"), "{fine}");
    let shifted = checked(
        &place,
        &text,
        "shifted",
        &[("offset = 1.5", "offset = 3.5")],
    );
    assert!(
        shifted.contains("do not fit with an `offset` of 3.50"),
        "{shifted}"
    );
    let reordered = checked(&place, &text, "reordered", &[("\"coco17\"", REORDERED)]);
    assert!(
        reordered.contains("2 of 12 limbs: map 14 (`left_knee`) shows right_knee"),
        "{reordered}"
    );
    let all = checked(&place, &text, "all", &[("\"coco17\"", REVERSED)]);
    assert!(
        all.contains("map 11 (`left_shoulder`) shows left_hip"),
        "{all}"
    );
    let dark = checked(
        &place,
        &text,
        "dark",
        &[("scale = 0.00392156862745098", "scale = 0.001")],
    );
    assert!(dark.contains("rendered people better"), "{dark}");
}

/// COCO's keypoints, the last first.
const REVERSED: &str = r#"["right_ankle", "left_ankle", "right_knee", "left_knee", "right_hip", "left_hip", "right_wrist", "left_wrist", "right_elbow", "left_elbow", "right_shoulder", "left_shoulder", "right_ear", "left_ear", "right_eye", "left_eye", "nose"]"#;
/// COCO's keypoints with the knees exchanged.
const REORDERED: &str = r#"["nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "right_knee", "left_knee", "left_ankle", "right_ankle"]"#;
