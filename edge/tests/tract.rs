//! `ort-tract` gives the expected results. A separate test binary, because a process has one
//! backend.
#![cfg(feature = "network")]

mod hues;

use farfield_edge::network::{BackendChoice, InferenceBackend};

#[test]
fn tract_agrees_with_the_reference_and_reports_its_cost() {
    let backend = InferenceBackend::start(BackendChoice::Tract).unwrap();
    assert!(backend.is_tract());
    let line = backend.describe();
    assert!(
        line.contains("times slower") && !line.contains('\n'),
        "{line}"
    );
    hues::check_against_reference();
    hues::check_simcc();
}

/// Symptom to prevent: RTMDet's layout ended the process, because tract counts the integers of
/// `labels` symbolically and `ort` panics on that type. The output is cast to floats before
/// loading.
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
