//! Files of 2D keypoints, one JSON line per frame. Other tools write them and edges read them:
//! `{"tick": 300, "persons": [{"keypoints": [[x, y, score], null, ...]}]}`. Other fields are ignored.

use std::path::{Path, PathBuf};

use farfield_proto::keypoints::COCO23;
use serde::Deserialize;

use super::request::{DetectedFrame, Detection, Keypoint};

/// Largest absolute number of a frame.
const MOST_FRAMES: i64 = 1 << 48;
/// Most people in a frame.
const MOST_PERSONS: usize = 1000;
/// Scores from 1 to this are read as 1: `OpenPose` overshoots by a few percent. A higher one is on another scale.
const MOST_SCORE: f64 = 1.25;
/// Largest absolute pixel coordinate.
const MOST_PX: f64 = 1e6;

/// The reason why a file of keypoints cannot be read.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{}, line {line}: {problem}", path.display())]
pub struct KeypointFileError {
    /// The file.
    pub path: PathBuf,
    /// The line, from 1.
    pub line: usize,
    /// The problem: the value found and the one expected.
    pub problem: String,
}

#[derive(Deserialize)]
struct Line {
    tick: i64,
    persons: Vec<Person>,
}

#[derive(Deserialize)]
struct Person {
    keypoints: Vec<Option<[f64; 3]>>,
}

/// Reads the frames of one camera, whose bodies have `count` keypoints, or COCO's with feet; `path` is only for errors. Frames must be in order;
/// some may be missing.
///
/// # Errors
/// [`KeypointFileError`] for the first invalid line.
pub fn parse(
    text: &str,
    path: &Path,
    count: usize,
) -> Result<Vec<DetectedFrame>, KeypointFileError> {
    let mut lines = FrameLines::new(path, count);
    let frames = text.lines().filter_map(|line| lines.next(line).transpose());
    frames.collect()
}

/// Reads the frames of a file line by line, for files that do not fit into memory.
#[derive(Debug, Clone)]
pub struct FrameLines {
    path: PathBuf,
    count: usize,
    line: usize,
    last: Option<f64>,
}

impl FrameLines {
    /// For a file whose bodies have `count` keypoints; `path` is only for errors.
    pub fn new(path: &Path, count: usize) -> Self {
        Self {
            path: path.to_owned(),
            count,
            line: 0,
            last: None,
        }
    }

    /// The frame of the next line; `None` for an empty one.
    ///
    /// # Errors
    /// [`KeypointFileError`] as in [`parse`].
    pub fn next(&mut self, line: &str) -> Result<Option<DetectedFrame>, KeypointFileError> {
        self.line += 1;
        if line.trim().is_empty() {
            return Ok(None);
        }
        let frame = frame(line, self.count, self.last).map_err(|problem| KeypointFileError {
            path: self.path.clone(),
            line: self.line,
            problem,
        })?;
        self.last = Some(frame.frame);
        Ok(Some(frame))
    }
}

fn frame(line: &str, count: usize, last: Option<f64>) -> Result<DetectedFrame, String> {
    let line: Line = serde_json::from_str(line).map_err(|problem| {
        let message = problem.to_string();
        // The line is that of the file.
        let message = message.split(" at line ").next().unwrap_or_default();
        format!("column {}: {message}", problem.column())
    })?;
    if !(-MOST_FRAMES..=MOST_FRAMES).contains(&line.tick) {
        return Err(format!(
            "`tick`: found {}, expected -{MOST_FRAMES} to {MOST_FRAMES}",
            line.tick
        ));
    }
    let number = line.tick as f64;
    if let Some(last) = last.filter(|last| *last >= number) {
        return Err(format!(
            "`tick`: found {number} after {last}, expected more"
        ));
    }
    if line.persons.len() > MOST_PERSONS {
        return Err(format!(
            "`persons`: found {}, expected at most {MOST_PERSONS}",
            line.persons.len()
        ));
    }
    let persons = line.persons.into_iter().enumerate();
    let bodies = persons.map(|(index, person)| body(index, &person.keypoints, count));
    Ok(DetectedFrame {
        frame: number,
        bodies: bodies.collect::<Result<_, _>>()?,
    })
}

fn body(index: usize, found: &[Option<[f64; 3]>], count: usize) -> Result<Detection, String> {
    // A set with feet begins with COCO's; feet are not used.
    if found.len() != count && found.len() != COCO23.len() {
        return Err(format!(
            "`persons[{index}].keypoints`: found {}, expected {count} or {}",
            found.len(),
            COCO23.len()
        ));
    }
    let each = found.iter().take(count).enumerate().map(|(k, it)| {
        let Some([x, y, score]) = *it else {
            return Ok(None);
        };
        let is_sound =
            (0.0..=MOST_SCORE).contains(&score) && x.abs() <= MOST_PX && y.abs() <= MOST_PX;
        if !is_sound {
            return Err(format!(
                "`persons[{index}].keypoints[{k}]`: found [{x}, {y}, {score}], expected pixels and a score of 0 to 1"
            ));
        }
        Ok(Some(Keypoint {
            px: [x, y],
            score: score.min(1.0),
        }))
    });
    Ok(Detection {
        keypoints: each.collect::<Result<_, _>>()?,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(text: &str) -> Result<Vec<DetectedFrame>, String> {
        parse(text, Path::new("north.jsonl"), 2).map_err(|error| error.to_string())
    }

    #[test]
    fn frames_with_gaps_and_unknown_fields_are_read() {
        let text = "{\"tick\":3,\"persons\":[{\"keypoints\":[[1.5,2,1.02],null],\"id\":7}],\"peaks\":[]}\n\n\
                    {\"tick\":5,\"persons\":[]}\n";
        let frames = read(text).unwrap();
        assert_eq!(frames.len(), 2);
        let seen = Keypoint {
            px: [1.5, 2.0],
            score: 1.0,
        };
        assert_eq!(frames[0].bodies[0].keypoints, [Some(seen), None]);
        assert!(frames[1].bodies.is_empty() && frames[1].frame > 4.5);
    }

    #[test]
    fn invalid_files_are_refused_with_their_line() {
        for (text, expected) in [
            ("{\"tick\":3", "north.jsonl, line 1: column 9: EOF"),
            ("{\"tick\":3}", "missing field `persons`"),
            (
                "{\"tick\":3,\"persons\":[]}\n{\"tick\":3,\"persons\":[]}",
                "line 2: `tick`: found 3 after 3",
            ),
            (
                "{\"tick\":5,\"persons\":[]}\n\n{\"tick\":3,\"persons\":[]}",
                "line 3: `tick`: found 3 after 5, expected more",
            ),
            (
                "{\"tick\":3,\"persons\":[{\"keypoints\":[null]}]}",
                "`persons[0].keypoints`: found 1, expected 2",
            ),
            (
                "{\"tick\":3,\"persons\":[{\"keypoints\":[null,[1,2,7]]}]}",
                "keypoints[1]`: found [1, 2, 7]",
            ),
            (
                "{\"tick\":3,\"persons\":[{\"keypoints\":[null,[1e300,2,1]]}]}",
                "expected pixels",
            ),
        ] {
            let message = read(text).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "[\\[\\]{}\":,a-z0-9\\n.-]{0,200}") {
            let _frames = read(&text);
        }
    }
}
