//! The venue file of an import, short and commented as the sample is.

use std::fmt::Write as _;

use toml::Value;

/// A camera of the venue.
pub(crate) struct VenueCamera<'a> {
    /// As the calibration has it.
    pub(crate) name: &'a str,
    /// Its keypoint file, relative to the venue file.
    pub(crate) keypoints: &'a str,
}

/// The text; every camera is a viewpoint.
pub(crate) fn venue_text(
    name: &str,
    rate_hz: f64,
    calibration: &str,
    cameras: &[VenueCamera<'_>],
) -> String {
    let mut text = String::from(
        "# A venue of keypoints, made by `farfield import`. All that it may say: deploy/venue.sample.toml, `farfield parameters`.\n",
    );
    for (left, comment) in [
        (
            format!("name = {}", quoted(name)),
            "first part of every Zenoh key",
        ),
        (
            format!("rate_hz = {rate_hz:?}"),
            "ticks per second, the same for all cameras",
        ),
        (
            format!("calibration = {}", quoted(calibration)),
            "where the cameras stand: metres, z up",
        ),
    ] {
        // Writing to a string does not fail.
        writeln!(text, "{left:<48} # {comment}").ok();
    }
    for camera in cameras {
        writeln!(
            text,
            "\n[[viewpoint]]\nname = {}\n[[viewpoint.camera]]\nname = {}\nsource = {{ kind = \"keypoints\", path = {} }}",
            quoted(&key_chunk(camera.name)),
            quoted(camera.name),
            quoted(camera.keypoints)
        )
        .ok();
    }
    text
}

/// A name as a part of Zenoh keys, and of file names, may be.
pub(crate) fn key_chunk(name: &str) -> String {
    let letter = |c: char| {
        if c.is_ascii_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '-'
        }
    };
    let name: String = name.chars().take(64).map(letter).collect();
    if name.trim_matches('.').is_empty() {
        "venue".to_owned()
    } else {
        name
    }
}

/// A text as TOML quotes it.
fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_parts_of_keys() {
        for (name, chunk) in [
            ("cam 1/é", "cam-1--"),
            ("", "venue"),
            ("..", "venue"),
            ("a.b", "a.b"),
        ] {
            assert_eq!(key_chunk(name), chunk);
        }
    }
}
