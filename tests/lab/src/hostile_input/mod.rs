//! The bodies of the fuzz targets, as ordinary functions.
//!
//! Each function passes input of any content to the code that receives it, and panics if a promise is broken. It returns a
//! description of its behaviour: inputs with the same description took the same path, as far as visible from outside. A test
//! replays the corpus through these functions. `fuzz/`, which is outside the workspace, includes this folder by its path, so
//! nothing here names another module of this crate.

mod foreign;
pub(crate) mod messages;
mod outside;
mod recorded;
mod texts;

/// Processes an input, and returns a description of its behaviour.
pub type Target = fn(&[u8]) -> String;

/// The fuzz targets by name, sorted.
pub const TARGETS: [(&str, Target); 22] = [
    ("calibration_text", texts::calibration_text),
    ("clicked_marks_text", outside::clicked_marks_text),
    ("clip_text", texts::clip_text),
    ("edits_text", outside::edits_text),
    (
        "foreign_calibration_text",
        foreign::foreign_calibration_text,
    ),
    ("foxglove_request_text", outside::foxglove_request_text),
    ("imported_keypoints", outside::imported_keypoints),
    ("keypoints_text", texts::keypoints_text),
    ("lsl_requests", outside::lsl_requests),
    ("maps_file", recorded::maps_file),
    ("model_card_text", texts::model_card_text),
    ("page_request_text", outside::page_request_text),
    ("patch_decode", messages::patch_decode),
    ("point_sightings_text", foreign::point_sightings_text),
    ("poses_text", texts::poses_text),
    ("qtm_packets", outside::qtm_packets),
    ("recording_file", recorded::recording_file),
    ("ring_segment", recorded::ring_segment),
    ("run_text", foreign::run_text),
    ("scene_text", texts::scene_text),
    ("venue_text", texts::venue_text),
    ("wire_decode", messages::wire_decode),
];

/// The target of this name.
pub fn target(name: &str) -> Option<Target> {
    let entry = TARGETS.iter().find(|(known, _)| *known == name);
    entry.map(|(_, target)| *target)
}

/// The valid UTF-8 at the start of `bytes`.
fn text(bytes: &[u8]) -> &str {
    bytes.utf8_chunks().next().map_or("", |chunk| chunk.valid())
}

/// The behaviour of a parser of which only errors have details.
fn read_or_refused<T, E: std::fmt::Display>(result: &Result<T, E>) -> String {
    match result {
        Ok(_) => "read".to_owned(),
        Err(error) => refused(error),
    }
}

/// The behaviour of a refusal: its message without digits, which hold positions.
fn refused(error: &impl std::fmt::Display) -> String {
    let mut why = format!("refused: {error}");
    why.retain(|c| !c.is_ascii_digit());
    why
}

/// The magnitude of a number, so that behaviours do not differ by every single one.
fn size(number: usize) -> u32 {
    usize::BITS - number.leading_zeros()
}
