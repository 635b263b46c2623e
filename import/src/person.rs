//! People as a picture shows them: what every format is turned into.

use std::collections::BTreeMap;

use farfield_proto::keypoints::COCO17;

/// Farther from the corner than this is no pixel of any picture.
const MAX_PX: f64 = 1e6;
/// Most people of one import, over all frames and cameras: ten hours of four people before eight cameras at 60 Hz are
/// seventy million, which nobody has imported; this many take 2.5 GB.
const MAX_PEOPLE: usize = 4_000_000;

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
}

impl Detections {
    /// Notes that there was a frame, with or without people.
    pub(crate) fn frame(&mut self, camera: &CameraKey, frame: i64) -> &mut Vec<Person> {
        let frames = self.cameras.entry(camera.clone()).or_default();
        frames.entry(frame).or_default()
    }

    /// Notes a frame that a file has once.
    ///
    /// # Errors
    /// When it was there before.
    pub(crate) fn new_frame(&mut self, camera: &CameraKey, frame: i64) -> Result<(), String> {
        let is_known = |frames: &Frames| frames.contains_key(&frame);
        if self.cameras.get(camera).is_some_and(is_known) {
            return Err(format!(
                "found frame {frame} twice, expected the frames of one camera"
            ));
        }
        self.frame(camera, frame);
        Ok(())
    }

    /// Adds a person, unless nothing of them was found.
    ///
    /// # Errors
    /// When there are more people than an import may have.
    pub(crate) fn add(
        &mut self,
        camera: &CameraKey,
        frame: i64,
        person: &Person,
    ) -> Result<(), String> {
        let people = self.frame(camera, frame);
        if person.iter().all(Option::is_none) {
            return Ok(());
        }
        people.push(*person);
        self.n_people += 1;
        if self.n_people > MAX_PEOPLE {
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
