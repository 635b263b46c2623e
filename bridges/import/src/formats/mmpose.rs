//! `MMPose`'s predictions. Three forms are read: `{"meta_info": ..., "instance_info": [{"frame_id":
//! 1, "instances": [...]}]}`; the list of frames alone (inferencer output of a video); the list of
//! instances alone (inferencer output of one image). An instance is `{"keypoints": [[x, y], ...],
//! "keypoint_scores": [...]}`.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::toml_file::FileError;
use serde::Deserialize;

use super::Content;
use super::json::{self, Number};
use super::openpose::frame_of;
use crate::folder::MAX_FRAME;
use crate::person::{CameraKey, Candidate, Person};

#[derive(Deserialize)]
struct WholeFile {
    #[serde(default)]
    meta_info: MetaInfo,
    instance_info: Vec<FrameEntry>,
}

#[derive(Deserialize, Default)]
struct MetaInfo {
    /// JSON keys are strings, so the numbers are strings.
    #[serde(default)]
    keypoint_id2name: BTreeMap<String, String>,
}

#[derive(Deserialize)]
struct FrameEntry {
    frame_id: i64,
    instances: Vec<Instance>,
}

#[derive(Deserialize)]
struct Instance {
    keypoints: Vec<Vec<Number>>,
    #[serde(default)]
    keypoint_scores: Option<Vec<Number>>,
}

pub(super) fn read(text: &str, path: &Path, content: &mut Content) -> Result<(), FileError> {
    let (frames, names) = match json::top(text, path)? {
        json::Top::Object => {
            let file: WholeFile = json::read(text, path)?;
            (file.instance_info, names(&file.meta_info))
        }
        json::Top::ListOfFrames => (json::read(text, path)?, None),
        json::Top::List => {
            let frame_id = frame_of(path)?;
            let instances = json::read(text, path)?;
            (
                vec![FrameEntry {
                    frame_id,
                    instances,
                }],
                None,
            )
        }
    };
    for (i, frame) in frames.iter().enumerate() {
        if !(-MAX_FRAME..=MAX_FRAME).contains(&frame.frame_id) {
            let problem = format!("found {}, expected the number of a frame", frame.frame_id);
            return Err(FileError::new(path, problem).at_field(format!("[{i}].frame_id")));
        }
        content
            .detections
            .new_frame(&CameraKey::OfFile, frame.frame_id)
            .map_err(|problem| FileError::new(path, problem).at_field(format!("[{i}].frame_id")))?;
        for (k, instance) in frame.instances.iter().enumerate() {
            let at = |problem| {
                FileError::new(path, problem).at_field(format!("[{i}].instances[{k}].keypoints"))
            };
            let person = person(instance, names.as_deref(), content).map_err(at)?;
            let added = content
                .detections
                .add(&CameraKey::OfFile, frame.frame_id, &person);
            added.map_err(at)?;
        }
    }
    Ok(())
}

/// The names in order, if all numbers from 0 have one.
fn names(meta: &MetaInfo) -> Option<Vec<String>> {
    let count = meta.keypoint_id2name.len();
    let named = (0..count).map(|i| meta.keypoint_id2name.get(&i.to_string()).cloned());
    named
        .collect::<Option<Vec<_>>>()
        .filter(|it| !it.is_empty())
}

fn person(
    instance: &Instance,
    names: Option<&[String]>,
    content: &mut Content,
) -> Result<Person, String> {
    let count = instance.keypoints.len();
    if let Some(scores) = &instance.keypoint_scores
        && scores.len() != count
    {
        return Err(format!(
            "found {count} keypoints and {} scores, expected as many",
            scores.len()
        ));
    }
    if instance.keypoint_scores.is_none() {
        content.note("keypoints without scores were given the score 1");
    }
    let mapping = json::mapping(&mut content.keypoints, names, count)?;
    mapping.person(|place| {
        let at = instance.keypoints.get(place).map_or(&[][..], Vec::as_slice);
        if at.len() < 2 {
            return Err(format!(
                "found {} numbers at keypoint {place}, expected x, y",
                at.len()
            ));
        }
        let number = |i: usize| at.get(i).copied().flatten();
        let score = match &instance.keypoint_scores {
            Some(scores) => scores.get(place).copied().flatten(),
            None => Some(1.0),
        };
        Candidate::from_numbers(number(0), number(1), score)
    })
}
