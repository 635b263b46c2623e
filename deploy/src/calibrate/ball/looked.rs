//! What a finished look at a recording found, as its file of sightings says it.

use std::path::Path;

use farfield_calibration::ball::{BallSighting, FINDER_REVISION, sightings_text};
use serde::{Deserialize, Serialize};

use crate::calibrate::kept::{Kept, fingerprint};
use crate::init::recordings::{Recording, files_of};

/// How the line begins that says of what a file was made.
const MARK: &str = "# farfield calibrate ball: ";

/// What is said of a file of sightings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Looked {
    /// Pictures that were looked at.
    pub(super) frames: u64,
    /// Pictures in which it was seen.
    pub(super) sightings: usize,
    /// Its diameter at the median, pixels, to a hundredth.
    pub(super) diameter_px: f64,
}

impl Looked {
    /// What was found.
    pub(super) fn of(frames: u64, found: &[BallSighting]) -> Self {
        let mut diameters_px: Vec<f64> = found.iter().map(|it| it.diameter_px).collect();
        diameters_px.sort_by(f64::total_cmp);
        let middle_px = diameters_px.get(diameters_px.len() / 2).copied();
        Self {
            frames,
            sightings: found.len(),
            diameter_px: (100.0 * middle_px.unwrap_or_default()).round() / 100.0,
        }
    }

    /// The text of its file.
    pub(super) fn text(&self, found: &[BallSighting], made_of: &str) -> String {
        Kept::text(MARK, &sightings_text(found), self.clone(), made_of)
    }

    /// What the file at `path` says of itself, where it is whole, untouched, and made of the same.
    pub(super) fn find(path: &Path, made_of: &str) -> Option<Self> {
        Kept::find(MARK, path, made_of)
    }
}

/// A fingerprint of every byte of a recording, of `options`, and of the program.
///
/// # Errors
/// When the recording cannot be read.
pub(super) fn made_of(recording: &Recording, options: &str) -> anyhow::Result<String> {
    let revision = FINDER_REVISION.to_string();
    fingerprint(
        &[&revision, options, recording.kind_name()],
        &files_of(recording)?,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_found_is_said_under_the_sightings() {
        let found: Vec<BallSighting> = (0..30)
            .map(|i| BallSighting {
                frame: i,
                px: [i as f64, 7.5],
                diameter_px: 11.117,
                sigma_px: 0.02,
                score: 1.0,
            })
            .collect();
        let looked = Looked::of(40, &found);
        assert_eq!((looked.frames, looked.sightings), (40, 30));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, looked.text(&found, "abc")).unwrap();
        assert_eq!(Looked::find(&path, "abc"), Some(looked));
        assert_eq!(Looked::find(&path, "abd"), None);
    }
}
