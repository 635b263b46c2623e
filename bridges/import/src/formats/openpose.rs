//! `OpenPose`'s JSON, one file per frame: `{"people": [{"pose_keypoints_2d": [x, y, score,
//! ...]}]}`. Pose2Sim writes it too, for every model. Hands and faces have their own lists, which
//! are not read.

use std::path::Path;

use farfield_proto::toml_file::FileError;
use serde::Deserialize;

use super::Content;
use super::json::{self, Number};
use crate::folder;
use crate::person::CameraKey;

#[derive(Deserialize)]
struct FrameFile {
    people: Vec<PersonEntry>,
}

#[derive(Deserialize)]
struct PersonEntry {
    // Name before version 1.3.
    #[serde(default, alias = "pose_keypoints")]
    pose_keypoints_2d: Vec<Number>,
}

pub(super) fn read(text: &str, path: &Path, content: &mut Content) -> Result<(), FileError> {
    let file: FrameFile = json::read(text, path)?;
    let frame = frame_of(path)?;
    content
        .detections
        .new_frame(&CameraKey::OfFile, frame)
        .map_err(|problem| FileError::new(path, problem))?;
    for (i, entry) in file.people.iter().enumerate() {
        let at = |problem| {
            FileError::new(path, problem).at_field(format!("people[{i}].pose_keypoints_2d"))
        };
        let person = json::flat_person(&mut content.keypoints, None, &entry.pose_keypoints_2d)
            .map_err(at)?;
        if let Some(person) = person {
            let added = content.detections.add(&CameraKey::OfFile, frame, &person);
            added.map_err(at)?;
        }
    }
    Ok(())
}

/// Frame number from the file's name.
///
/// # Errors
/// [`FileError`] if the name contains no number.
pub(super) fn frame_of(path: &Path) -> Result<i64, FileError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    folder::frame_of_name(&name).ok_or_else(|| {
        FileError::new(
            path,
            "found no frame number in the file's name, expected one such as cam01_000123_keypoints.json",
        )
    })
}
