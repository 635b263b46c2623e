//! Errors of sources, written for an operator: the file, the camera, the field or line, what was
//! found and what was expected.

use std::fmt;
use std::ops::Range;

use farfield_proto::tick::Tick;
use thiserror::Error;

/// The recording or device of an error, and its camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceOrigin {
    /// The camera's name in the venue and in the calibration.
    pub camera: String,
    /// File, pattern, device or URL of the camera's `source`.
    pub place: String,
}

impl fmt::Display for SourceOrigin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: camera `{}`", self.place, self.camera)
    }
}

/// Why a source cannot provide frames.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SourceError {
    /// The file or device of the venue does not exist or cannot be opened.
    #[error("{at}: `source`: cannot be opened: {problem}")]
    NotThere {
        /// Which source.
        at: SourceOrigin,
        /// Message of the operating system.
        problem: String,
    },
    /// The content does not match the kind of the source.
    #[error("{at}: cannot be read: {problem}")]
    Unreadable {
        /// Which source.
        at: SourceOrigin,
        /// Message of the decoder.
        problem: String,
    },
    /// A program for video decoding is not installed.
    #[error(
        "{at}: needs the program `{tool}`, which is not installed: install ffmpeg \
         (Debian, Ubuntu: `apt install ffmpeg`; Fedora: `dnf install ffmpeg`; macOS: `brew install ffmpeg`; \
         Windows: `winget install ffmpeg`)"
    )]
    ToolMissing {
        /// Which source.
        at: SourceOrigin,
        /// `ffmpeg` or `ffprobe`.
        tool: &'static str,
    },
    /// This build has no reader for the kind of source.
    #[error("{at}: `source.kind`: this build cannot read \"{kind}\", which needs {needs}")]
    NotBuilt {
        /// Which source.
        at: SourceOrigin,
        /// The kind in the venue file.
        kind: &'static str,
        /// The required operating system or Cargo feature.
        needs: &'static str,
    },
    /// This program has no simulated sources.
    #[error(
        "{at}: `source.kind`: found a simulated camera, but only the command `farfield` has simulated \
         sources (`farfield edge` in place of `farfield-edge`)"
    )]
    NoSimulation {
        /// Which source.
        at: SourceOrigin,
    },
    /// The scene of a simulated camera cannot be used.
    #[error("camera `{camera}`: {problem}")]
    Scene {
        /// The camera's name.
        camera: String,
        /// What was found and what was expected, with the scene's file and field.
        problem: String,
    },
    /// The images do not have the calibration's size.
    #[error(
        "{at}: its images have {}x{} pixels, the calibration's `size` of this camera is {}x{}{}",
        found_px[0], found_px[1], expected_px[0], expected_px[1], turned(*found_px, *expected_px)
    )]
    PixelSize {
        /// Which source.
        at: SourceOrigin,
        /// Decoded width and height, with rotation metadata applied.
        found_px: [u32; 2],
        /// Width and height in the calibration.
        expected_px: [u32; 2],
    },
    /// The recording runs at another rate than the venue.
    #[error("{at}: has {} frames per second, the venue's `rate_hz` is {expected_hz:?}", rounded(*found_hz, 3))]
    Rate {
        /// Which source.
        at: SourceOrigin,
        /// Mean rate of the recording.
        found_hz: f64,
        /// `rate_hz` of the venue.
        expected_hz: f64,
    },
    /// The recording is interlaced: its fields have the venue's rate, its pictures half of it.
    #[error(
        "{at}: is interlaced: {} pictures of two fields a second, the venue's `rate_hz` is {expected_hz:?}; \
         make a picture of each field first (`ffmpeg -i IN -vf bwdif=mode=send_field OUT`)", rounded(*found_hz, 3)
    )]
    Fields {
        /// Which source.
        at: SourceOrigin,
        /// Mean rate of its pictures.
        found_hz: f64,
        /// `rate_hz` of the venue.
        expected_hz: f64,
    },
    /// Frames are missing or doubled, so that frame n is not tick n.
    #[error(
        "{at}: variable frame rate, or frames were lost: {} s between frames {before} and {}, expected {} s; \
         make it constant first ({})",
        rounded(*gap_s, 4), before + 1, rounded(*period_s, 4), made_constant(*period_s)
    )]
    VariableRate {
        /// Which source.
        at: SourceOrigin,
        /// The frame before the irregular interval, counted from 0.
        before: usize,
        /// The interval found.
        gap_s: f64,
        /// The interval of the venue's rate.
        period_s: f64,
    },
    /// All intervals are regular, but frames come long before or after their ticks.
    #[error(
        "{at}: variable frame rate: frame {frame} is {} s {} than it would be at an even rate, expected at most {} s; \
         make it constant first ({})",
        rounded(late_s.abs(), 4), if *late_s > 0.0 { "later" } else { "earlier" }, rounded(*most_s, 4),
        made_constant(*period_s)
    )]
    UnevenRate {
        /// Which source.
        at: SourceOrigin,
        /// The frame with the largest deviation, counted from 0.
        frame: usize,
        /// Its delay, seconds.
        late_s: f64,
        /// The largest allowed deviation, seconds.
        most_s: f64,
        /// The interval of the venue's rate.
        period_s: f64,
    },
    /// The file was cut: it announces more frames than it contains.
    #[error(
        "{at}: holds {found} frames, its header announces {announced}: the file was cut{tool_output}"
    )]
    Cut {
        /// Which source.
        at: SourceOrigin,
        /// Frames in the file.
        found: u64,
        /// Frames that the container announces.
        announced: u64,
        /// Output of the reading program, with a leading separator; can be empty.
        tool_output: String,
    },
    /// The recording ended early, or a live source ended.
    #[error("{at}: ended after {read} frames{}{tool_output}", expected.map(|n| format!(", expected {n}")).unwrap_or_default())]
    Ended {
        /// Which source.
        at: SourceOrigin,
        /// Frames read.
        read: u64,
        /// Expected number of frames; `None` for live sources.
        expected: Option<u64>,
        /// Output of the decoder, with a leading separator; can be empty.
        tool_output: String,
    },
    /// A live source is open but provides no pictures.
    #[error("{at}: no picture for {silent_s} s after {read} frames{tool_output}")]
    Silent {
        /// Which source.
        at: SourceOrigin,
        /// Waiting time, seconds.
        silent_s: u64,
        /// Frames read before.
        read: u64,
        /// Output of the decoder, with a leading separator; can be empty.
        tool_output: String,
    },
    /// The decoder returned more frames than the file lists.
    #[error("{at}: has more frames than the {expected} that its index lists")]
    Surplus {
        /// Which source.
        at: SourceOrigin,
        /// Expected number of frames.
        expected: u64,
    },
    /// The venue uses the timecode of a recording that has no usable one.
    #[error("{at}: `tick_from` is \"timecode\": {problem}")]
    Timecode {
        /// Which source.
        at: SourceOrigin,
        /// What was found and what was expected.
        problem: String,
    },
    /// A line of a keypoint file is wrong.
    #[error("{}:{line}: camera `{}`: {}{problem}", at.place, at.camera,
        field.as_ref().map(|field| format!("`{field}`: ")).unwrap_or_default())]
    Line {
        /// Which source.
        at: SourceOrigin,
        /// The line, counted from 1.
        line: usize,
        /// Path of the field in the line, such as `persons[0].keypoints[5]`; `None` if the whole
        /// line is wrong.
        field: Option<String>,
        /// What was found and what was expected.
        problem: String,
    },
    /// The `path` of an image sequence has no usable number pattern, or no file matches it.
    #[error("{at}: `source.path`: {problem}")]
    Pattern {
        /// Which source.
        at: SourceOrigin,
        /// What was found and what was expected.
        problem: String,
    },
    /// The recording continues beyond the ticks that have an exact time.
    #[error("{at}: holds {frames} frames from tick {first} on, beyond the last valid tick")]
    TooLong {
        /// Which source.
        at: SourceOrigin,
        /// The venue's `first_tick`.
        first: Tick,
        /// Frames of the recording.
        frames: u64,
    },
    /// An image sequence has a gap in its numbers.
    #[error("{at}: image {before} is followed by image {after}: there must be no gap")]
    Gap {
        /// Which source.
        at: SourceOrigin,
        /// The last number before the gap.
        before: u64,
        /// The first number after it.
        after: u64,
    },
    /// A requested tick is outside the recording.
    #[error(
        "`--ticks` {}..{} is outside the recording of camera `{camera}`, which has {}..{}",
        asked.start, asked.end, has.start, has.end
    )]
    OutsideClip {
        /// The camera of the recording.
        camera: String,
        /// The requested ticks.
        asked: Range<Tick>,
        /// The ticks of the recording.
        has: Range<Tick>,
    },
    /// `--ticks` holds no tick.
    #[error("`--ticks` {}..{} holds no tick", asked.start, asked.end)]
    NoTicks {
        /// The requested ticks.
        asked: Range<Tick>,
    },
    /// The recordings of a venue cover different ticks.
    #[error(
        "the recordings differ in length: camera `{}` has ticks {}..{}, camera `{}` has {}..{}; \
         {}",
        a.0, a.1.start, a.1.end, b.0, b.1.start, b.1.end, shared_ticks(shared.as_ref())
    )]
    Lengths {
        /// One camera and its ticks.
        a: (String, Range<Tick>),
        /// Another camera and its ticks.
        b: (String, Range<Tick>),
        /// The ticks that all recordings have, if any.
        shared: Option<Range<Tick>>,
    },
    /// All sources are live, so the run has no end.
    #[error("every source is live: set the ticks to run with `--ticks`")]
    Endless,
}

