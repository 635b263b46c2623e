//! A recording of one camera, opened as those of venues are: videos, and folders of numbered pictures.

use anyhow::{Context as _, bail};
use farfield_edge::picture::Picture;
use farfield_edge::source::{FrameContent, RecordedSources, SourceInfo, Sources as _};
use farfield_proto::calibration::Calibration;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::lenses::Lens;
use crate::init::rate;
use crate::init::recordings::Recording;
use crate::recorded_formats::{of_camera, say_format};

/// How high a camera is thought to hang, metres, and how far below the horizon it looks: neither matters much.
const HEIGHT_M: f64 = 3.0;
const DOWN_RAD: f64 = 0.17;
/// Between these distances people are thought to walk, metres.
const NEAR_M: f64 = 1.0;
const FAR_M: f64 = 25.0;
/// Parts of a picture that a detector looks at, at most.
const MOST_TILES: usize = 64;

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
        let calibration = lens.calibration(&recording.name)?;
        Self::of(recording, &calibration, "")
    }

    /// Of a camera before which people walk, and of which nobody knows where it stands: as if it looked over a floor from
    /// [`HEIGHT_M`], so that detectors look closer at what is far away.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn over_a_floor(recording: &Recording, lens: &Lens) -> anyhow::Result<Self> {
        let (down, ahead) = (DOWN_RAD.sin(), DOWN_RAD.cos());
        let rows = Matrix3::new(1.0, 0.0, 0.0, 0.0, -down, -ahead, 0.0, ahead, -down);
        let rotation =
            UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows));
        let shift = Translation3::from(-(rotation * Vector3::new(0.0, 0.0, HEIGHT_M)));
        let pose = Isometry3::from_parts(shift, rotation);
        let calibration = lens.calibration_at(&recording.name, pose)?;
        let aside_m = 0.6 * FAR_M;
        let floor = format!(
            "[field]\nmin_m = [-{aside_m:?}, {NEAR_M:?}, 0.0]\nmax_m = [{aside_m:?}, {FAR_M:?}, 2.5]\n\
             [births]\ntiles_per_look = {MOST_TILES}\n"
        );
        Self::of(recording, &calibration, &floor)
    }

    fn of(recording: &Recording, calibration: &str, more: &str) -> anyhow::Result<Self> {
        let path = &recording.path;
        let full = std::path::absolute(path).with_context(|| path.display().to_string())?;
        let calibration = Calibration::parse(calibration, path)?;
        let quoted = |text: &str| toml::Value::from(text).to_string();
        // Of numbered pictures nobody knows, and nothing depends on it.
        let rate_hz = rate::of_videos(std::slice::from_ref(recording))?.unwrap_or(30.0);
        let text = format!(
            "name = \"own\"\nrate_hz = {rate_hz:?}\ncalibration = \"lens.toml\"\nnetwork = \"none.toml\"\ndetector = \"none.toml\"\n{more}\
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
        Ok(frames_in(&self.info()?))
    }

    /// The same, before they are looked at: what is remarkable about how they are stored is said.
    ///
    /// # Errors
    /// As [`Self::frames`].
    pub(super) fn frames_to_look_at(&self) -> anyhow::Result<u64> {
        let info = self.info()?;
        say_format(&of_camera(self.camera()?.model.name()), &info);
        Ok(frames_in(&info))
    }

    fn info(&self) -> anyhow::Result<SourceInfo> {
        Ok(RecordedSources.probe(self.camera()?, &self.venue)?)
    }

    /// The venue, of this camera alone.
    pub(super) fn venue(&self) -> &Venue {
        &self.venue
    }

    /// The camera.
    ///
    /// # Errors
    /// Never: there is one.
    pub(super) fn camera(&self) -> anyhow::Result<&VenueCamera> {
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
        mut look: impl FnMut(u64, Picture) -> anyhow::Result<()>,
    ) -> anyhow::Result<u64> {
        let camera = self.camera()?;
        let mut source = RecordedSources.open(camera, &self.venue, Tick(0))?;
        let mut frames = 0;
        while (frames as usize) < most
            && let Some(frame) = source.next_frame()?
        {
            let FrameContent::Image(picture) = frame.content else {
                bail!("camera {}: found no pictures", camera.model.name());
            };
            let number = u64::try_from(frame.tick.0).unwrap_or_default();
            look(number, picture)?;
            frames += 1;
        }
        Ok(frames)
    }
}

fn frames_in(info: &SourceInfo) -> u64 {
    let ticks = info.ticks.as_ref();
    ticks.map_or(0, |ticks| (ticks.end - ticks.start).unsigned_abs())
}
