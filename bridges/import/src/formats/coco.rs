//! COCO's keypoint JSON, and `AlphaPose`'s, which is COCO's results format with image names instead
//! of ids.
//!
//! Results are `[{"image_id": 12, "category_id": 1, "keypoints": [x, y, score, ...], "score":
//! 0.9}]`. Annotations have lists of images, categories and annotations, and flags instead of
//! scores: 0 not labelled, 1 labelled but hidden, 2 visible.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::toml_file::FileError;
use serde::Deserialize;

use super::Content;
use super::json::{self, Number};
use crate::folder::{self, MAX_FRAME};
use crate::person::{CameraKey, Person};

/// COCO's category of people.
const PERSON: i64 = 1;
/// Assumed score of a hidden keypoint; reported.
const HIDDEN_SCORE: f64 = 0.5;

#[derive(Deserialize)]
struct ResultEntry {
    image_id: ImageId,
    category_id: Option<i64>,
    #[serde(default)]
    keypoints: Vec<Number>,
}

/// A number, or the name of an image.
#[derive(Deserialize)]
#[serde(untagged)]
enum ImageId {
    Number(i64),
    Name(String),
}

#[derive(Deserialize)]
struct AnnotationsFile {
    images: Vec<ImageEntry>,
    annotations: Vec<ResultEntry>,
    #[serde(default)]
    categories: Vec<CategoryEntry>,
}

#[derive(Deserialize)]
struct ImageEntry {
    id: i64,
    file_name: String,
}

#[derive(Deserialize)]
struct CategoryEntry {
    id: i64,
    #[serde(default)]
    name: String,
    #[serde(default)]
    keypoints: Vec<String>,
}

/// Results of COCO or `AlphaPose`.
pub(super) fn read_results(
    text: &str,
    path: &Path,
    content: &mut Content,
) -> Result<(), FileError> {
    let entries: Vec<ResultEntry> = json::read(text, path)?;
    let mut named = NamedFrames::default();
    for (i, entry) in entries.iter().enumerate() {
        if entry.category_id.is_some_and(|id| id != PERSON) {
            content.note("entries of categories other than 1 (people) were left out");
            continue;
        }
        let (camera, frame) = match &entry.image_id {
            ImageId::Number(id) => (CameraKey::OfFile, number(*id)),
            ImageId::Name(name) => named.take(name),
        };
        let frame = frame
            .map_err(|problem| FileError::new(path, problem).at_field(format!("[{i}].image_id")))?;
        let at = |problem| FileError::new(path, problem).at_field(format!("[{i}].keypoints"));
        let person =
            json::flat_person(&mut content.keypoints, None, &entry.keypoints).map_err(at)?;
        content.detections.frame(&camera, frame).map_err(at)?;
        if let Some(person) = person {
            content
                .detections
                .add(&camera, frame, &person)
                .map_err(at)?;
        }
    }
    Ok(())
}

/// COCO's annotations.
pub(super) fn read_annotations(
    text: &str,
    path: &Path,
    content: &mut Content,
) -> Result<(), FileError> {
    let file: AnnotationsFile = json::read(text, path)?;
    let mut images = BTreeMap::new();
    let mut named = NamedFrames::default();
    for (i, image) in file.images.iter().enumerate() {
        let at = |field: &str, problem: String| {
            FileError::new(path, problem).at_field(format!("images[{i}].{field}"))
        };
        let (camera, frame) = named.take(&image.file_name);
        let frame = frame.map_err(|problem| at("file_name", problem))?;
        let noted = content.detections.frame(&camera, frame);
        noted.map_err(|problem| at("file_name", problem))?;
        if images.insert(image.id, (camera, frame)).is_some() {
            return Err(at("id", format!("found {} twice", image.id)));
        }
    }
    let people = file.categories.iter().find(|it| it.name == "person");
    let people = people.or_else(|| file.categories.iter().find(|it| it.id == PERSON));
    let id = people.map_or(PERSON, |it| it.id);
    let names = people
        .map(|it| it.keypoints.as_slice())
        .filter(|it| !it.is_empty());
    for (i, entry) in file.annotations.iter().enumerate() {
        if entry.category_id.is_some_and(|it| it != id) {
            content.note("annotations of categories other than people were left out");
            continue;
        }
        let at = |field: &str, problem: String| {
            FileError::new(path, problem).at_field(format!("annotations[{i}].{field}"))
        };
        let image = match &entry.image_id {
            ImageId::Number(id) => images.get(id),
            ImageId::Name(_) => None,
        };
        let (camera, frame) = image.ok_or_else(|| {
            at(
                "image_id",
                "found an image that is not in `images`".to_owned(),
            )
        })?;
        let person = json::flat_person(&mut content.keypoints, names, &entry.keypoints)
            .map_err(|problem| at("keypoints", problem))?;
        if let Some(mut person) = person {
            flags_to_scores(&mut person);
            content.note(
                "annotations have flags instead of scores: visible was read as 1, labelled but hidden as 0.5",
            );
            let added = content.detections.add(camera, *frame, &person);
            added.map_err(|problem| at("keypoints", problem))?;
        }
    }
    Ok(())
}

fn flags_to_scores(person: &mut Person) {
    for keypoint in person.iter_mut().flatten() {
        keypoint.score = if keypoint.score >= 2.0 {
            1.0
        } else {
            HIDDEN_SCORE
        };
    }
}

fn number(id: i64) -> Result<i64, String> {
    if (-MAX_FRAME..=MAX_FRAME).contains(&id) {
        Ok(id)
    } else {
        Err(format!("found {id}, expected the number of a frame"))
    }
}

/// Named images; each must be a different frame of its camera.
#[derive(Default)]
struct NamedFrames {
    names: BTreeMap<(CameraKey, i64), String>,
}

impl NamedFrames {
    /// The camera and frame of an image. A second image with the same ones is from another take.
    fn take(&mut self, name: &str) -> (CameraKey, Result<i64, String>) {
        let (camera, frame) = by_name(name);
        let frame = frame.and_then(|frame| {
            let known = self.names.entry((camera.clone(), frame));
            let known = known.or_insert_with(|| name.to_owned());
            if known == name {
                Ok(frame)
            } else {
                Err(format!(
                    "found `{known}` and `{name}`, one frame of one camera twice: import each take or each camera separately"
                ))
            }
        });
        (camera, frame)
    }
}

/// The camera and frame of an image, from its name.
fn by_name(name: &str) -> (CameraKey, Result<i64, String>) {
    let folder = folder::folder_of_name(name);
    let camera = folder.map_or(CameraKey::OfFile, |it| CameraKey::Named(it.to_owned()));
    let frame = folder::frame_of_name(name).ok_or_else(|| {
        format!("found `{name}`, expected a name with the number of a frame, such as 000123.jpg")
    });
    (camera, frame)
}
