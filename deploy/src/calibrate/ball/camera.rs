//! Scans the recording of one camera for the ball, and stores the result in its file of sightings.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use farfield_calibration::ball::{
    Appearance, BallFinder, BallLens, BallRequest, BallSighting, ColourRange, FINDER_REVISION,
    Picture, sightings_text,
};
use serde::{Deserialize, Serialize};

use super::{BallScan, coloured};
use crate::calibrate::cached::{Cached, fingerprint};
use crate::calibrate::lenses::{Lens, lens_of};
use crate::calibrate::recorded::{OwnVenue, ScanProgress};
use crate::init::recordings::{self, Recording, RecordingKind, files_of};

/// Images of the first pass, in which the colour of the ball is learnt.
const LEARNING_FRAMES: usize = 300;

/// A recording and its lens.
pub(in crate::calibrate) struct ScanCamera {
    recording: Recording,
    lens: BallLens,
    /// The lens, as text that differs for every lens.
    lens_text: String,
    venue: OwnVenue,
}

/// The recordings of the folder, one for each camera.
///
/// # Errors
/// Unreadable files, two recordings of one camera, only keypoint files.
pub(super) fn recordings_in(folder: &Path) -> anyhow::Result<Vec<Recording>> {
    let found = recordings::find(folder, None, recordings::OTHER_FOLDER)?;
    let images = found
        .into_iter()
        .filter(|it| it.kind != RecordingKind::Keypoints);
    let images: Vec<Recording> = images.collect();
    recordings::refuse_same_names(&images)?;
    ensure!(
        !images.is_empty(),
        "{}: found keypoint files, expected videos or folders of images",
        folder.display()
    );
    Ok(images)
}

/// The recordings, each with its lens.
///
/// # Errors
/// Recordings without a lens, and lenses that cannot be used.
pub(in crate::calibrate) fn with_lenses(
    recordings: Vec<Recording>,
    lenses: &BTreeMap<String, Lens>,
) -> anyhow::Result<Vec<ScanCamera>> {
    let each = recordings.into_iter().map(|recording| {
        let lens = lens_of(lenses, &recording.name)
            .with_context(|| recording.path.display().to_string())?;
        ScanCamera::new(recording, lens)
    });
    each.collect()
}

impl ScanCamera {
    fn new(recording: Recording, lens: &Lens) -> anyhow::Result<Self> {
        let ball_lens = BallLens::new(lens.size_px, lens.intrinsics, lens.model);
        let ball_lens =
            ball_lens.with_context(|| format!("the lens of camera {}", recording.name))?;
        Ok(Self {
            venue: OwnVenue::new(&recording, lens)?,
            lens: ball_lens,
            lens_text: lens.calibration(&recording.name)?,
            recording,
        })
    }

    pub(super) fn name(&self) -> &str {
        &self.recording.name
    }

    /// Its file in `folder`.
    pub(super) fn file(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.txt", self.recording.name))
    }

    /// Fingerprint of everything that its file depends on: recording, lens, options.
    ///
    /// # Errors
    /// When the recording cannot be read.
    pub(super) fn made_of(&self, scan: &BallScan) -> anyhow::Result<String> {
        let options = format!(
            "{:?} {:?} {:?} {:?}",
            scan.by,
            scan.appearance(),
            scan.diameter_px,
            self.lens_text
        );
        fingerprint_of(&self.recording, &options)
    }

    /// Number of images to scan.
    ///
    /// # Errors
    /// When the recording cannot be read.
    pub(super) fn images(&self, scan: &BallScan) -> anyhow::Result<u64> {
        let frames = self.venue.frames_to_scan()?;
        let learning = scan.appearance().is_none();
        Ok(frames
            + if learning {
                frames.min(LEARNING_FRAMES as u64)
            } else {
                0
            })
    }

