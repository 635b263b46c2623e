//! Which recording is which camera's, by their names.

use std::collections::BTreeMap;

use anyhow::anyhow;
use farfield_import::matching::{self, Leftovers};

use super::recordings::Recording;

/// Whether cameras, or recordings, may be left over.
///
/// The recording of every one of `cameras`; where `all` are meant, every recording must be one of a camera.
///
/// # Errors
/// Lists both where a camera has no recording or two, or a recording no camera.
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
            "{}\ncameras of the calibration: {}\nrecordings: {}\nname the files after the cameras, or say which cameras \
             to use with `--viewpoint NAME=CAM1,CAM2`",
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

    fn recordings(names: &[&str]) -> Vec<Recording> {
        let recording = |name: &&str| Recording {
            kind: RecordingKind::Video,
            path: format!("{name}.mp4").into(),
            name: (*name).to_owned(),
        };
        names.iter().map(recording).collect()
    }

    #[test]
    fn cameras_find_their_recordings() {
        let recordings = recordings(&["cam02", "cam01"]);
        let found = matched(&["cam_1", "cam_2"], &recordings, true).unwrap();
        let names: Vec<(&str, &str)> = found
            .into_iter()
            .map(|(camera, it)| (camera, it.name.as_str()))
            .collect();
        assert_eq!(names, [("cam_1", "cam01"), ("cam_2", "cam02")]);
    }

    #[test]
    fn what_is_missing_is_refused_with_both_lists() {
        let recordings = recordings(&["cam1", "cam12"]);
        let said = matched(&["cam1", "cam2"], &recordings, true)
            .unwrap_err()
            .to_string();
        assert!(
            said.contains("`cam12` is of no camera")
                && said.contains("camera `cam2` has no recording"),
            "{said}"
        );
        assert!(
            said.contains("cameras of the calibration: cam1, cam2\nrecordings: cam1, cam12"),
            "{said}"
        );
    }

    #[test]
    fn where_cameras_were_named_other_recordings_are_left_out() {
        let recordings = recordings(&["cam1", "cam2"]);
        assert_eq!(matched(&["cam2"], &recordings, false).unwrap().len(), 1);
    }
}
