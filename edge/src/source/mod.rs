//! Where frames come from: recordings, live cameras and files of 2D keypoints.
//!
//! First in the pipeline; beside `network/`, which loads models, the only part of the core that reads
//! files. The readers that need a child process or a kernel device sit behind the feature `node`. Every source is
//! [`probe`]d before the first tick, so that what is wrong is said then and not at frame 900. A
//! recording that ends early is an error, never a quiet end. Recorded frames are numbered by their
//! place in the recording, live frames by their order of arrival; no reader looks at a clock.

#[cfg(feature = "node")]
mod decoded_pictures;
mod error;
#[cfg(feature = "node")]
mod ffmpeg;
#[cfg(feature = "node")]
mod ffprobe;
#[cfg(feature = "node")]
mod frame_times;
mod images;
mod keypoints;
mod painted;
mod queue;
#[cfg(feature = "node")]
mod sender_clock;
mod sources;
mod ticks;
#[cfg(all(feature = "node", target_os = "linux"))]
mod v4l;
#[cfg(feature = "node")]
mod video;
mod video_format;

use std::ops::Range;
use std::sync::Arc;

use farfield_proto::frames::{Distorted, Pixel};
use farfield_proto::plain_text::one_line;
use farfield_proto::secrets::Secrets;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Source, TickFrom, Venue, VenueCamera};

use crate::picture::Picture;

pub use error::{SourceError, SourceOrigin};
pub use keypoints::KeypointContents;
pub use painted::{MapCrop, MapPainter};
pub use sources::{RecordedSources, Sources};
pub use ticks::common_ticks;
pub use video_format::{FieldOrder, HdrTransfer, VideoFormat};

/// What one camera saw at one tick.
#[derive(Debug, Clone)]
pub enum FrameContent {
    /// The raw picture, with the lens's distortion, of the calibration's size.
    Image(Picture),
    /// 2D keypoints that another program found in it.
    Keypoints(KeypointFrame),
    /// A simulator's view, from which the maps of a crop are painted.
    Painted(Arc<dyn MapPainter>),
}

/// Painted content is equal only to itself.
impl PartialEq for FrameContent {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Image(a), Self::Image(b)) => a == b,
            (Self::Keypoints(a), Self::Keypoints(b)) => a == b,
            (Self::Painted(a), Self::Painted(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

/// 2D keypoint candidates of one picture, in COCO's order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KeypointFrame {
    /// Candidates grouped into persons: `[person][keypoint]`, `None` where one was not seen.
    pub persons: Vec<Vec<Option<KeypointCandidate>>>,
    /// All candidates of each keypoint, of any person: `[keypoint][candidate]`.
    pub peaks: Vec<Vec<KeypointCandidate>>,
}

/// One place where a keypoint may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeypointCandidate {
    /// Where, in pixels of the raw picture.
    pub position: Pixel<Distorted>,
    /// Confidence of the detector, 0 to 1.
    pub score: f32,
}

/// The picture of one camera at one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The tick it stands for.
    pub tick: Tick,
    /// Time of the real capture minus the tick's time, microseconds; within
    /// [`farfield_proto::message::MAX_CAPTURE_OFFSET_US`] either way, or fusion refuses it.
    pub capture_offset_us: i32,
    /// What was seen.
    pub content: FrameContent,
}

/// Frames of one camera, one after the other.
pub trait FrameSource: Send {
    /// The next frame, waiting for it if need be; in tick order. `None` at the end of a recording.
    /// Live sources drop frames that were not taken in time: the newest counts, and the ticks of the dropped ones are
    /// skipped.
    ///
    /// # Errors
    /// The frame cannot be decoded, has another size than the calibration says, or the recording
    /// ends before its announced end. Nothing follows an error.
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError>;

    /// When the driver says that the last frame was captured, on a clock of its own, microseconds; `None`
    /// from sources that do not know.
    fn stamp_us(&self) -> Option<i64> {
        None
    }

    /// When the camera says that the last frame was captured, Unix time by its own clock, microseconds; `None` from cameras that do
    /// not say it.
    fn captured_unix_us(&self) -> Option<i64> {
        None
    }
}

/// What is known of a source before its first frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SourceInfo {
    /// The ticks of a recording, half-open; `None` for live sources.
    pub ticks: Option<Range<Tick>>,
    /// Width and height of its pictures; `None` for keypoints and where only the first frame tells.
    pub size_px: Option<[u32; 2]>,
    /// Frames per second, where the recording says so.
    pub rate_hz: Option<f64>,
    /// What else its container says.
    pub labels: RecordingLabels,
    /// How the pictures of a video are stored.
    pub format: VideoFormat,
    /// Frames of a keypoint file that are the one before once more, where these are too many to be of its rate.
    pub repeats: Option<RepeatedFrames>,
    /// What a keypoint file holds.
    pub contents: Option<KeypointContents>,
    /// Frames of a keypoint file in which everybody is suddenly elsewhere, where these are too many to be in the order of its
    /// pictures.
    pub leaps: Option<LeapingFrames>,
}

