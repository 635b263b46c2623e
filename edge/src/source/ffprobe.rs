//! What the container of a recording announces, and how many packets it holds.
//!
//! One `ffprobe` call reads the container's index and lists all packets without decoding them. A file
//! that was cut decodes without an error, so its packets are counted against what it announces.

use std::collections::BTreeMap;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

use ffmpeg_sidecar::ffprobe::ffprobe_path;

use super::ffmpeg::{collect_messages, file_input, said, start_problem};
use super::{SourceError, SourceOrigin};

const ENTRIES: &str = "packet=pts,flags:\
    stream=width,height,time_base,r_frame_rate,avg_frame_rate,nb_frames,duration:\
    stream_tags=rotate,DURATION,NUMBER_OF_FRAMES,timecode:stream_side_data=rotation:\
    format_tags=timecode";

/// The first video stream of a recording.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct VideoStream {
    /// Packets in the file.
    pub(super) packets: u64,
    /// Frames that come out of the decoder: packets that an edit list does not discard.
    pub(super) frames: u64,
    /// Frames that the container announces, where it does.
    pub(super) announced: Option<u64>,
    /// Width and height after rotation.
    pub(super) size_px: [u32; 2],
    /// Mean frames per second.
    pub(super) rate_hz: Option<f64>,
    /// Presentation times of the frames in order, seconds; empty where the container has none or they
    /// are too coarse for the rate.
    pub(super) times_s: Vec<f64>,
    /// The SMPTE timecode of the first frame, where the recording has one.
    pub(super) timecode: Option<String>,
    /// What `ffprobe` had to say, as the end of a sentence.
    pub(super) said: String,
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
        .args(["-of", "compact"])
        .args(file_input(path))
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|problem| start_problem(at, "ffprobe", &problem))?;
    let messages = child.stderr.take().map(collect_messages);
    let mut listing = Listing::default();
    if let Some(stdout) = child.stdout.take() {
        // What cannot be read is missing from the listing.
        BufReader::new(stdout)
            .lines()
            .map_while(Result::ok)
            .for_each(|line| listing.add(&line));
    }
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
        return Err(SourceError::Unreadable {
            at: at.clone(),
            problem: format!("{problem}{detail}"),
        });
    }
    listing
        .into_stream(said("ffprobe", &messages))
        .ok_or_else(|| SourceError::Unreadable {
            at: at.clone(),
            problem: "it has no video stream".to_owned(),
        })
}

/// `ffprobe`'s compact output: `packet|pts=0|flags=K_` and `stream|width=96|...`.
#[derive(Debug, Default)]
struct Listing {
    packets: u64,
    frames: u64,
    /// In the stream's time base; a frame without a time makes it unusable.
    pts: Vec<i64>,
    stream: BTreeMap<String, String>,
    /// Of the container, where the stream has none.
    timecode: Option<String>,
}

impl Listing {
    fn add(&mut self, line: &str) {
        let fields = line.split('|').filter_map(|field| field.split_once('='));
        if line.starts_with("packet|") {
            self.packets += 1;
            let fields: Vec<_> = fields.collect();
            let value = |name| {
                fields
                    .iter()
                    .find(|(key, _)| *key == name)
                    .map(|(_, value)| *value)
            };
            if value("flags").is_some_and(|flags| flags.contains('D')) {
                return;
            }
            self.frames += 1;
            self.pts
                .extend(value("pts").and_then(|pts| pts.parse::<i64>().ok()));
        } else if line.starts_with("format|") {
            let mut fields = fields;
            self.timecode = fields
                .find(|(key, _)| *key == "tag:timecode")
                .map(|(_, value)| value.to_owned());
        } else if line.contains("stream|") && self.stream.is_empty() {
            self.stream = fields
                .map(|(key, value)| (key.to_owned(), value.to_owned()))
                .collect();
        }
    }

