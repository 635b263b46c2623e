//! Video files, RTSP streams and webcams, decoded by an `ffmpeg` child process (5.1 or later).
//!
//! Frame n of a recording is tick n. Frames are never repeated or dropped to match a rate, so a
//! recording of another or a variable rate is refused. If the venue uses timecodes, the timecode of
//! the first frame gives its tick.

mod frame_spacing;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::time::Duration;

use farfield_proto::secrets::Secrets;
use farfield_proto::tick::Tick;
use farfield_proto::venue::TickFrom;

use self::frame_spacing::{FarOff, OddGap, farthest_off, odd_gap, usual_gap_s};
use super::decoded_pictures::{PictureError, PictureReader};
use super::ffmpeg::{self, Decoding, Ffmpeg, Wanted};
use super::ffprobe::{self, VideoStream};
use super::frame_times::FrameTimes;
use super::queue::{Prefetch, Sender, WhenFull};
use super::sender_clock::SenderClock;
use super::{
    ExpectedSource, Frame, FrameContent, FrameSource, SourceError, SourceInfo, SourceOrigin,
};
use crate::live::timecode::Timecode;
use crate::picture::ColourMatrix;

/// Largest relative difference between the rates of a recording and the venue: 59.94 passes as 60.
const RATE_TOLERANCE: f64 = 0.005;

/// Frames that may be missing near the end of a cut file: frames are not stored in presentation
/// order.
const REORDERED: usize = 32;

/// A live source without a picture for this time is closed and opened again.
const SILENCE: Duration = Duration::from_secs(2);
/// The same for its first picture, which waits for connections and key frames.
const FIRST_SILENCE: Duration = Duration::from_secs(10);

/// If most intervals match the venue's period to this share (containers round times to
/// milliseconds), the recording has the venue's rate. A different mean rate then means lost frames.
const SAME_PERIOD: f64 = 0.1;

pub(super) fn probe(path: &Path, expected: &ExpectedSource) -> Result<SourceInfo, SourceError> {
    check_file(path, &expected.at)?;
    let stream = ffprobe::read_stream(path, &expected.at)?;
    check(&stream, expected)?;
    let expected = by_timecode(&stream, expected)?;
    Ok(SourceInfo {
        ticks: Some(expected.ticks(stream.frames)?),
        size_px: Some(stream.size_px),
        rate_hz: stream.rate_hz,
        labels: stream.labels,
        format: stream.format,
        ..SourceInfo::default()
    })
}

/// The expected source with the first tick from the recording's timecode, if the venue uses it.
fn by_timecode<'a>(
    stream: &VideoStream,
    expected: &'a ExpectedSource,
) -> Result<Cow<'a, ExpectedSource>, SourceError> {
    if expected.tick_from != TickFrom::Timecode {
        return Ok(Cow::Borrowed(expected));
    }
    let wrong = |problem: String| SourceError::Timecode {
        at: expected.at.clone(),
        problem,
    };
    let text = stream.labels.timecode.as_deref();
    let text = text.ok_or_else(|| wrong("found none in the recording".to_owned()))?;
    let rate_hz = stream.rate_hz.unwrap_or(expected.rate_hz);
    let first = Timecode::parse(text, rate_hz).map_err(|error| wrong(error.to_string()))?;
    let mut expected = expected.clone();
    expected.first_tick = Tick(first.frames());
    Ok(Cow::Owned(expected))
}

/// Checks that the file exists and is not empty, because ffprobe's messages for these cases are
/// hard to read.
fn check_file(path: &Path, at: &SourceOrigin) -> Result<(), SourceError> {
    let found = std::fs::File::open(path).and_then(|file| file.metadata());
    let at = at.clone();
    match found {
        Err(problem) => Err(SourceError::NotThere {
            at,
            problem: problem.to_string(),
        }),
        Ok(found) if found.is_file() && found.len() == 0 => Err(SourceError::Unreadable {
            at,
            problem: "the file is empty (0 bytes)".to_owned(),
        }),
        Ok(_) => Ok(()),
    }
}

