//! The backend of this machine gives the expected results and refuses files that do not match their
//! card.
#![cfg(feature = "network")]

mod hues;

use std::path::{Path, PathBuf};

use farfield_edge::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};

#[test]
fn the_best_backend_agrees_with_the_reference() {
    let backend = InferenceBackend::start(BackendChoice::Best).unwrap();
    if backend.is_tract() {
        println!("skipped ONNX Runtime: {}", backend.describe());
    }
    hues::check_against_reference();
    hues::check_simcc();
}

fn refusal(card: &Path) -> String {
    OnnxKeypointNetwork::load(card)
        .expect_err("the network must be refused")
        .to_string()
}

/// The card of the good network with one change, next to a copy of its model.
fn changed(folder: &Path, from: &str, to: &str) -> PathBuf {
    with_changes(folder, &[(from, to)])
}

/// The same with several changes.
fn with_changes(folder: &Path, changes: &[(&str, &str)]) -> PathBuf {
    let read = std::fs::read_to_string(hues::testdata("hues17_128x96.toml"));
    let mut card = read.expect("the card is committed");
    for (from, to) in changes {
        assert!(card.contains(from));
        card = card.replace(from, to);
    }
    let model = "hues17_128x96.onnx";
    std::fs::copy(hues::testdata(model), folder.join(model)).expect("the model is committed");
    let path = folder.join("card.toml");
    std::fs::write(&path, card).expect("the folder is writable");
    path
}

#[test]
fn a_network_with_14_maps_is_refused_by_name() {
    let error = refusal(&hues::testdata("hues14_128x96.toml"));
    assert!(
        error.contains("hues14_128x96.onnx") && error.contains("14 maps") && error.contains("17"),
        "{error}"
    );
}

#[test]
fn a_network_that_does_not_fit_its_card_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    // Twice as wide, with its cells: a consistent card of another network.
    let twice = [("width = 96", "width = 192"), ("width = 24", "width = 48")];
    let image = [("name = \"image\"", "name = \"picture\"")];
    let maps = [("name = \"heatmaps\"", "name = \"maps\"")];
    let rows = [("height = 32", "height = 33")];
    for (changes, word) in [
        (image.as_slice(), "`picture`"),
        (&maps, "`maps`"),
        (&twice, "192 columns"),
        (&rows, "33 rows"),
    ] {
        let error = refusal(&with_changes(folder.path(), changes));
        assert!(
            error.contains("hues17_128x96.onnx") && error.contains(word),
            "{error}"
        );
    }
}

#[test]
fn a_file_that_is_not_onnx_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let card = changed(folder.path(), "hues17_128x96.onnx", "text.onnx");
    assert!(refusal(&card).contains("text.onnx"));
    std::fs::write(
        folder.path().join("text.onnx"),
        "not a network\n".repeat(50),
    )
    .unwrap();
    let error = refusal(&card);
    assert!(
        error.contains("text.onnx") && error.contains("ONNX") && !error.contains('\n'),
        "{error}"
    );
    assert!(refusal(&folder.path().join("no.toml")).contains("no.toml"));
}

#[test]
fn the_fingerprint_covers_model_and_card() {
    let folder = tempfile::tempdir().unwrap();
    let hash = |card: &Path| {
        OnnxKeypointNetwork::load(card)
            .unwrap()
            .model_hash()
            .to_owned()
    };
    let same = hash(&changed(folder.path(), "1.25", "1.25"));
    let other = hash(&changed(folder.path(), "1.25", "1.3"));
    assert_eq!(same, hash(&hues::testdata("hues17_128x96.toml")));
    assert_ne!(same, other);
    assert_eq!(same.len(), 16);
}

#[test]
fn a_detector_finds_the_coloured_person_in_the_picture() {
    hues::check_detector();
    hues::check_labels();
}
