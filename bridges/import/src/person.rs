//! Detected people, the common form of every format.

use std::collections::BTreeMap;
use std::ops::Range;

use farfield_proto::keypoints::COCO23;

/// Coordinates beyond this are not pixels of any image.
const MAX_PX: f64 = 1e6;
/// Maximum number of people in one import, over all frames and cameras; this many take 3 GB. Ten
/// hours of four people in eight cameras at 60 Hz would be seventy million.
const MAX_PEOPLE: usize = 4_000_000;
/// Maximum number of people in one frame of one camera. At 75 bytes per keypoint, their line stays
/// below the 4 MiB that the edge reads (`MAX_LINE_BYTES` of `edge/src/source/keypoints.rs`).
pub(crate) const MAX_PEOPLE_OF_FRAME: usize = 2048;
/// Maximum number of frames in one import, including missing ones: nine hours at 60 Hz. Every
/// missing frame becomes an empty line, so a stray frame number must not pass.
const MAX_FRAMES: i64 = 2_000_000;

/// The frames from `first` to `last`.
///
/// # Errors
/// If there are more than an import may have.
pub(crate) fn span(first: i64, last: i64) -> Result<Range<i64>, String> {
    let length = last.checked_sub(first);
    match (length.filter(|it| *it < MAX_FRAMES), last.checked_add(1)) {
        (Some(_), Some(end)) => Ok(first..end),
        _ => Err(format!(
            "found frames from {first} to {last}, expected at most {MAX_FRAMES}: are the numbers in the names times, or \
             something else than frames?"
        )),
    }
}

/// Detected position of one keypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Pixels to the right of the first pixel, distorted.
    pub x_px: f64,
    /// Pixels below the first pixel, distorted.
    pub y_px: f64,
    /// Confidence of the network, above 0; on the file's own scale until [`crate::assemble`] has
    /// rescaled it.
    pub score: f64,
}

impl Candidate {
    /// Converts three numbers of a file. Returns `None` if the keypoint was not detected: the score
    /// is missing or not above 0, or a coordinate is not a finite number.
    ///
    /// # Errors
    /// If a coordinate is not a pixel.
    pub(crate) fn from_numbers(
        x: Option<f64>,
        y: Option<f64>,
        score: Option<f64>,
    ) -> Result<Option<Self>, String> {
        let finite = |value: Option<f64>| value.filter(|it| it.is_finite());
        let (Some(x_px), Some(y_px), Some(score)) = (finite(x), finite(y), finite(score)) else {
            return Ok(None);
        };
        if score <= 0.0 {
            return Ok(None);
        }
        if x_px.abs().max(y_px.abs()) > MAX_PX {
            return Err(format!("found ({x_px}, {y_px}), expected pixels"));
        }
        Ok(Some(Self { x_px, y_px, score }))
    }
}

/// Keypoints of one person in one image, in the order of [`COCO23`].
pub type Person = [Option<Candidate>; COCO23.len()];

/// The people of one camera by frame.
pub type Frames = BTreeMap<i64, Vec<Person>>;

/// How a file identifies its cameras.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum CameraKey {
    /// The file holds one camera, which is named after the file or its folder.
    OfFile,
    /// By name.
    Named(String),
    /// By order only, from 0.
    Nth(usize),
}

/// Everything read so far from one source, for every camera.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detections {
    /// By camera.
    pub cameras: BTreeMap<CameraKey, Frames>,
    n_people: usize,
    /// People in the sources before this one.
    n_before: usize,
}

impl Detections {
    /// Starts a further source of an import that already has `n_people`.
    pub(crate) fn after(n_people: usize) -> Self {
        Self {
            n_before: n_people,
            ..Self::default()
        }
    }

    /// Records a frame, with or without people.
    ///
    /// # Errors
    /// If the frames would span more than an import may have.
    pub(crate) fn frame(
        &mut self,
        camera: &CameraKey,
        frame: i64,
    ) -> Result<&mut Vec<Person>, String> {
        let frames = self.cameras.entry(camera.clone()).or_default();
        let first = frames.keys().next().map_or(frame, |it| frame.min(*it));
        let last = frames.keys().next_back().map_or(frame, |it| frame.max(*it));
        span(first, last)?;
        Ok(frames.entry(frame).or_default())
    }

    /// Records a frame that may appear only once in a file.
    ///
    /// # Errors
    /// If the frame is already recorded; otherwise as [`Detections::frame`].
    pub(crate) fn new_frame(&mut self, camera: &CameraKey, frame: i64) -> Result<(), String> {
        let is_known = |frames: &Frames| frames.contains_key(&frame);
        if self.cameras.get(camera).is_some_and(is_known) {
            return Err(format!(
                "found frame {frame} twice, expected the frames of one camera"
            ));
        }
        self.frame(camera, frame)?;
        Ok(())
    }

    /// Adds a person if at least one keypoint was detected.
    ///
    /// # Errors
    /// If an import or a frame would have too many people; otherwise as [`Detections::frame`].
    pub(crate) fn add(
        &mut self,
        camera: &CameraKey,
        frame: i64,
        person: &Person,
    ) -> Result<(), String> {
        let people = self.frame(camera, frame)?;
        if person.iter().all(Option::is_none) {
            return Ok(());
        }
        if people.len() >= MAX_PEOPLE_OF_FRAME {
            return Err(format!(
                "found more than {MAX_PEOPLE_OF_FRAME} people in frame {frame}, expected those of one picture"
            ));
        }
        people.push(*person);
        self.n_people += 1;
        if self.n_before + self.n_people > MAX_PEOPLE {
            return Err(format!(
                "found more than {MAX_PEOPLE} people, expected fewer: import a part of the recording"
            ));
        }
        Ok(())
    }

    /// Number of people, over all frames and cameras.
    pub fn n_people(&self) -> usize {
        self.n_people
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERSON: Person = [Some(Candidate {
        x_px: 3.0,
        y_px: 4.0,
        score: 0.5,
    }); COCO23.len()];

    #[test]
    fn all_sources_share_one_limit_of_people() {
        let mut detections = Detections::after(MAX_PEOPLE - 1);
        detections.add(&CameraKey::OfFile, 0, &PERSON).unwrap();
        let added = detections.add(&CameraKey::OfFile, 1, &PERSON);
        assert!(added.unwrap_err().contains(&MAX_PEOPLE.to_string()));
    }

    #[test]
    fn too_many_people_or_frames_are_refused_while_reading() {
        let mut detections = Detections::default();
        for _ in 0..MAX_PEOPLE_OF_FRAME {
            detections.add(&CameraKey::OfFile, 7, &PERSON).unwrap();
        }
        let added = detections.add(&CameraKey::OfFile, 7, &PERSON);
        assert!(added.unwrap_err().contains("in frame 7"));
        for frame in [7 - MAX_FRAMES, 7 + MAX_FRAMES] {
            let error = detections.frame(&CameraKey::OfFile, frame).unwrap_err();
            assert!(error.contains(&MAX_FRAMES.to_string()), "{error}");
        }
        assert!(detections.frame(&CameraKey::OfFile, 6 + MAX_FRAMES).is_ok());
        assert_eq!(detections.cameras[&CameraKey::OfFile].len(), 2);
    }
}
