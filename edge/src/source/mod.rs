//! Where frames come from: recordings, live cameras and files of 2D keypoints.
//!
//! Sources are the first stage of the pipeline. Only this module and `network/` (loading of models)
//! read files in the core. Readers that need a child process or a kernel device are behind the
//! feature `node`.
//!
//! Every source is [`probe`]d before the first tick, so that errors appear at the start and not at
//! frame 900. A recording that ends early is an error. Frames of a recording are numbered by their
//! place in it, live frames by their order of arrival. No reader uses a clock.

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
mod queue;
#[cfg(feature = "node")]
mod sender_clock;
mod ticks;
#[cfg(all(feature = "node", target_os = "linux"))]
mod v4l;
#[cfg(feature = "node")]
mod video;
mod video_format;

use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Distorted, Pixel};
use farfield_proto::grid::CellGrid;
use farfield_proto::message::CameraBox;
use farfield_proto::patch::Maps;
use farfield_proto::plain_text::one_line;
use farfield_proto::secrets::Secrets;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Source, TickFrom, Venue, VenueCamera};

use crate::picture::Picture;

pub use error::{SourceError, SourceOrigin};
pub use keypoints::KeypointContents;
pub use ticks::common_ticks;
pub use video_format::{FieldOrder, HdrTransfer, VideoFormat};

/// What one camera saw at one tick.
#[derive(Debug, Clone)]
pub enum FrameContent {
    /// The raw picture: distorted by the lens, of the calibration's size.
    Image(Picture),
    /// 2D keypoints that another program detected in the picture.
    Keypoints(KeypointFrame),
    /// A simulator's view: the source of the maps of a crop.
    Painted(Arc<dyn MapPainter>),
}

/// Painted content equals only itself.
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

/// 2D keypoint candidates of one picture, in the order of the venue's keypoints.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KeypointFrame {
    /// Candidates grouped into persons: `[person][keypoint]`, `None` for a missing keypoint.
    pub persons: Vec<Vec<Option<KeypointCandidate>>>,
    /// All candidates of each keypoint, of any person: `[keypoint][candidate]`.
    pub peaks: Vec<Vec<KeypointCandidate>>,
}

/// A possible position of one keypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeypointCandidate {
    /// Position, pixels of the raw picture.
    pub position: Pixel<Distorted>,
    /// Confidence of the detector, 0 to 1.
    pub score: f32,
}

/// The picture of one camera at one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// The tick of the frame.
    pub tick: Tick,
    /// Time of capture minus time of the tick, microseconds. Fusion refuses values beyond
    /// [`farfield_proto::message::MAX_CAPTURE_OFFSET_US`] in either direction.
    pub capture_offset_us: i32,
    /// The content of the frame.
    pub content: FrameContent,
}

/// The frames of one camera in order.
pub trait FrameSource: Send {
    /// Waits for the next frame and returns it, in tick order; `None` at the end of a recording.
    /// Live sources keep only the newest frames. The ticks of dropped frames are skipped.
    ///
    /// # Errors
    /// The frame cannot be decoded, has another size than the calibration says, or the recording
    /// ends before its announced end. Nothing follows an error.
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError>;

    /// Time of capture of the last frame by the driver's clock, microseconds; `None` if unknown.
    fn stamp_us(&self) -> Option<i64> {
        None
    }

    /// Time of capture of the last frame by the camera's clock, Unix time in microseconds; `None`
    /// if the camera does not report it.
    fn captured_unix_us(&self) -> Option<i64> {
        None
    }
}

/// What is known of a source before its first frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SourceInfo {
    /// The ticks of a recording, half-open; `None` for live sources.
    pub ticks: Option<Range<Tick>>,
    /// Width and height of the pictures; `None` for keypoints and for sources whose size is known
    /// only from the first frame.
    pub size_px: Option<[u32; 2]>,
    /// Frames per second, if the recording states a rate.
    pub rate_hz: Option<f64>,
    /// Other metadata of the container.
    pub labels: RecordingLabels,
    /// How the pictures of a video are stored.
    pub format: VideoFormat,
    /// Repeated frames of a keypoint file, if they are too frequent for its rate.
    pub repeats: Option<RepeatedFrames>,
    /// Summary of a keypoint file.
    pub contents: Option<KeypointContents>,
    /// Frames of a keypoint file at which all people jump, if they are too frequent for lines in
    /// time order.
    pub leaps: Option<LeapingFrames>,
}

/// Frames that equal the previous frame in every digit. They appear if keypoints of a lower rate
/// are repeated until the next detection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RepeatedFrames {
    /// Number of repeated frames.
    pub repeated: u64,
    /// Number of frames with people.
    pub frames: u64,
}

impl RepeatedFrames {
    /// Share of the frames with people that are repeated, 0 to 1. The rate of the detections is
    /// lower by this share.
    pub fn repeated_share(self) -> f64 {
        self.repeated as f64 / self.frames.max(1) as f64
    }
}

/// Frames in which no person continues the motion of the previous frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeapingFrames {
    /// Number of such frames.
    pub leaps: u64,
    /// Number of frames with people whose previous frame also has people.
    pub frames: u64,
}