/// Checks that the recording is complete.
fn check_whole(stream: &VideoStream, at: &SourceOrigin) -> Result<(), SourceError> {
    let at = || at.clone();
    if let Some(announced) = stream
        .announced
        .filter(|&announced| stream.packets < announced)
        .filter(|_| stream.is_counted || !loses_frames(stream))
    {
        let tool_output = stream.tool_output.clone();
        return Err(SourceError::Cut {
            at: at(),
            found: stream.packets,
            announced,
            tool_output,
        });
    }
    if stream.frames == 0 {
        let problem = format!("it has no frames{}", stream.tool_output);
        return Err(SourceError::Unreadable { at: at(), problem });
    }
    Ok(())
}

/// Whether frames are missing inside a recording. Its duration then does not give the number of
/// frames.
fn loses_frames(stream: &VideoStream) -> bool {
    let n_sure = stream.times_s.len().saturating_sub(REORDERED);
    let period_s = stream.rate_hz.map(f64::recip);
    period_s.is_some_and(|period_s| odd_gap(&stream.times_s[..n_sure], period_s).is_some())
}

/// Checks that the recording is complete and fits the calibration and the venue.
fn check(stream: &VideoStream, expected: &ExpectedSource) -> Result<(), SourceError> {
    let at = || expected.at.clone();
    check_whole(stream, &expected.at)?;
    expected.check_size(stream.size_px)?;
    let period_s = expected.rate_hz.recip();
    let varies = |OddGap { before, gap_s }| SourceError::VariableRate {
        at: at(),
        before,
        gap_s,
        period_s,
    };
    let is_expected = |hz: f64| (hz / expected.rate_hz - 1.0).abs() <= RATE_TOLERANCE;
    if let Some(found_hz) = stream.rate_hz.filter(|&hz| !is_expected(hz)) {
        if stream.format.field_order.is_some() && is_expected(2.0 * found_hz) {
            return Err(SourceError::Fields {
                at: at(),
                found_hz,
                expected_hz: expected.rate_hz,
            });
        }
        // Without the lost frames it would have the venue's rate, and converting the rate would not
        // help.
        let usual_s = usual_gap_s(&stream.times_s);
        let usual_s = usual_s.filter(|usual_s| (usual_s / period_s - 1.0).abs() < SAME_PERIOD);
        let gap = usual_s.and_then(|_| odd_gap(&stream.times_s, period_s));
        return Err(gap.map_or_else(
            || SourceError::Rate {
                at: at(),
                found_hz,
                expected_hz: expected.rate_hz,
            },
            varies,
        ));
    }
    if let Some(gap) = odd_gap(&stream.times_s, period_s) {
        return Err(varies(gap));
    }
    match farthest_off(&stream.times_s) {
        Some(FarOff {
            frame,
            late_s,
            most_s,
        }) => Err(SourceError::UnevenRate {
            at: at(),
            frame,
            late_s,
            most_s,
            period_s,
        }),
        None => Ok(()),
    }
}

/// For a live source only the existence of a device file can be checked.
pub(super) fn probe_live(url: &str, expected: &ExpectedSource) -> Result<SourceInfo, SourceError> {
    if url.starts_with("/dev/")
        && let Err(problem) = std::fs::metadata(url)
    {
        return Err(SourceError::NotThere {
            at: expected.at.clone(),
            problem: problem.to_string(),
        });
    }
    Ok(SourceInfo::default())
}

pub(super) fn open(
    path: &Path,
    expected: ExpectedSource,
    from: Tick,
) -> Result<VideoSource, SourceError> {
    let info = probe(path, &expected)?;
    open_ticks(path, expected, from, &info)
}