/// The remedy for recordings of different lengths.
fn shared_ticks(shared: Option<&Range<Tick>>) -> String {
    match shared.filter(|shared| shared.start < shared.end) {
        Some(Range { start, end }) => {
            format!(
                "if they begin at the same moment, choose common ticks with `--ticks` (at most {start}..{end}); if they end \
                 at the same moment, cut them at their beginning"
            )
        }
        None => "they have no tick in common: check that they are of the same time (keypoint files name the tick of each line)"
            .to_owned(),
    }
}

/// The addition to the message for pictures with exchanged width and height.
fn turned(found_px: [u32; 2], expected_px: [u32; 2]) -> &'static str {
    if found_px[0] != found_px[1] && found_px == [expected_px[1], expected_px[0]] {
        ": they are turned on their side (a phone held upright?); calibrate the lens with the camera in the same orientation"
    } else {
        ""
    }
}

/// The command that gives a recording a constant rate by the times of its frames. Lost frames
/// become repeated ones, and all other frames keep their times.
fn made_constant(period_s: f64) -> String {
    let rate_hz = rounded(period_s.recip(), 6);
    let rate_hz = rate_hz.trim_end_matches('0').trim_end_matches('.');
    format!("`ffmpeg -i IN -fps_mode cfr -r {rate_hz} OUT`")
}

/// `value` with this number of decimals; in exponent form if it is very large.
fn rounded(value: f64, decimals: usize) -> String {
    if value.abs() < 1e9 {
        format!("{value:.decimals$}")
    } else {
        format!("{value:?}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_on_their_side_are_recognised() {
        let message = |found_px| {
            let at = SourceOrigin {
                camera: "a".to_owned(),
                place: "a.mp4".to_owned(),
            };
            let expected_px = [1920, 1080];
            SourceError::PixelSize {
                at,
                found_px,
                expected_px,
            }
            .to_string()
        };
        assert!(message([1080, 1920]).contains("turned on their side"));
        assert!(message([1280, 720]).ends_with("of this camera is 1920x1080"));
    }

    #[test]
    fn huge_rates_are_named_in_few_digits() {
        let at = SourceOrigin {
            camera: "a".to_owned(),
            place: "a.mp4".to_owned(),
        };
        let wrong = SourceError::Rate {
            at,
            found_hz: 1e300,
            expected_hz: 60.0,
        };
        assert_eq!(
            wrong.to_string(),
            "a.mp4: camera `a`: has 1e300 frames per second, the venue's `rate_hz` is 60.0"
        );
        assert_eq!(rounded(29.97, 3), "29.970");
    }
}
