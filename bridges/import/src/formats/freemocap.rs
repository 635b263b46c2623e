//! `FreeMoCap`'s `*2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy`: cameras x frames x
//! points x (x, y, third number). Cameras have no names, only the order of their videos.
//!
//! `MediaPipe`'s 33 body points come first, then hands and face. The third number is a depth, not a
//! score.

use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::Content;
use super::npy::Array;
use crate::keypoints::Model;
use crate::person::{CameraKey, Candidate};

/// Maximum number of cameras.
const MAX_CAMERAS: usize = 4096;

pub(super) fn read(bytes: &[u8], path: &Path, content: &mut Content) -> Result<(), FileError> {
    let whole = |problem: String| FileError::new(path, problem);
    let array = Array::parse(bytes, path)?;
    let &[cameras, frames, points, numbers] = array.shape.as_slice() else {
        return Err(whole(format!(
            "found an array {:?}, expected cameras x frames x points x numbers",
            array.shape
        )));
    };
    if !(2..=3).contains(&numbers) || cameras > MAX_CAMERAS {
        return Err(whole(format!(
            "found an array {:?}, expected at most {MAX_CAMERAS} cameras and 2 or 3 numbers a point: x, y",
            array.shape
        )));
    }
    let count = body_points(points);
    content.note("the file has no scores: all keypoints were given the score 1");
    for camera in 0..cameras {
        let key = CameraKey::Nth(camera);
        for frame in 0..frames {
            // Limited by the file's length: every frame must contain a number.
            if points == 0 {
                break;
            }
            let number = frame.cast_signed() as i64;
            let noted = content.detections.frame(&key, number);
            noted.map_err(|problem| whole(problem).at_field(format!("[{camera}, {frame}]")))?;
            let mapping = content.keypoints.by_count(count).map_err(whole)?;
            let person = mapping.person(|place| {
                let at = |number: usize| array.at(&[camera, frame, place, number]);
                Candidate::from_numbers(at(0), at(1), Some(1.0))
            });
            let added = person.and_then(|it| content.detections.add(&key, number, &it));
            added.map_err(|problem| whole(problem).at_field(format!("[{camera}, {frame}]")))?;
        }
    }
    Ok(())
}

/// How many of all points belong to the body; two hands of 21 each and the face follow.
fn body_points(points: usize) -> usize {
    match points {
        // With hands (75); with a face of 468 points, or of 478 with the irises.
        33 | 75 | 501 | 511 | 543 | 553 => Model::BlazePose.count(),
        // With hands and face, as in OpenPose.
        67 | 95 | 137 => Model::Body25.count(),
        other => other,
    }
}
