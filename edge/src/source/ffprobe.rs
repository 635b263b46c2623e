//! What the container of a recording announces, and how many packets it contains.
//!
//! One call of `ffprobe` reads the container's index and lists all packets without decoding. A cut
//! file decodes without an error, so its packets are compared with the announced number.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Stdio};

use ffmpeg_sidecar::ffprobe::ffprobe_path;
use serde::Deserialize;

use super::ffmpeg::{collect_messages, file_input, has_filter, message_suffix, start_problem};
use super::video_format::{FieldOrder, HdrTransfer, VideoFormat};
use super::{RecordingLabels, SourceError, SourceOrigin};
use crate::picture::ColourMatrix;

const ENTRIES: &str = "packet=pts,flags:\
    stream=width,height,time_base,r_frame_rate,avg_frame_rate,nb_frames,duration,start_time,\
    field_order,pix_fmt,color_space,color_transfer,sample_aspect_ratio:\
    stream_tags=rotate,DURATION,NUMBER_OF_FRAMES,timecode,creation_time:stream_side_data=rotation:\
    format=format_name:format_tags=timecode,creation_time";

/// The first video stream of a recording.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VideoStream {
    /// Packets in the file.
    pub(super) packets: u64,
    /// Decoded frames: packets that an edit list does not discard.
    pub(super) frames: u64,
    /// Announced frames, by number or else by duration, if any.
    pub(super) announced: Option<u64>,
    /// Whether the container announces a number; a duration is exact only at a constant rate.
    pub(super) is_counted: bool,
    /// Width and height after rotation.
    pub(super) size_px: [u32; 2],
    /// Mean frames per second.
    pub(super) rate_hz: Option<f64>,
    /// Presentation times in order, seconds; empty if the container has none or they are too
    /// coarse.
    pub(super) times_s: Vec<f64>,
    /// Frames per second between the first and last presentation times, also if these are coarse.
    pub(super) shown_hz: Option<f64>,
    /// Metadata of the container.
    pub(super) labels: RecordingLabels,
    /// Storage format of the pictures.
    pub(super) format: VideoFormat,
    /// Messages of `ffprobe`, with a leading separator.
    pub(super) tool_output: String,
}

/// Reads the whole container of `path`, without decoding.
pub(super) fn read_stream(path: &Path, at: &SourceOrigin) -> Result<VideoStream, SourceError> {
    let mut child = Command::new(ffprobe_path())
        .args([
            "-hide_banner",
            "-v",
            "error",
            "-select_streams",
            "v:0",
            "-show_entries",
            ENTRIES,
        ])
        .args(["-of", "json"])
        .args(file_input(path))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|problem| start_problem(at, "ffprobe", &problem))?;
    let messages = child.stderr.take().map(collect_messages);
    // A truncated answer means that ffprobe failed; its messages give the reason.
    let listing: Result<Listing, _> = match child.stdout.take() {
        Some(stdout) => serde_json::from_reader(BufReader::new(stdout)),
        None => Ok(Listing::default()),
    };
    let success = child.wait().is_ok_and(|status| status.success());
    let messages = messages
        .and_then(|thread| thread.join().ok())
        .unwrap_or_default();
    if !success {
        // ffprobe repeats the URL that it was given.
        let problem = messages.rsplit(": ").next().unwrap_or_default();
        let problem = if problem.is_empty() {
            "ffprobe failed"
        } else {
            problem
        };
        let detail = messages
            .split("] ")
            .nth(1)
            .and_then(|rest| rest.split(';').next());
        let detail = detail.map(|d| format!(" ({d})")).unwrap_or_default();
        // MP4 and MOV write their index at the end of a recording.
        let cause = if messages.contains("moov atom not found") {
            ": it has no index: its recording was interrupted, or it is no video"
        } else {
            ""
        };
        return Err(SourceError::Unreadable {
            at: at.clone(),
            problem: format!("{problem}{detail}{cause}"),
        });
    }
    let unreadable = |problem: String| SourceError::Unreadable {
        at: at.clone(),
        problem,
    };
    listing
        .map_err(|problem| unreadable(format!("ffprobe's answer is invalid: {problem}")))?
        .into_stream(message_suffix("ffprobe", &messages))
        .ok_or_else(|| unreadable("it has no video stream".to_owned()))
}