/// Frames that equal the one before to the last digit, all people in them: keypoints of a lower rate, each written until
/// the next came.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RepeatedFrames {
    /// How many these are.
    pub repeated: u64,
    /// How many frames hold people.
    pub frames: u64,
}

impl RepeatedFrames {
    /// The share of the frames with people that are repeated, 0 to 1: by as much the rate is lower at which people were
    /// found.
    pub fn repeated_share(self) -> f64 {
        self.repeated as f64 / self.frames.max(1) as f64
    }
}

/// Frames in which nobody goes on who was in the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeapingFrames {
    /// How many these are.
    pub leaps: u64,
    /// How many frames hold people, as the one before does.
    pub frames: u64,
}

/// What the container of a video says of its making; cameras and editing programs write what they like.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecordingLabels {
    /// When it was made, as it is written there: mostly `2026-05-01T18:00:00.000000Z`.
    pub created: Option<String>,
    /// The SMPTE timecode of its first frame.
    pub timecode: Option<String>,
    /// When its first frame is shown, seconds from the container's own start.
    pub start_s: Option<f64>,
}

/// Ticks farther from zero have no exact time in seconds; sums of two others do not overflow.
const MAX_TICK: i64 = 1 << 53;

/// What the venue expects of one camera's source.
#[derive(Debug, Clone)]
struct ExpectedSource {
    at: SourceOrigin,
    size_px: [u32; 2],
    rate_hz: f64,
    first_tick: Tick,
    #[cfg_attr(
        not(feature = "node"),
        expect(dead_code, reason = "only videos have a timecode")
    )]
    tick_from: TickFrom,
}

impl ExpectedSource {
    fn new(camera: &VenueCamera, venue: &Venue) -> Self {
        let place = match &camera.source {
            Source::Video { path }
            | Source::Images { path }
            | Source::Keypoints { path, .. }
            | Source::Simulated { path, .. }
            | Source::Maps { path, .. }
            | Source::V4l { device: path, .. } => path.display().to_string(),
            Source::Ffmpeg { url, .. } => Secrets::of(url).mask(url).into_owned(),
        };
        Self {
            at: SourceOrigin {
                camera: one_line(camera.model.name()),
                place: one_line(&place),
            },
            size_px: camera.model.size_px(),
            rate_hz: venue.rate_hz,
            first_tick: venue.first_tick,
            tick_from: camera.tick_from,
        }
    }

    /// The ticks of a recording of `frames` frames.
    ///
    /// # Errors
    /// [`SourceError::TooLong`] when they reach beyond [`MAX_TICK`].
    fn ticks(&self, frames: u64) -> Result<Range<Tick>, SourceError> {
        let end = i64::try_from(frames)
            .ok()
            .and_then(|frames| self.first_tick.0.checked_add(frames))
            .filter(|&end| end <= MAX_TICK + 1);
        match end {
            Some(end) => Ok(self.first_tick..Tick(end)),
            None => Err(SourceError::TooLong {
                at: self.at.clone(),
                first: self.first_tick,
                frames,
            }),
        }
    }

    /// # Errors
    /// [`SourceError::PixelSize`] when pictures of `found_px` do not fit the calibration.
    fn check_size(&self, found_px: [u32; 2]) -> Result<(), SourceError> {
        if found_px == self.size_px {
            Ok(())
        } else {
            Err(SourceError::PixelSize {
                at: self.at.clone(),
                found_px,
                expected_px: self.size_px,
            })
        }
    }

    /// Frames to skip in a recording that has `has` to begin at `from`.
    ///
    /// # Errors
    /// [`SourceError::OutsideClip`] when the recording has no such tick.
    fn skip(&self, has: &Range<Tick>, from: Tick) -> Result<u64, SourceError> {
        if has.contains(&from) {
            Ok((from - has.start).unsigned_abs())
        } else {
            Err(SourceError::OutsideClip {
                camera: self.at.camera.clone(),
                asked: from..from + 1,
                has: has.clone(),
            })
        }
    }
}

