//! Writers of each format for tests.

use std::fmt::Write as _;

use farfield_proto::keypoints::{COCO17, COCO23};
use serde_json::{Value, json};

use crate::keypoints::{Mapping, Model};
use crate::person::{Frames, Person};

/// All keypoints of a model as x, y, score; 0 if ours lack it or it was not detected.
fn flat(person: &Person, mapping: &Mapping) -> Vec<f64> {
    let mut flat = vec![0.0; 3 * mapping.count];
    for (keypoint, place) in person.iter().zip(mapping.places) {
        if let (Some(it), Some(place)) = (keypoint, place) {
            flat[3 * place..3 * place + 3].copy_from_slice(&[it.x_px, it.y_px, it.score]);
        }
    }
    flat
}

/// The same frames with the keypoints that `model` has.
pub(crate) fn known_to(model: Model, mut frames: Frames) -> Frames {
    for person in frames.values_mut().flatten() {
        for (keypoint, place) in person.iter_mut().zip(model.mapping().places) {
            *keypoint = keypoint.filter(|_| place.is_some());
        }
    }
    frames
}

/// `OpenPose` file of one frame.
pub(crate) fn openpose(people: &[Person], model: Model) -> String {
    let mapping = model.mapping();
    let people: Vec<Value> = people
        .iter()
        .map(|person| {
            json!({
                "person_id": [-1],
                "pose_keypoints_2d": flat(person, &mapping),
                "face_keypoints_2d": [],
                "hand_left_keypoints_2d": [],
            })
        })
        .collect();
    json!({"version": 1.3, "people": people}).to_string()
}

/// COCO results of one camera.
pub(crate) fn coco_results(frames: &Frames) -> String {
    results(frames, |frame| json!(frame))
}

/// `AlphaPose` file of one camera.
pub(crate) fn alphapose(frames: &Frames) -> String {
    results(frames, |frame| json!(format!("{frame}.jpg")))
}

fn results(frames: &Frames, id: impl Fn(i64) -> Value) -> String {
    let mut entries = Vec::new();
    for (frame, people) in frames {
        for (i, person) in people.iter().enumerate() {
            let keypoints = flat(person, &Model::Coco17.mapping());
            entries.push(json!({
                "image_id": id(*frame), "category_id": 1, "keypoints": keypoints, "score": 2.5, "idx": [i],
                "box": [1.0, 2.0, 3.0, 4.0],
            }));
        }
    }
    Value::from(entries).to_string()
}

/// COCO annotations of one camera whose images lie in a folder; with flags instead of scores.
pub(crate) fn coco_annotations(frames: &Frames, folder: &str) -> String {
    let (mut images, mut annotations) = (Vec::new(), Vec::new());
    for (id, (frame, people)) in frames.iter().enumerate() {
        images.push(json!({"id": id, "file_name": format!("{folder}/{frame:06}.jpg"), "width": 1, "height": 1}));
        for person in people {
            let mut keypoints = flat(person, &Model::Coco17.mapping());
            for score in keypoints.iter_mut().skip(2).step_by(3) {
                *score = if *score > 0.0 { 2.0 } else { 0.0 };
            }
            annotations.push(json!({"image_id": id, "category_id": 1, "keypoints": keypoints}));
        }
    }
    let category = json!({"id": 1, "name": "person", "keypoints": COCO17});
    json!({"images": images, "annotations": annotations, "categories": [category]}).to_string()
}

/// `MMPose` predictions of one camera.
pub(crate) fn mmpose(frames: &Frames, model: Model) -> String {
    let mapping = model.mapping();
    let frames: Vec<Value> = frames
        .iter()
        .map(|(frame, people)| {
            let instances: Vec<Value> = people
                .iter()
                .map(|person| {
                    let flat = flat(person, &mapping);
                    let at: Vec<&[f64]> = flat.chunks(3).map(|it| &it[..2]).collect();
                    let scores: Vec<f64> = flat.chunks(3).map(|it| it[2]).collect();
                    json!({"keypoints": at, "keypoint_scores": scores, "bbox": [[0, 0, 1, 1]]})
                })
                .collect();
            json!({"frame_id": frame, "instances": instances})
        })
        .collect();
    json!({"meta_info": {}, "instance_info": frames}).to_string()
}

