//! A recording of one camera, opened as those of venues are: videos, and folders of numbered pictures.

use anyhow::{Context as _, bail};
use farfield_edge::source::{FrameContent, RecordedSources, Sources as _};
use farfield_proto::calibration::Calibration;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};
use image::RgbImage;

use super::lenses::Lens;
use crate::init::rate;
use crate::init::recordings::Recording;

/// A recording in a venue of its own, whose networks are never opened.
pub(super) struct OwnVenue {
    venue: Venue,
}

impl OwnVenue {
    /// Of a camera whose lens is known.
    ///
    /// # Errors
    /// What no calibration can say, and what cannot be read.
    pub(super) fn new(recording: &Recording, lens: &Lens) -> anyhow::Result<Self> {
        let path = &recording.path;
        let full = std::path::absolute(path).with_context(|| path.display().to_string())?;
        let calibration = lens.calibration(&recording.name)?;
        let calibration = Calibration::parse(&calibration, path)?;
        let quoted = |text: &str| toml::Value::from(text).to_string();
        // Of numbered pictures nobody knows, and nothing depends on it.
        let rate_hz = rate::of_videos(std::slice::from_ref(recording))?.unwrap_or(30.0);
        let text = format!(
            "name = \"own\"\nrate_hz = {rate_hz:?}\ncalibration = \"lens.toml\"\nnetwork = \"none.toml\"\ndetector = \"none.toml\"\n\
             [[viewpoint]]\nname = \"v\"\n[[viewpoint.camera]]\nname = {}\nsource = {{ kind = \"{}\", path = {} }}\n",
            quoted(&recording.name),
            recording.kind_name(),
            quoted(&full.display().to_string())
        );
        let venue = Venue::parse(&text, path, calibration)?;
        Ok(Self { venue })
    }

    /// How many frames it has.
    ///
    /// # Errors
    /// What cannot be read.
    pub(super) fn frames(&self) -> anyhow::Result<u64> {
        let ticks = RecordedSources.probe(self.camera()?, &self.venue)?.ticks;
        Ok(ticks.map_or(0, |ticks| (ticks.end - ticks.start).unsigned_abs()))
    }

    fn camera(&self) -> anyhow::Result<&VenueCamera> {
        let first = self.venue.cameras.first();
        first.context("a venue without cameras")
    }

    /// Shows the first frames, at most so many; how many there were.
    ///
    /// # Errors
    /// What cannot be read, and what `look` says.
    pub(super) fn show(
        &self,
        most: usize,
        mut look: impl FnMut(u64, RgbImage) -> anyhow::Result<()>,
    ) -> anyhow::Result<u64> {
        let camera = self.camera()?;
        let mut source = RecordedSources.open(camera, &self.venue, Tick(0))?;
        let mut frames = 0;
        while (frames as usize) < most
            && let Some(frame) = source.next_frame()?
        {
            let FrameContent::Image(image) = frame.content else {
                bail!("camera {}: found no pictures", camera.model.name());
            };
            look(u64::try_from(frame.tick.0).unwrap_or_default(), image)?;
            frames += 1;
        }
        Ok(frames)
    }
}
