//! The recording of one camera, a video or a folder of numbered images, opened like a source of a venue; and the
//! progress of scans.

use std::fmt;
use std::io::{IsTerminal as _, stderr};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use anyhow::{Context as _, bail};
use farfield_edge::picture::Picture;
use farfield_edge::source::{FrameContent, RecordedSources, SourceInfo, Sources as _};
use farfield_node::process::say;
use farfield_proto::calibration::Calibration;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use tokio::time::Instant;

use super::lenses::Lens;
use crate::init::recordings;
use crate::init::recordings::Recording;
use crate::recording_checks::{camera_name, print_format};

/// Assumed height of a camera, metres, and its angle below the horizon; both need not be exact.
const HEIGHT_M: f64 = 3.0;
const DOWN_RAD: f64 = 0.17;
/// Assumed distances of walking people, metres.
const NEAR_M: f64 = 1.0;
const FAR_M: f64 = 25.0;
/// Limit for the parts of an image that a detector processes.
const MOST_TILES: usize = 64;

/// A recording in a venue of its own, whose networks are never opened.
pub(super) struct OwnVenue {
    venue: Venue,
}

impl OwnVenue {
    /// For a camera with a known lens.
    ///
    /// # Errors
    /// A lens that no calibration can hold, or an unreadable recording.
    pub(super) fn new(recording: &Recording, lens: &Lens) -> anyhow::Result<Self> {
        let calibration = lens.calibration(&recording.name)?;
        Self::create(recording, &calibration, "")
    }

    /// For a camera of people whose pose is unknown: it is assumed at [`HEIGHT_M`] above a floor, so that detectors
    /// magnify distant areas.
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
        Self::create(recording, &calibration, &floor)
    }

    fn create(recording: &Recording, calibration: &str, more: &str) -> anyhow::Result<Self> {
        let path = &recording.path;
        let full = std::path::absolute(path).with_context(|| path.display().to_string())?;
        let calibration = Calibration::parse(calibration, path)?;
        let quoted = |text: &str| toml::Value::from(text).to_string();
        // Numbered images have no rate, and nothing depends on it.
        let rate_hz = recordings::rate_of_videos(std::slice::from_ref(recording))?.unwrap_or(30.0);
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

    /// Number of frames.
    ///
    /// # Errors
    /// An unreadable recording.
    pub(super) fn frames(&self) -> anyhow::Result<u64> {
        Ok(frames_in(&self.info()?))
    }

    /// The same before a scan; also prints notes on the format of the recording.
    ///
    /// # Errors
    /// As [`Self::frames`].
    pub(super) fn frames_to_scan(&self) -> anyhow::Result<u64> {
        let info = self.info()?;
        print_format(&camera_name(self.camera()?.model.name()), &info);
        Ok(frames_in(&info))
    }

    fn info(&self) -> anyhow::Result<SourceInfo> {
        Ok(RecordedSources.probe(self.camera()?, &self.venue)?)
    }

    /// The venue of this camera.
    pub(super) fn venue(&self) -> &Venue {
        &self.venue
    }

    /// The camera.
    ///
    /// # Errors
    /// Never: there is always one.
    pub(super) fn camera(&self) -> anyhow::Result<&VenueCamera> {
        let first = self.venue.cameras.first();
        first.context("a venue without cameras")
    }

    /// Passes the first frames to `visit`, at most `most`. Returns their number.
    ///
    /// # Errors
    /// An unreadable recording, and errors of `visit`.
    pub(super) fn show(
        &self,
        most: usize,
        mut visit: impl FnMut(u64, Picture) -> anyhow::Result<()>,
    ) -> anyhow::Result<u64> {
        let camera = self.camera()?;
        let mut source = RecordedSources.open(camera, &self.venue, Tick(0))?;
        let mut frames = 0;
        while (frames as usize) < most
            && let Some(frame) = source.next_frame()?
        {
            let FrameContent::Image(picture) = frame.content else {
                bail!("camera {}: found no images", camera.model.name());
            };
            let number = u64::try_from(frame.tick.0).unwrap_or_default();
            visit(number, picture)?;
            frames += 1;
        }
        Ok(frames)
    }
}

fn frames_in(info: &SourceInfo) -> u64 {
    let ticks = info.ticks.as_ref();
    ticks.map_or(0, |ticks| (ticks.end - ticks.start).unsigned_abs())
}

/// Interval of lines without a terminal; a short scan prints none.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Counts the images of all cameras.
pub(super) struct ScanProgress {
    bar: Option<ProgressBar>,
    images: u64,
    done: AtomicU64,
    last_line: Mutex<Instant>,
}

impl ScanProgress {
    pub(super) fn new(images: u64) -> Self {
        let bar = stderr().is_terminal().then(|| {
            // The bar limits itself to twenty updates per second.
            let bar = ProgressBar::new(images);
            if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} images {eta}") {
                bar.set_style(style);
            }
            bar
        });
        Self {
            bar,
            images,
            done: AtomicU64::new(0),
            last_line: Mutex::new(Instant::now()),
        }
    }

    /// One more image was scanned.
    pub(super) fn one(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        if let Some(bar) = &self.bar {
            bar.inc(1);
        } else if let Ok(mut last) = self.last_line.try_lock()
            && last.elapsed() >= LINE_EVERY
        {
            *last = Instant::now();
            say(format_args!("{done} of {} images", self.images));
        }
    }

    /// Prints a line above the bar.
    pub(super) fn say(&self, line: fmt::Arguments<'_>) {
        match &self.bar {
            Some(bar) => bar.suspend(|| say(line)),
            None => say(line),
        }
    }
}

impl Drop for ScanProgress {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
