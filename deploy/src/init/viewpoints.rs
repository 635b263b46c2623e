//! Which cameras make a viewpoint.

use std::collections::BTreeSet;
use std::str::FromStr;

use anyhow::ensure;
use farfield_proto::calibration::Calibration;
use farfield_proto::toml_file::unknown_name;

/// A viewpoint with the names of its cameras: `ne=ne-left,ne-right`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ViewpointArg {
    /// Its name.
    pub(super) name: String,
    /// Its cameras, as the calibration names them.
    pub(super) cameras: Vec<String>,
}

impl FromStr for ViewpointArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, cameras) = text
            .split_once('=')
            .ok_or_else(|| format!("found `{text}`, expected NAME=CAM1,CAM2"))?;
        let cameras = cameras
            .split(',')
            .map(str::trim)
            .filter(|camera| !camera.is_empty());
        let cameras: Vec<String> = cameras.map(str::to_owned).collect();
        if cameras.is_empty() {
            return Err(format!("`{text}` names no camera, expected NAME=CAM1,CAM2"));
        }
        Ok(Self {
            name: name.trim().to_owned(),
            cameras,
        })
    }
}

/// What was asked for; else every camera of the calibration for itself.
///
/// # Errors
/// Names a camera that the calibration does not have, or that is in two viewpoints.
pub(super) fn choose(
    asked: &[ViewpointArg],
    calibration: &Calibration,
) -> anyhow::Result<Vec<ViewpointArg>> {
    let known: Vec<&str> = calibration.cameras.keys().map(String::as_str).collect();
    if asked.is_empty() {
        let alone = |camera: &&str| ViewpointArg {
            name: key_chunk(camera),
            cameras: vec![(*camera).to_owned()],
        };
        return Ok(known.iter().map(alone).collect());
    }
    let mut seen = BTreeSet::new();
    for camera in asked.iter().flat_map(|viewpoint| &viewpoint.cameras) {
        ensure!(
            known.contains(&camera.as_str()),
            "`--viewpoint`: {}",
            unknown_name("camera of the calibration", camera, &known)
        );
        ensure!(
            seen.insert(camera),
            "`--viewpoint`: camera `{camera}` is named twice"
        );
    }
    Ok(asked.to_vec())
}

/// A name as a part of Zenoh keys may be.
pub(super) fn key_chunk(name: &str) -> String {
    let letter = |c: char| {
        if c.is_ascii_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '-'
        }
    };
    let name: String = name.chars().take(64).map(letter).collect();
    if name.is_empty() {
        "venue".to_owned()
    } else {
        name
    }
}