/// Looks at the source of `camera` without decoding pictures: is it there, whole, of the
/// calibration's size and at the venue's rate? Cost: one pass over the container's packets, the
/// headers of all images, or all lines of a keypoint file. Live sources are only looked up; their
/// first frame tells the rest.
///
/// # Errors
/// [`SourceError`], naming the file and what is wrong with it.
pub fn probe(camera: &VenueCamera, venue: &Venue) -> Result<SourceInfo, SourceError> {
    let expected = ExpectedSource::new(camera, venue);
    match &camera.source {
        Source::Keypoints { path, .. } => keypoints::probe(path, &expected),
        Source::Images { path } => images::probe(path, &expected),
        #[cfg(feature = "node")]
        Source::Video { path } => video::probe(path, &expected),
        #[cfg(feature = "node")]
        Source::Ffmpeg { url, .. } => video::probe_live(url, &expected),
        #[cfg(all(feature = "node", target_os = "linux"))]
        Source::V4l { device, settings } => v4l::probe(device, settings, &expected),
        Source::Simulated { .. } | Source::Maps { .. } => {
            Err(SourceError::NoSimulation { at: expected.at })
        }
        #[cfg(not(feature = "node"))]
        Source::Video { .. } => Err(not_built(expected, "video", "the feature `node`")),
        #[cfg(not(feature = "node"))]
        Source::Ffmpeg { .. } => Err(not_built(expected, "ffmpeg", "the feature `node`")),
        #[cfg(not(all(feature = "node", target_os = "linux")))]
        Source::V4l { .. } => Err(not_built(expected, "v4l", "Linux and the feature `node`")),
    }
}

/// Opens the source of `camera`; the first frame of a recording is the one of tick `from`, the
/// first frame of a live source is given that tick. Recordings are probed again: hours may lie
/// between. Dropping the source ends its thread and its child process.
///
/// # Errors
/// All of [`probe`]'s, and [`SourceError::OutsideClip`] when the recording has no tick `from`.
pub fn open(
    camera: &VenueCamera,
    venue: &Venue,
    from: Tick,
) -> Result<Box<dyn FrameSource>, SourceError> {
    let expected = ExpectedSource::new(camera, venue);
    match &camera.source {
        Source::Keypoints { path, .. } => Ok(Box::new(keypoints::open(path, &expected, from)?)),
        Source::Images { path } => Ok(Box::new(images::open(path, expected, from)?)),
        #[cfg(feature = "node")]
        Source::Video { path } => Ok(Box::new(video::open(path, expected, from)?)),
        #[cfg(feature = "node")]
        Source::Ffmpeg { url, options } => {
            let asks_camera = camera.capture_delay_s.is_none();
            let opened = video::open_live((url, options), asks_camera, expected, from)?;
            Ok(Box::new(opened))
        }
        #[cfg(all(feature = "node", target_os = "linux"))]
        Source::V4l { device, settings } => {
            Ok(Box::new(v4l::open(device, settings, expected, from)?))
        }
        Source::Simulated { .. } | Source::Maps { .. } => {
            Err(SourceError::NoSimulation { at: expected.at })
        }
        #[cfg(not(feature = "node"))]
        Source::Video { .. } => Err(not_built(expected, "video", "the feature `node`")),
        #[cfg(not(feature = "node"))]
        Source::Ffmpeg { .. } => Err(not_built(expected, "ffmpeg", "the feature `node`")),
        #[cfg(not(all(feature = "node", target_os = "linux")))]
        Source::V4l { .. } => Err(not_built(expected, "v4l", "Linux and the feature `node`")),
    }
}

/// Opens a video of which nothing is expected: any size, any rate, also one that varies; turned as its container says. Its
/// first frame is tick 0. For who looks at pictures and does not ask when they were taken.
///
/// # Errors
/// [`SourceError`] where it cannot be read, or was cut.
#[cfg(feature = "node")]
pub fn open_video_alone(
    path: &std::path::Path,
) -> Result<(SourceInfo, Box<dyn FrameSource>), SourceError> {
    let (info, source) = video::open_alone(path)?;
    Ok((info, Box::new(source)))
}

#[cfg(not(all(feature = "node", target_os = "linux")))]
fn not_built(expected: ExpectedSource, kind: &'static str, needs: &'static str) -> SourceError {
    SourceError::NotBuilt {
        at: expected.at,
        kind,
        needs,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_beyond_the_last_tick_is_refused() {
        let expected = ExpectedSource {
            at: SourceOrigin {
                camera: "a".to_owned(),
                place: "a.mp4".to_owned(),
            },
            size_px: [4, 4],
            rate_hz: 60.0,
            first_tick: Tick(MAX_TICK),
            tick_from: TickFrom::Clock,
        };
        assert_eq!(expected.ticks(1), Ok(Tick(MAX_TICK)..Tick(MAX_TICK + 1)));
        for frames in [2, u64::MAX] {
            assert!(matches!(
                expected.ticks(frames),
                Err(SourceError::TooLong { .. })
            ));
        }
    }
}