    /// Number of frames, and the sightings of the ball.
    ///
    /// # Errors
    /// An unreadable recording.
    pub(super) fn scan(
        &self,
        scan: &BallScan,
        progress: &ScanProgress,
    ) -> anyhow::Result<(u64, Vec<BallSighting>)> {
        let appearance = match scan.appearance() {
            Some(appearance) => appearance,
            None => match self.learnt(scan, progress)? {
                (frames, None) => return Ok((frames, Vec::new())),
                (_, Some(colour)) => coloured(scan.by, colour),
            },
        };
        let mut finder = self.finder(appearance, scan)?;
        let frames = self.show(&mut finder, usize::MAX, progress)?;
        Ok((frames, finder.finish()))
    }

    /// Number of scanned frames, and the colour of the most saturated round thing that moves in them.
    fn learnt(
        &self,
        scan: &BallScan,
        progress: &ScanProgress,
    ) -> anyhow::Result<(u64, Option<ColourRange>)> {
        let any = Appearance::MovingColour(ColourRange::saturated());
        let mut finder = self.finder(any, scan)?;
        let frames = self.show(&mut finder, LEARNING_FRAMES, progress)?;
        let colour = finder.colour();
        let name = &self.recording.name;
        match &colour {
            Some(found) => progress.say(format_args!(
                "camera {name}: the colour has hues of {:.0} to {:.0} degrees",
                found.hue_deg[0], found.hue_deg[1]
            )),
            None => progress.say(format_args!(
                "camera {name}: found nothing round, saturated and moving in the first {frames} frames: set --colour"
            )),
        }
        Ok((frames, colour))
    }

    fn finder(&self, appearance: Appearance, scan: &BallScan) -> anyhow::Result<BallFinder> {
        let request = BallRequest {
            appearance,
            diameter_px: scan.diameter_px,
            lens: Some(self.lens),
        };
        BallFinder::new(request).with_context(|| self.recording.path.display().to_string())
    }

    /// Passes the first frames to the finder, at most `most`. Returns their number.
    fn show(
        &self,
        finder: &mut BallFinder,
        most: usize,
        progress: &ScanProgress,
    ) -> anyhow::Result<u64> {
        let named = || self.recording.path.display().to_string();
        self.venue.show(most, |number, picture| {
            let image = picture.into_rgb();
            let picture = Picture::rgb8(image.as_raw(), [image.width(), image.height()]);
            let result = picture.and_then(|picture| finder.look(number, &picture));
            progress.one();
            result.with_context(named).map(|_| ())
        })
    }
}

/// Start of the line with the cache entry.
const MARK: &str = "# farfield calibrate ball: ";

/// Facts that are stored with a file of sightings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct BallCounts {
    /// Scanned images.
    pub(super) frames: u64,
    /// Images with the ball.
    pub(super) sightings: usize,
    /// Median diameter, pixels, to a hundredth.
    pub(super) diameter_px: f64,
}

impl BallCounts {
    pub(super) fn new(frames: u64, found: &[BallSighting]) -> Self {
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
        Cached::text(MARK, &sightings_text(found), self.clone(), made_of)
    }

    /// The facts in the file at `path`, if it is unchanged and made of the same.
    pub(super) fn find(path: &Path, made_of: &str) -> Option<Self> {
        Cached::find(MARK, path, made_of)
    }
}

/// A fingerprint of every byte of a recording, of `options`, and of the program.
///
/// # Errors
/// When the recording cannot be read.
pub(super) fn fingerprint_of(recording: &Recording, options: &str) -> anyhow::Result<String> {
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
    fn counts_are_stored_with_the_sightings() {
        let found: Vec<BallSighting> = (0..30)
            .map(|i| BallSighting {
                frame: i,
                px: [i as f64, 7.5],
                diameter_px: 11.117,
                sigma_px: 0.02,
                score: 1.0,
            })
            .collect();
        let counts = BallCounts::new(40, &found);
        assert_eq!((counts.frames, counts.sightings), (40, 30));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        std::fs::write(&path, counts.text(&found, "abc")).unwrap();
        assert_eq!(BallCounts::find(&path, "abc"), Some(counts));
        assert_eq!(BallCounts::find(&path, "abd"), None);
    }
}
