//! A recording of one camera, looked through for the ball.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use farfield_calibration::ball::{
    Appearance, BallFinder, BallLens, BallRequest, BallSighting, ColourRange, Picture,
};

use super::looked::made_of;
use super::{BallLook, coloured};
use crate::calibrate::lenses::{Lens, lens_of};
use crate::calibrate::progress::LookProgress;
use crate::calibrate::recorded::OwnVenue;
use crate::init::recordings::{self, Recording, RecordingKind};

/// Pictures of the first pass, in which the ball's colour is learnt.
const LEARNING_FRAMES: usize = 300;

/// A recording and the lens that it was made through.
pub(in crate::calibrate) struct LookingCamera {
    recording: Recording,
    lens: BallLens,
    /// The lens, in words that tell it from every other.
    lens_text: String,
    venue: OwnVenue,
}

/// The recordings of the folder, each of another camera.
///
/// # Errors
/// What cannot be read, two recordings of one camera, and keypoint files alone.
pub(super) fn recordings_in(folder: &Path) -> anyhow::Result<Vec<Recording>> {
    let found = recordings::find(folder, None, recordings::OTHER_FOLDER)?;
    let pictures = found
        .into_iter()
        .filter(|it| it.kind != RecordingKind::Keypoints);
    let pictures: Vec<Recording> = pictures.collect();
    recordings::refuse_same_names(&pictures)?;
    ensure!(
        !pictures.is_empty(),
        "{}: found keypoint files, expected videos or folders of pictures",
        folder.display()
    );
    Ok(pictures)
}

/// The recordings, each with its lens.
///
/// # Errors
/// Recordings without a lens, and lenses that nothing can be looked at through.
pub(in crate::calibrate) fn with_lenses(
    recordings: Vec<Recording>,
    lenses: &BTreeMap<String, Lens>,
) -> anyhow::Result<Vec<LookingCamera>> {
    let each = recordings.into_iter().map(|recording| {
        let lens = lens_of(lenses, &recording.name)
            .with_context(|| recording.path.display().to_string())?;
        LookingCamera::new(recording, lens)
    });
    each.collect()
}

impl LookingCamera {
    fn new(recording: Recording, lens: &Lens) -> anyhow::Result<Self> {
        let looks = BallLens::new(lens.size_px, lens.intrinsics, lens.model);
        let looks = looks.with_context(|| format!("the lens of camera {}", recording.name))?;
        Ok(Self {
            venue: OwnVenue::new(&recording, lens)?,
            lens: looks,
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

    /// Fingerprint of all that its file comes of: the recording, the lens, what is looked for.
    ///
    /// # Errors
    /// When the recording cannot be read.
    pub(super) fn made_of(&self, look: &BallLook) -> anyhow::Result<String> {
        let options = format!(
            "{:?} {:?} {:?} {:?}",
            look.by,
            look.appearance(),
            look.diameter_px,
            self.lens_text
        );
        made_of(&self.recording, &options)
    }

    /// How many pictures will be looked at.
    ///
    /// # Errors
    /// When the recording cannot be read.
    pub(super) fn pictures(&self, look: &BallLook) -> anyhow::Result<u64> {
        let frames = self.venue.frames_to_look_at()?;
        let learning = look.appearance().is_none();
        Ok(frames
            + if learning {
                frames.min(LEARNING_FRAMES as u64)
            } else {
                0
            })
    }

    /// How many frames there are, and where it was.
    ///
    /// # Errors
    /// What cannot be read.
    pub(super) fn look(
        &self,
        look: &BallLook,
        progress: &LookProgress,
    ) -> anyhow::Result<(u64, Vec<BallSighting>)> {
        let appearance = match look.appearance() {
            Some(appearance) => appearance,
            None => match self.learnt(look, progress)? {
                (frames, None) => return Ok((frames, Vec::new())),
                (_, Some(colour)) => coloured(look.by, colour),
            },
        };
        let mut finder = self.finder(appearance, look)?;
        let frames = self.show(&mut finder, usize::MAX, progress)?;
        Ok((frames, finder.finish()))
    }

    /// How many frames were looked at, and the colour of the most saturated round thing that moves in them.
    fn learnt(
        &self,
        look: &BallLook,
        progress: &LookProgress,
    ) -> anyhow::Result<(u64, Option<ColourRange>)> {
        let any = Appearance::MovingColour(ColourRange::saturated());
        let mut finder = self.finder(any, look)?;
        let frames = self.show(&mut finder, LEARNING_FRAMES, progress)?;
        let colour = finder.colour();
        let name = &self.recording.name;
        match &colour {
            Some(found) => progress.say(format_args!(
                "camera {name}: its colour has hues of {:.0} to {:.0} degrees",
                found.hue_deg[0], found.hue_deg[1]
            )),
            None => progress.say(format_args!(
                "camera {name}: nothing round, saturated and moving in the first {frames} frames: give --colour"
            )),
        }
        Ok((frames, colour))
    }

    fn finder(&self, appearance: Appearance, look: &BallLook) -> anyhow::Result<BallFinder> {
        let request = BallRequest {
            appearance,
            diameter_px: look.diameter_px,
            lens: Some(self.lens),
        };
        BallFinder::new(request).with_context(|| self.recording.path.display().to_string())
    }

    /// Shows the finder the first frames, at most so many; how many there were.
    fn show(
        &self,
        finder: &mut BallFinder,
        most: usize,
        progress: &LookProgress,
    ) -> anyhow::Result<u64> {
        let named = || self.recording.path.display().to_string();
        self.venue.show(most, |number, picture| {
            let image = picture.into_rgb();
            let picture = Picture::rgb8(image.as_raw(), [image.width(), image.height()]);
            let looked = picture.and_then(|picture| finder.look(number, &picture));
            progress.one();
            looked.with_context(named).map(|_| ())
        })
    }
}