/// `DeepLabCut` table of one camera, with columns for the largest number of people in a frame.
pub(crate) fn deeplabcut(frames: &Frames) -> String {
    let most = frames.values().map(Vec::len).max().unwrap_or(0).max(1);
    let mut rows = ["scorer", "individuals", "bodyparts", "coords"].map(str::to_owned);
    for animal in 0..most {
        for name in COCO23 {
            for coord in ["x", "y", "likelihood"] {
                let cells = ["net", &format!("animal{animal:03}"), name, coord].map(str::to_owned);
                for (row, cell) in rows.iter_mut().zip(cells) {
                    write!(row, ",{cell}").unwrap();
                }
            }
        }
    }
    let mut text = rows.join("\n") + "\n";
    for (frame, people) in frames {
        write!(text, "{frame}").unwrap();
        for animal in 0..most {
            for i in 0..COCO23.len() {
                match people.get(animal).and_then(|person| person[i]) {
                    Some(it) => write!(text, ",{},{},{}", it.x_px, it.y_px, it.score).unwrap(),
                    None => text.push_str(",,,"),
                }
            }
        }
        text.push('\n');
    }
    text
}

/// SLEAP table of one camera.
pub(crate) fn sleap(frames: &Frames) -> String {
    let mut text = "track,frame_idx,instance.score".to_owned();
    for name in COCO23 {
        write!(text, ",{name}.x,{name}.y,{name}.score").unwrap();
    }
    text.push('\n');
    for (frame, people) in frames {
        for (i, person) in people.iter().enumerate() {
            write!(text, "track_{i},{frame},0.9").unwrap();
            for keypoint in person {
                match keypoint {
                    Some(it) => write!(text, ",{},{},{}", it.x_px, it.y_px, it.score).unwrap(),
                    None => text.push_str(",,,"),
                }
            }
            text.push('\n');
        }
    }
    text
}

/// Caliscope table of several cameras tracked by `MediaPipe`; has no scores.
pub(crate) fn caliscope(cameras: &[&Frames]) -> String {
    let mut text = "sync_index,cam_id,object_id,keypoint_id,img_loc_x,img_loc_y,obj_loc_x,obj_loc_y,obj_loc_z\n".to_owned();
    let places = Model::BlazePose.mapping().places;
    for (camera, frames) in cameras.iter().enumerate() {
        for (frame, people) in *frames {
            for (object, person) in people.iter().enumerate() {
                for (keypoint, place) in person.iter().zip(places) {
                    if let (Some(it), Some(place)) = (keypoint, place) {
                        writeln!(
                            text,
                            "{frame},{camera},{object},{place},{},{},,,",
                            it.x_px, it.y_px
                        )
                        .unwrap();
                    }
                }
                // A point of a finger.
                writeln!(text, "{frame},{camera},{object},204,1.0,2.0,,,").unwrap();
            }
        }
    }
    text
}

/// `FreeMoCap` array of several cameras with one person each; has no scores.
pub(crate) fn freemocap(cameras: &[&Frames]) -> Vec<u8> {
    const POINTS: usize = 553;
    let places = Model::BlazePose.mapping().places;
    let n_frames = cameras.first().map_or(0, |it| it.len());
    let mut numbers = Vec::new();
    for frames in cameras {
        for people in frames.values() {
            let mut points = vec![f64::NAN; 3 * POINTS];
            for (keypoint, place) in people.first().into_iter().flatten().zip(places) {
                if let (Some(it), Some(place)) = (keypoint, place) {
                    points[3 * place..3 * place + 3].copy_from_slice(&[it.x_px, it.y_px, -0.3]);
                }
            }
            numbers.extend(points);
        }
    }
    npy(&[cameras.len(), n_frames, POINTS, 3], &numbers)
}

/// A `NumPy` array.
pub(crate) fn npy(shape: &[usize], numbers: &[f64]) -> Vec<u8> {
    let shape: Vec<String> = shape.iter().map(|it| format!("{it},")).collect();
    let heading = format!(
        "{{'descr': '<f8', 'fortran_order': False, 'shape': ({}), }}\n",
        shape.join(" ")
    );
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((heading.len() as u16).to_le_bytes());
    bytes.extend(heading.as_bytes());
    bytes.extend(numbers.iter().flat_map(|it| it.to_le_bytes()));
    bytes
}
