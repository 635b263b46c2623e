//! `ort-tract` gives what the network means. A binary of its own: a process has one backend.
#![cfg(feature = "network")]

mod hues;

use farfield_edge::network::{BackendChoice, InferenceBackend};

#[test]
fn tract_agrees_with_the_reference_and_says_what_it_costs() {
    let backend = InferenceBackend::start(BackendChoice::Tract).unwrap();
    assert!(backend.is_tract());
    let line = backend.describe();
    assert!(
        line.contains("times slower") && !line.contains('\n'),
        "{line}"
    );
    hues::check_against_reference();
}

/// RTMDet's layout ended the process: tract counts the integers of `labels` symbolically, `ort`
/// knows no such type and panics. The output is cast to floats before the file is loaded.
#[test]
fn a_detector_with_integer_labels_runs_on_tract() {
    assert!(
        InferenceBackend::start(BackendChoice::Tract)
            .unwrap()
            .is_tract()
    );
    hues::check_detector();
    hues::check_labels();
}
