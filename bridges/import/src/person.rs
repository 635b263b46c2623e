//! People as a picture shows them: what every format is turned into.

use std::collections::BTreeMap;
use std::ops::Range;

use farfield_proto::keypoints::COCO17;

/// Farther from the corner than this is no pixel of any picture.
const MAX_PX: f64 = 1e6;
/// Most people of one import, over all frames and cameras: ten hours of four people before eight cameras at 60 Hz are
/// seventy million, which nobody has imported; this many take 2.5 GB.
const MAX_PEOPLE: usize = 4_000_000;
/// Most people of one frame of one camera: of 75 bytes a keypoint at most their line stays below the 4 MiB that the edge
/// reads (`MAX_LINE_BYTES` of its `source/keypoints.rs`).
pub(crate) const MAX_PEOPLE_OF_FRAME: usize = 2048;
/// Most frames of one import, with those that are missing: nine hours at 60 Hz. A number far beyond the others would make
/// as many empty lines.
const MAX_FRAMES: i64 = 2_000_000;

/// The frames from `first` to `last`.
///
/// # Errors
/// When they are more than an import may have.
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

/// Where a keypoint seems to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Pixels to the right of the first one, distorted.
    pub x_px: f64,
    /// Pixels below the first one, distorted.
    pub y_px: f64,
    /// How sure the network was, above 0; on the file's own scale until [`crate::assemble`] has seen them all.
    pub score: f64,
}

impl Candidate {
    /// What three numbers of a file say; `None` where they say "not found": a score of 0 or none, a coordinate that is no
    /// number.
    ///
    /// # Errors
    /// Names a coordinate that is no pixel.
    pub(crate) fn of(
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

/// One person's keypoints in one picture, in the order of [`COCO17`].
pub type Person = [Option<Candidate>; COCO17.len()];

/// The people of one camera by frame.
pub type Frames = BTreeMap<i64, Vec<Person>>;

/// How a file tells its cameras apart.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum CameraKey {
    /// It is of one camera; the file or its folder is named after it.
    OfFile,
    /// By a name.
    Named(String),
    /// By their order alone, from 0.
    Nth(usize),
}

/// What was read so far, of every camera that a file has.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Detections {
    /// By camera.
    pub cameras: BTreeMap<CameraKey, Frames>,
    n_people: usize,
    /// People of the sources before.
    n_before: usize,
}

impl Detections {
    /// Of a further source of an import that has `n_people` already.
    pub(crate) fn after(n_people: usize) -> Self {
        Self {
            n_before: n_people,
            ..Self::default()
        }
    }

    /// Notes that there was a frame, with or without people.
    ///
    /// # Errors
    /// When it is farther from the others than an import may be long.
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

    /// Notes a frame that a file has once.
    ///
    /// # Errors
    /// When it was there before; and as [`Detections::frame`].
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

    /// Adds a person, unless nothing of them was found.
    ///
    /// # Errors
    /// When there are more people than an import or a frame may have; and as [`Detections::frame`].
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

    /// How many people there are, over all frames and cameras.
    pub fn n_people(&self) -> usize {
        self.n_people
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOMEBODY: Person = [Some(Candidate {
        x_px: 3.0,
        y_px: 4.0,
        score: 0.5,
    }); COCO17.len()];

    #[test]
    fn the_people_of_all_sources_are_one_budget() {
        let mut detections = Detections::after(MAX_PEOPLE - 1);
        detections.add(&CameraKey::OfFile, 0, &SOMEBODY).unwrap();
        let said = detections.add(&CameraKey::OfFile, 1, &SOMEBODY);
        assert!(said.unwrap_err().contains("a part of the recording"));
    }

    #[test]
    fn crowds_beyond_every_picture_and_frames_beyond_every_recording_are_refused_while_reading() {
        let mut detections = Detections::default();
        for _ in 0..MAX_PEOPLE_OF_FRAME {
            detections.add(&CameraKey::OfFile, 7, &SOMEBODY).unwrap();
        }
        let said = detections.add(&CameraKey::OfFile, 7, &SOMEBODY);
        assert!(said.unwrap_err().contains("in frame 7"));
        for frame in [7 - MAX_FRAMES, 7 + MAX_FRAMES] {
            let said = detections.frame(&CameraKey::OfFile, frame).unwrap_err();
            assert!(said.contains("something else than frames"), "{said}");
        }
        assert!(detections.frame(&CameraKey::OfFile, 6 + MAX_FRAMES).is_ok());
        assert_eq!(detections.cameras[&CameraKey::OfFile].len(), 2);
    }
}
