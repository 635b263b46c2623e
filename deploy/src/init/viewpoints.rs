//! Viewpoints: their cameras, and the recordings of these.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use anyhow::{anyhow, ensure};
use farfield_import::matching::{self, Leftovers};
use farfield_proto::calibration::Calibration;
use farfield_proto::toml_file::unknown_name;

use super::recordings::Recording;

/// A viewpoint with the names of its cameras: `ne=ne-left,ne-right`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct ViewpointArg {
    pub(super) name: String,
    /// Its cameras, with their names in the calibration.
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
            return Err(format!(
                "`{text}` contains no camera, expected NAME=CAM1,CAM2"
            ));
        }
        Ok(Self {
            name: name.trim().to_owned(),
            cameras,
        })
    }
}

/// The requested viewpoints; by default one for each camera of the calibration.
///
/// # Errors
/// Names a camera that the calibration does not have, or that is in two viewpoints.
pub(super) fn choose(
    requested: &[ViewpointArg],
    calibration: &Calibration,
) -> anyhow::Result<Vec<ViewpointArg>> {
    let known: Vec<&str> = calibration.cameras.keys().map(String::as_str).collect();
    if requested.is_empty() {
        let alone = |camera: &&str| ViewpointArg {
            name: key_chunk(camera),
            cameras: vec![(*camera).to_owned()],
        };
        return Ok(known.iter().map(alone).collect());
    }
    let mut seen = BTreeSet::new();
    for camera in requested.iter().flat_map(|viewpoint| &viewpoint.cameras) {
        ensure!(
            known.contains(&camera.as_str()),
            "`--viewpoint`: {}",
            unknown_name("camera of the calibration", camera, &known)
        );
        ensure!(
            seen.insert(camera),
            "`--viewpoint`: camera `{camera}` is listed twice"
        );
    }
    Ok(requested.to_vec())
}

/// A valid part of Zenoh keys from a name.
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

/// The recording of each of `cameras`. With `all`, every recording must belong to a camera.
///
/// # Errors
/// Lists cameras without a recording or with two, and recordings without a camera.
pub(super) fn matched<'a>(
    cameras: &[&'a str],
    recordings: &'a [Recording],
    all: bool,
) -> anyhow::Result<BTreeMap<&'a str, &'a Recording>> {
    let names: Vec<&str> = recordings.iter().map(|it| it.name.as_str()).collect();
    let leftovers = if all {
        Leftovers::Refused
    } else {
        Leftovers::LeftOut
    };
    let found = matching::matched(cameras, &names, leftovers).map_err(|faults| {
        anyhow!(
            "{}\ncameras of the calibration: {}\nrecordings: {}\nrename the files after the cameras, or choose the cameras \
             with `--viewpoint NAME=CAM1,CAM2`",
            faults.join("\n"),
            cameras.join(", "),
            names.join(", ")
        )
    })?;
    Ok(found
        .into_iter()
        .filter_map(|(camera, place)| Some((camera, recordings.get(place)?)))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::super::recordings::RecordingKind;
    use super::*;

    fn recordings_named(names: &[&str]) -> Vec<Recording> {
        let recording = |name: &&str| Recording {
            kind: RecordingKind::Video,
            path: format!("{name}.mp4").into(),
            name: (*name).to_owned(),
        };
        names.iter().map(recording).collect()
    }

    #[test]
    fn cameras_find_their_recordings() {
        let recordings = recordings_named(&["cam02", "cam01"]);
        let found = matched(&["cam_1", "cam_2"], &recordings, true).unwrap();
        let names: Vec<(&str, &str)> = found
            .into_iter()
            .map(|(camera, it)| (camera, it.name.as_str()))
            .collect();
        assert_eq!(names, [("cam_1", "cam01"), ("cam_2", "cam02")]);
    }

    #[test]
    fn missing_cameras_and_recordings_are_refused_with_both_lists() {
        let recordings = recordings_named(&["cam1", "cam12"]);
        let error = matched(&["cam1", "cam2"], &recordings, true).unwrap_err();
        let error = error.to_string();
        assert!(error.contains("`cam12`") && error.contains("`cam2`"));
        assert!(
            error.contains(": cam1, cam2\nrecordings: cam1, cam12"),
            "{error}"
        );
    }

    #[test]
    fn recordings_of_other_cameras_are_ignored_if_cameras_are_listed() {
        let recordings = recordings_named(&["cam1", "cam2"]);
        assert_eq!(matched(&["cam2"], &recordings, false).unwrap().len(), 1);
    }
}