    fn into_stream(mut self, said: String) -> Option<VideoStream> {
        let number = |name: &str| self.stream.get(name).and_then(|v| v.parse::<f64>().ok());
        let positive = |name: &str| number(name).filter(|&n| n > 0.0);
        let fraction = |name: &str| self.stream.get(name).and_then(|v| parse_fraction(v));
        let (width, height) = (positive("width")? as u32, positive("height")? as u32);
        let rotation_deg = number("rotation").or(number("tag:rotate")).unwrap_or(0.0);
        let sideways = (rotation_deg / 90.0).round() as i64 % 2 != 0;
        let rate_hz = fraction("avg_frame_rate").or(fraction("r_frame_rate"));
        let duration_s = number("duration").or_else(|| {
            self.stream
                .get("tag:DURATION")
                .and_then(|v| parse_clock_s(v))
        });
        let counted = positive("nb_frames")
            .or(positive("tag:NUMBER_OF_FRAMES"))
            .map(|n| n as u64);
        let announced = counted.or_else(|| frames_in(duration_s?, rate_hz?));
        let unit_s = fraction("time_base");
        let coarse = unit_s
            .zip(rate_hz)
            .is_none_or(|(unit_s, hz)| unit_s > 0.25 / hz);
        if coarse || self.pts.len() as u64 != self.frames {
            self.pts.clear();
        }
        self.pts.sort_unstable();
        let unit_s = unit_s.unwrap_or(1.0);
        let timecode = self.stream.remove("tag:timecode").or(self.timecode.take());
        Some(VideoStream {
            timecode,
            packets: self.packets,
            frames: self.frames,
            announced,
            size_px: if sideways {
                [height, width]
            } else {
                [width, height]
            },
            rate_hz,
            times_s: self.pts.iter().map(|&pts| pts as f64 * unit_s).collect(),
            said,
        })
    }
}

/// Frames that a container which states only its duration must hold at least: one less than the
/// rounded product, for durations end before or after the last frame.
fn frames_in(duration_s: f64, rate_hz: f64) -> Option<u64> {
    let frames = (duration_s * rate_hz).round() - 1.0;
    (frames > 0.0).then_some(frames as u64)
}

/// `60/1` and the like, above 0.
fn parse_fraction(text: &str) -> Option<f64> {
    let (above, below) = text.split_once('/')?;
    let value = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
}

/// Matroska's `00:00:01.667000000`, in seconds.
fn parse_clock_s(text: &str) -> Option<f64> {
    text.split(':').try_fold(0.0, |sum, part| {
        Some(sum * 60.0 + part.parse::<f64>().ok()?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(lines: &[&str]) -> Option<VideoStream> {
        let mut listing = Listing::default();
        for line in lines {
            listing.add(line);
        }
        listing.into_stream(String::new())
    }

    #[test]
    fn a_rotated_phone_video_is_as_large_as_it_is_decoded() {
        let line = "stream|width=96|height=64|avg_frame_rate=30/1|nb_frames=20";
        assert_eq!(stream(&[line]).unwrap().size_px, [96, 64]);
        let turned = format!("{line}|side_data|rotation=-90");
        assert_eq!(stream(&[&turned]).unwrap().size_px, [64, 96]);
        let turned = format!("{line}|tag:rotate=270");
        assert_eq!(stream(&[&turned]).unwrap().size_px, [64, 96]);
        let turned = format!("{line}|tag:rotate=180");
        assert_eq!(stream(&[&turned]).unwrap().size_px, [96, 64]);
    }

    #[test]
    fn packets_that_an_edit_list_discards_are_not_frames() {
        let got = stream(&[
            "packet|pts=-512|flags=KD",
            "packet|pts=512|flags=__",
            "packet|pts=0|flags=__",
            "stream|width=96|height=64|time_base=1/15360|avg_frame_rate=30/1|nb_frames=3",
        ])
        .unwrap();
        assert_eq!((got.packets, got.frames, got.announced), (3, 2, Some(3)));
        assert_eq!(got.times_s, [0.0, 512.0 / 15360.0]);
    }

    #[test]
    fn a_container_without_a_count_announces_its_duration() {
        let line = "stream|width=96|height=64|avg_frame_rate=30/1|duration=N/A|nb_frames=N/A|tag:DURATION=00:01:00.000000000";
        assert_eq!(stream(&[line]).unwrap().announced, Some(1799));
    }

    #[test]
    fn the_timecode_of_the_stream_counts_before_that_of_the_container() {
        let line = "stream|width=96|height=64|avg_frame_rate=30/1|nb_frames=20";
        assert_eq!(stream(&[line]).unwrap().timecode, None);
        let of_format = "format|tag:timecode=01:00:00:00";
        let got = stream(&[line, of_format]).unwrap().timecode;
        assert_eq!(got.as_deref(), Some("01:00:00:00"));
        let own = format!("{line}|tag:timecode=00:59:58;02");
        let got = stream(&[&own, of_format]).unwrap().timecode;
        assert_eq!(got.as_deref(), Some("00:59:58;02"));
    }

    #[test]
    fn nonsense_is_not_a_stream() {
        assert_eq!(stream(&[]), None);
        assert_eq!(stream(&["stream|width=N/A|height=", "packet|", "x"]), None);
        assert_eq!(parse_fraction("0/0"), None);
        assert_eq!(parse_clock_s("1:x"), None);
    }
}