/// The JSON of `ffprobe`; unknown values are absent.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Listing {
    packets: Vec<Packet>,
    streams: Vec<Stream>,
    format: Format,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Packet {
    /// In the stream's time base. One frame without a time makes all times unusable.
    pts: Option<i64>,
    flags: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Stream {
    width: u32,
    height: u32,
    time_base: String,
    r_frame_rate: String,
    avg_frame_rate: String,
    nb_frames: String,
    duration: String,
    start_time: String,
    field_order: String,
    color_transfer: String,
    color_space: String,
    pix_fmt: String,
    sample_aspect_ratio: String,
    tags: BTreeMap<String, String>,
    side_data_list: Vec<SideData>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct SideData {
    /// From the display matrix, degrees.
    rotation: Option<f64>,
}

/// Of the container, for values that the stream lacks.
#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Format {
    format_name: String,
    tags: BTreeMap<String, String>,
}

impl Listing {
    fn into_stream(self, tool_output: String) -> Option<VideoStream> {
        let stream = self.streams.into_iter().next()?;
        let size_px = [stream.width, stream.height];
        if size_px.contains(&0) {
            return None;
        }
        let tag = |name: &str| stream.tags.get(name).map(String::as_str);
        let number = |text: &str| text.parse::<f64>().ok();
        let count = |text: &str| number(text).filter(|&n| n > 0.0).map(|n| n as u64);
        let of_display = stream.side_data_list.iter().find_map(|data| data.rotation);
        let rotation_deg = of_display.or(tag("rotate").and_then(number)).unwrap_or(0.0);
        let sideways = (rotation_deg / 90.0).round() as i64 % 2 != 0;
        let rate_hz = parse_fraction(&stream.avg_frame_rate);
        let rate_hz = rate_hz.or(parse_fraction(&stream.r_frame_rate));
        let duration_s = number(&stream.duration).or(tag("DURATION").and_then(parse_clock_s));
        let counted = count(&stream.nb_frames).or(tag("NUMBER_OF_FRAMES").and_then(count));
        let announced = counted.or_else(|| frames_in(duration_s?, rate_hz?));
        let label = |name: &str| {
            let of_format = self.format.tags.get(name).map(String::as_str);
            tag(name).or(of_format).map(str::to_owned)
        };
        let labels = RecordingLabels {
            created: label("creation_time"),
            timecode: label("timecode"),
            // Broadcast formats start their clocks at any value.
            start_s: number(&stream.start_time)
                .filter(|_| !self.format.format_name.starts_with("mpeg")),
        };
        let hdr = HdrTransfer::parse(&stream.color_transfer);
        let format = VideoFormat {
            field_order: FieldOrder::parse(&stream.field_order),
            hdr,
            can_tone_map: hdr.is_some() && has_filter("zscale"),
            pixel_aspect: VideoFormat::parse_aspect(&stream.sample_aspect_ratio),
            rotation_deg,
            is_rgb: VideoFormat::parse_rgb(&stream.pix_fmt),
            matrix: ColourMatrix::parse(&stream.color_space),
        };
        // Packets that an edit list discards are no frames.
        let frames = self
            .packets
            .iter()
            .filter(|packet| !packet.flags.contains('D'));
        let unit_s = parse_fraction(&stream.time_base);
        Some(VideoStream {
            labels,
            format,
            packets: self.packets.len() as u64,
            frames: frames.clone().count() as u64,
            announced,
            is_counted: counted.is_some(),
            shown_hz: shown_hz(frames.clone(), unit_s),
            size_px: if sideways {
                [size_px[1], size_px[0]]
            } else {
                size_px
            },
            rate_hz,
            times_s: times_s(frames, unit_s, rate_hz).unwrap_or_default(),
            tool_output,
        })
    }
}

/// Presentation times, rising; `None` if one is unknown, or if the time base `unit_s` is too coarse
/// for the rate.
fn times_s<'a>(
    frames: impl Iterator<Item = &'a Packet>,
    unit_s: Option<f64>,
    rate_hz: Option<f64>,
) -> Option<Vec<f64>> {
    let unit_s = unit_s.filter(|unit_s| rate_hz.is_some_and(|hz| *unit_s <= 0.25 / hz))?;
    let mut pts = frames
        .map(|packet| packet.pts)
        .collect::<Option<Vec<i64>>>()?;
    pts.sort_unstable();
    Some(pts.iter().map(|&pts| pts as f64 * unit_s).collect())
}

/// Frames per second from the first to the last frame; `None` if the times are unusable.
fn shown_hz<'a>(frames: impl Iterator<Item = &'a Packet>, unit_s: Option<f64>) -> Option<f64> {
    let mut pts: Vec<i64> = frames.filter_map(|packet| packet.pts).collect();
    pts.sort_unstable();
    let (first, last) = (pts.first()?, pts.last()?);
    let span_s = (*last as f64 - *first as f64) * unit_s?;
    (span_s > 0.0).then(|| (pts.len() - 1) as f64 / span_s)
}

/// Fewest frames of a container that states only its duration: one less than the rounded product,
/// because a duration can end before or after the last frame.
fn frames_in(duration_s: f64, rate_hz: f64) -> Option<u64> {
    let frames = (duration_s * rate_hz).round() - 1.0;
    (frames > 0.0).then_some(frames as u64)
}

/// Parses `60/1` and similar, above 0.
fn parse_fraction(text: &str) -> Option<f64> {
    let (above, below) = text.split_once('/')?;
    let value = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
}