/// A single video of any size, rate and timecode. Its first frame is tick 0, its rate the mean of
/// its frame times.
pub(super) fn open_alone(path: &Path) -> Result<(SourceInfo, VideoSource), SourceError> {
    let name = path.file_stem().unwrap_or_default();
    let at = SourceOrigin {
        camera: name.to_string_lossy().into_owned(),
        place: path.display().to_string(),
    };
    check_file(path, &at)?;
    let mut stream = ffprobe::read_stream(path, &at)?;
    // At a variable rate the duration does not give the number of frames.
    stream.announced = stream.announced.filter(|_| stream.is_counted);
    check_whole(&stream, &at)?;
    let expected = ExpectedSource {
        at,
        size_px: stream.size_px,
        // The caller does not use the times of the frames.
        rate_hz: 1.0,
        first_tick: Tick(0),
        keypoints: 17,
        tick_from: TickFrom::Clock,
    };
    let ticks = expected.ticks(stream.frames)?;
    let from = ticks.start;
    let info = SourceInfo {
        ticks: Some(ticks),
        size_px: Some(stream.size_px),
        rate_hz: stream.shown_hz.or(stream.rate_hz),
        labels: stream.labels,
        format: stream.format,
        ..SourceInfo::default()
    };
    let source = open_ticks(path, expected, from, &info)?;
    Ok((info, source))
}

/// The frames of a probed recording, from tick `from`.
fn open_ticks(
    path: &Path,
    expected: ExpectedSource,
    from: Tick,
    info: &SourceInfo,
) -> Result<VideoSource, SourceError> {
    let ticks = info.ticks.clone().unwrap_or(from..from);
    let skip = expected.skip(&ticks, from)?;
    let wanted = Wanted::After(skip, info.format);
    let decoded = Ffmpeg::spawn(ffmpeg::file_input(path), wanted, &expected.at)?;
    let mut source = VideoSource::new(decoded, expected, from, WhenFull::Wait)?;
    source.read = skip;
    source.expected = Some((ticks.end - ticks.start).unsigned_abs());
    Ok(source)
}

/// Opens a live source. With `asks_camera`, the capture times of the camera are read if the
/// protocol has them.
pub(super) fn open_live(
    url: &str,
    options: &BTreeMap<String, String>,
    asks_camera: bool,
    expected: ExpectedSource,
    from: Tick,
) -> Result<VideoSource, SourceError> {
    probe_live(url, &expected)?;
    let sender_clock = (asks_camera && url.starts_with("rtsp")).then(SenderClock::open);
    let sender_clock = sender_clock.and_then(|opened| {
        let warn = |error: &std::io::Error| {
            tracing::warn!(camera = %expected.at.camera, %error, "its sender reports are not read");
        };
        opened.inspect_err(warn).ok()
    });
    let decoded = Ffmpeg::spawn(
        ffmpeg::live_input(url, options),
        Wanted::Timed(Secrets::of(url), sender_clock),
        &expected.at,
    )?;
    VideoSource::new(decoded, expected, from, WhenFull::DropOldest)
}

/// A frame of a live source and its time by the stream's clock, microseconds.
type Stamped = (Frame, Option<i64>);

/// Frames decoded by a child process in advance.
pub(super) struct VideoSource {
    prefetch: Prefetch<Stamped>,
    ffmpeg: Ffmpeg,
    at: SourceOrigin,
    stamp_us: Option<i64>,
    /// Frames read, including the skipped ones.
    read: u64,
    /// Expected frames of a recording; `None` for live sources.
    expected: Option<u64>,
    done: bool,
}

impl VideoSource {
    fn new(
        decoding: Decoding,
        expected: ExpectedSource,
        from: Tick,
        when_full: WhenFull,
    ) -> Result<Self, SourceError> {
        let at = expected.at.clone();
        let Decoding {
            ffmpeg,
            stdout,
            times,
            matrix,
        } = decoding;
        let pictures = PictureReader::new(BufReader::new(stdout), expected.size_px);
        let decode = move |sender: Sender<Stamped>| {
            read_frames(pictures, matrix, times, &expected, from, &sender);
        };
        let prefetch =
            Prefetch::spawn(when_full, decode).map_err(|problem| SourceError::Unreadable {
                at: at.clone(),
                problem: problem.to_string(),
            })?;
        Ok(Self {
            prefetch,
            ffmpeg,
            at,
            stamp_us: None,
            read: 0,
            expected: None,
            done: false,
        })
    }