/// Metadata in the container of a video. Cameras and editing programs write them without a common
/// rule.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RecordingLabels {
    /// Creation time as written in the file, usually like `2026-05-01T18:00:00.000000Z`.
    pub created: Option<String>,
    /// The SMPTE timecode of its first frame.
    pub timecode: Option<String>,
    /// Presentation time of the first frame, seconds from the start of the container.
    pub start_s: Option<f64>,
}

/// Larger ticks have no exact time in seconds. The sum of two ticks within this limit cannot
/// overflow.
const MAX_TICK: i64 = 1 << 53;

/// What the venue expects of one camera's source.
#[derive(Debug, Clone)]
struct ExpectedSource {
    at: SourceOrigin,
    size_px: [u32; 2],
    rate_hz: f64,
    first_tick: Tick,
    /// Keypoints of each person in a keypoint file.
    keypoints: usize,
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
            keypoints: venue.keypoints.len(),
            tick_from: camera.tick_from,
        }
    }

    /// The ticks of a recording with `frames` frames.
    ///
    /// # Errors
    /// [`SourceError::TooLong`] if they exceed [`MAX_TICK`].
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
    /// [`SourceError::PixelSize`] if `found_px` is not the calibration's size.
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

    /// Number of frames to skip in a recording with the ticks `has`, to begin at `from`.
    ///
    /// # Errors
    /// [`SourceError::OutsideClip`] if the recording does not have this tick.
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

/// Checks the source of `camera` without decoding pictures: it exists, is complete, and has the
/// calibration's size and the venue's rate. Cost: one pass over the container's packets, the
/// headers of all images, or all lines of a keypoint file. For a live source only its existence is
/// checked; the rest is checked at its first frame.
///
/// # Errors
/// [`SourceError`], with the file and the problem.
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

/// Opens the source of `camera`. The first frame of a recording is that of tick `from`; the first
/// frame of a live source gets that tick. Recordings are probed again, because hours can pass
/// between the two calls. Dropping the source ends its thread and its child process.
///
/// # Errors
/// All errors of [`probe`], and [`SourceError::OutsideClip`] if the recording does not have tick
/// `from`.
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
            let opened = video::open_live(url, options, asks_camera, expected, from)?;
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

/// Opens a video without expectations: any size and any rate, also a variable one. Rotation
/// metadata are applied. The first frame is tick 0. For callers that need the pictures but not
/// their times.
///
/// # Errors
/// [`SourceError`] if the video cannot be read or was cut.
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

/// Opens the sources of a venue's cameras.
pub trait Sources: Debug + Send + Sync {
    /// See [`probe`].
    ///
    /// # Errors
    /// [`SourceError`], with the file and the problem.
    fn probe(&self, camera: &VenueCamera, venue: &Venue) -> Result<SourceInfo, SourceError>;

    /// See [`open`].
    ///
    /// # Errors
    /// All errors of [`Self::probe`], and [`SourceError::OutsideClip`] if the recording does not
    /// have tick `from`.
    fn open(
        &self,
        camera: &VenueCamera,
        venue: &Venue,
        from: Tick,
    ) -> Result<Box<dyn FrameSource>, SourceError>;
}

/// Recordings, live cameras and keypoint files. Simulated sources are refused.
#[derive(Debug, Clone, Copy, Default)]
pub struct RecordedSources;

impl Sources for RecordedSources {
    fn probe(&self, camera: &VenueCamera, venue: &Venue) -> Result<SourceInfo, SourceError> {
        probe(camera, venue)
    }

    fn open(
        &self,
        camera: &VenueCamera,
        venue: &Venue,
        from: Tick,
    ) -> Result<Box<dyn FrameSource>, SourceError> {
        open(camera, venue, from)
    }
}

/// A crop for which maps are painted.
#[derive(Debug, Clone, Copy)]
pub struct MapCrop<'a> {
    /// The person's box at the frame's tick.
    pub region: &'a CameraBox,
    /// Positions of the cells, in undistorted pixels of `camera`.
    pub grid: &'a CellGrid,
    /// Requested sigma, cells.
    pub sigma_cells: f64,
    /// The camera.
    pub camera: &'a CameraModel,
    /// Cells below this value (0 to 255) are dropped after painting, so the painter can skip them.
    pub floor: u8,
}

/// What one camera saw at one tick, as the maps that a network would return.
///
/// The maps are those of the keypoints of [`farfield_proto::keypoints::COCO17`]. Equal crops give
/// equal maps, independent of earlier calls.
pub trait MapPainter: Debug + Send + Sync {
    /// Paints the 17 maps of `crop` into `into`, which has the grid's size and contains only zeros.
    fn paint(&self, crop: &MapCrop<'_>, into: &mut Maps);

    /// For the camera's health: a hash of the picture and its mean brightness, 0 to 255; `None`
    /// without a picture.
    fn picture_sample(&self) -> Option<(u64, f64)> {
        None
    }

    /// The people that a detector returns for the whole picture: `[person][keypoint]`, 17 each,
    /// `None` for a missing keypoint.
    fn persons(&self) -> Vec<Vec<Option<KeypointCandidate>>>;
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
            keypoints: 17,
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