/// Parses Matroska's `00:00:01.667000000`, in seconds.
fn parse_clock_s(text: &str) -> Option<f64> {
    text.split(':').try_fold(0.0, |sum, part| {
        Some(sum * 60.0 + part.parse::<f64>().ok()?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Option<VideoStream> {
        let listing: Listing = serde_json::from_str(json).unwrap();
        listing.into_stream(String::new())
    }

    /// A stream of 96 x 64 pixels at 30 Hz with the additional fields `more`.
    fn stream(more: &str) -> Option<VideoStream> {
        read(&format!(
            r#"{{"programs": [], "streams": [{{
                "width": 96, "height": 64, "avg_frame_rate": "30/1"{more}
            }}]}}"#
        ))
    }

    #[test]
    fn a_rotated_phone_video_has_its_decoded_size() {
        let size_px = |more: &str| stream(more).unwrap().size_px;
        assert_eq!(size_px(""), [96, 64]);
        let by_matrix = r#", "side_data_list": [{}, {"rotation": -90}]"#;
        assert_eq!(size_px(by_matrix), [64, 96]);
        assert_eq!(size_px(r#", "tags": {"rotate": "270"}"#), [64, 96]);
        assert_eq!(size_px(r#", "tags": {"rotate": "180"}"#), [96, 64]);
    }

    #[test]
    fn packets_that_an_edit_list_discards_are_not_frames() {
        let got = read(
            r#"{
                "packets": [
                    {"pts": -512, "flags": "KD"}, {"pts": 512, "flags": "__"}, {"pts": 0, "flags": "__"}
                ],
                "streams": [{
                    "width": 96, "height": 64, "time_base": "1/15360", "avg_frame_rate": "30/1",
                    "nb_frames": "3"
                }]
            }"#,
        )
        .unwrap();
        assert_eq!((got.packets, got.frames, got.announced), (3, 2, Some(3)));
        assert_eq!(got.times_s, [0.0, 512.0 / 15360.0]);
    }

    #[test]
    fn one_frame_without_a_time_removes_all_times() {
        let got = read(
            r#"{
                "packets": [{"pts": 0, "flags": "K_"}, {"flags": "__"}],
                "streams": [{
                    "width": 96, "height": 64, "time_base": "1/15360", "avg_frame_rate": "30/1"
                }]
            }"#,
        )
        .unwrap();
        assert_eq!((got.frames, got.times_s), (2, Vec::new()));
    }

    #[test]
    fn a_missing_rate_is_computed_from_the_times() {
        // Matroska's form of a variable rate: milliseconds and no mean rate.
        let got = read(
            r#"{
                "packets": [
                    {"pts": 0, "flags": "K_"}, {"pts": 66, "flags": "__"}, {"pts": 33, "flags": "__"}, {"pts": 100}
                ],
                "streams": [{
                    "width": 96, "height": 64, "time_base": "1/1000", "avg_frame_rate": "0/0", "r_frame_rate": "1000/1"
                }]
            }"#,
        )
        .unwrap();
        assert!((got.shown_hz.unwrap() - 30.0).abs() < 1e-9, "{got:?}");
        assert!(got.times_s.is_empty());
        assert_eq!(stream("").unwrap().shown_hz, None);
    }

    #[test]
    fn a_container_without_a_count_announces_its_duration() {
        let matroska = r#", "tags": {"DURATION": "00:01:00.000000000"}"#;
        let got = stream(matroska).unwrap();
        assert_eq!((got.announced, got.is_counted), (Some(1799), false));
        let counted = stream(r#", "nb_frames": "1750""#).unwrap();
        assert_eq!((counted.announced, counted.is_counted), (Some(1750), true));
    }

    #[test]
    fn the_timecode_of_the_stream_has_priority() {
        let timecode = |stream: &str, format: &str| {
            let json = format!(
                r#"{{"streams": [{{"width": 96, "height": 64{stream}}}], "format": {{{format}}}}}"#
            );
            read(&json).unwrap().labels.timecode
        };
        let own = r#", "tags": {"timecode": "00:59:58;02"}"#;
        let of_format = r#""tags": {"timecode": "01:00:00:00"}"#;
        assert_eq!(timecode("", ""), None);
        assert_eq!(timecode("", of_format).as_deref(), Some("01:00:00:00"));
        assert_eq!(timecode(own, of_format).as_deref(), Some("00:59:58;02"));
    }

    #[test]
    fn nonsense_is_not_a_stream() {
        assert_eq!(read("{}"), None);
        assert_eq!(
            read(r#"{"packets": [{}], "streams": [{"height": 64}]}"#),
            None
        );
        assert!(serde_json::from_str::<Listing>(r#"{"streams": ["#).is_err());
        assert_eq!(parse_fraction("0/0"), None);
        assert_eq!(parse_clock_s("1:x"), None);
    }
}