    /// The next frame of a live source, which may hang.
    fn pop_live(&mut self) -> Result<Option<Result<Stamped, SourceError>>, SourceError> {
        let patience = if self.read == 0 {
            FIRST_SILENCE
        } else {
            SILENCE
        };
        self.prefetch.pop_within(patience).map_err(|_| {
            self.done = true;
            self.ffmpeg.kill();
            let (_, tool_output) = self.ffmpeg.finish();
            SourceError::Silent {
                at: self.at.clone(),
                silent_s: patience.as_secs(),
                read: self.read,
                tool_output,
            }
        })
    }

    /// Called once, after the last frame.
    fn end(&mut self) -> Result<Option<Frame>, SourceError> {
        let (success, tool_output) = self.ffmpeg.finish();
        if self.expected != Some(self.read) {
            let (at, read, expected) = (self.at.clone(), self.read, self.expected);
            return Err(SourceError::Ended {
                at,
                read,
                expected,
                tool_output,
            });
        }
        if !success || !tool_output.is_empty() {
            tracing::warn!(camera = %self.at.camera, tool_output, "frames of the recording are damaged");
        }
        Ok(None)
    }
}

impl FrameSource for VideoSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        if self.done {
            return Ok(None);
        }
        let popped = match self.expected {
            Some(_) => self.prefetch.pop(),
            None => self.pop_live()?,
        };
        match popped {
            Some(Ok((frame, stamp_us))) => {
                if let Some(expected) = self.expected.filter(|&expected| self.read >= expected) {
                    self.done = true;
                    return Err(SourceError::Surplus {
                        at: self.at.clone(),
                        expected,
                    });
                }
                self.read += 1;
                self.stamp_us = stamp_us;
                Ok(Some(frame))
            }
            Some(Err(problem)) => {
                self.done = true;
                Err(problem)
            }
            None => {
                self.done = true;
                self.end()
            }
        }
    }

    fn stamp_us(&self) -> Option<i64> {
        self.stamp_us
    }

    fn captured_unix_us(&self) -> Option<i64> {
        self.ffmpeg.unix_us(self.stamp_us?)
    }
}

impl Drop for VideoSource {
    fn drop(&mut self) {
        // The thread is released first, then its pipe is closed, then it is joined.
        self.prefetch.abandon();
        self.ffmpeg.stop();
    }
}

fn read_frames(
    mut pictures: PictureReader<impl BufRead>,
    mut matrix: ColourMatrix,
    mut times: Option<FrameTimes>,
    expected: &ExpectedSource,
    from: Tick,
    sender: &Sender<Stamped>,
) {
    for (number, tick) in (0..).zip(from.0..) {
        let frame = match pictures.next(matrix) {
            Ok(None) => return,
            Ok(Some(picture)) => Ok(Frame {
                tick: Tick(tick),
                capture_offset_us: 0,
                content: FrameContent::Image(picture),
            }),
            Err(PictureError::Size(found_px)) => Err(SourceError::PixelSize {
                at: expected.at.clone(),
                found_px,
                expected_px: expected.size_px,
            }),
            Err(PictureError::Foreign) => Err(SourceError::Unreadable {
                at: expected.at.clone(),
                problem: "ffmpeg wrote something else than pictures".to_owned(),
            }),
        };
        let failed = frame.is_err();
        let stamped = frame.map(|frame| {
            let stamp_us = times.as_mut().and_then(|times| times.for_picture(number));
            matrix = times.as_ref().map_or(matrix, FrameTimes::matrix);
            if times.as_mut().is_some_and(FrameTimes::gives_up) {
                tracing::warn!(
                    camera = %expected.at.camera,
                    "ffmpeg reports no times of the stream's pictures: their arrival times are used"
                );
            }
            (frame, stamp_us)
        });
        if !sender.push(stamped) || failed {
            return;
        }
    }
}

#[cfg(test)]
#[path = "video_tests.rs"]
mod tests;
