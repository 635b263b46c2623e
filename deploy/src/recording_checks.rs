//! Checks that need all recordings of a venue: one frame rate, one start, the order of keypoint lines, video formats.
//!
//! A camera at 59.94 Hz among others at 60 Hz is off by 3.6 seconds after an hour, which no start shows. Frame 0 of all
//! recordings must show the same moment: ten frames of offset in one camera put knees 38 mm off. Containers and lengths
//! are the only hints of it.

use farfield_edge::source::{LeapingFrames, RepeatedFrames, SourceInfo};
use farfield_node::process::say;
use farfield_proto::finding::Advice;
use farfield_proto::venue::{GivenPerson, Source, TickFrom, Venue};

/// Largest relative difference of rates of one clock: 59.94 and 60 differ by 1e-3, two good clocks by 1e-4.
const APART: f64 = 2e-4;
/// A recording whose rate is below this share of the others' rate has too few images, such as 30 among 60.
const SLOWER: f64 = 0.98;

/// People seen for a shorter time may be false detections and are not reported, seconds.
const SURE_AFTER_S: f64 = 0.25;
/// Remedy for a recording shorter than that.
pub(crate) const LONGER: &str =
    "record for longer, or run more ticks; and check that `rate_hz` is the rate of the recordings";

/// Warning that the ticks end before a person can be confirmed. People given by hand are tracked from the first tick
/// on.
pub(crate) fn too_short(n_ticks: i64, rate_hz: f64, given: &[GivenPerson]) -> Option<String> {
    let span_s = n_ticks as f64 / rate_hz;
    let is_short = span_s < SURE_AFTER_S && given.is_empty();
    is_short.then(|| {
        format!(
            "{n_ticks} ticks at {rate_hz} a second are {span_s:.2} s, expected {SURE_AFTER_S} s or more: people may not be found in less time"
        )
    })
}

/// A recording whose rate differs from that of most others.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct OddRate {
    pub(crate) camera: String,
    /// Its frames per second.
    pub(crate) rate_hz: f64,
    /// The rate of the others.
    pub(crate) others_hz: f64,
}

impl OddRate {
    /// Its offset after `frames` ticks, in ticks.
    pub(crate) fn drift_ticks(&self, frames: i64) -> f64 {
        frames as f64 * (self.rate_hz / self.others_hz - 1.0).abs()
    }

    /// The problem and its effect.
    pub(crate) fn problem(&self) -> String {
        let off_s = 3600.0 * (self.rate_hz / self.others_hz - 1.0).abs();
        format!(
            "camera `{}` has {:.3} frames per second among others with {:.3}: its offset is {off_s:.1} s after an hour",
            self.camera, self.rate_hz, self.others_hz
        )
    }

    /// The remedy.
    pub(crate) fn remedy(&self) -> String {
        format!(
            "record all cameras at one rate, or {}",
            to_one_rate(self.rate_hz, self.others_hz)
        )
    }
}

/// Describes how to convert a recording to the rate of the others. A recording with fewer images cannot get more: it
/// would show each image twice, and people would stop at every other tick.
pub(crate) fn to_one_rate(rate_hz: f64, others_hz: f64) -> String {
    if rate_hz < SLOWER * others_hz {
        format!(
            "convert all others to its rate, and change the venue: `ffmpeg -i IN -vf fps={rate_hz:.6} OUT`, `rate_hz = {rate_hz:.6}`"
        )
    } else {
        format!("convert it to the rate of the others: `ffmpeg -i IN -vf fps={others_hz:.6} OUT`")
    }
}

/// A keypoint file whose lines repeat: its people were detected at a lower rate.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HeldKeypoints {
    camera: String,
    repeats: RepeatedFrames,
    /// Lines per second: the venue's rate.
    written_hz: f64,
}

impl HeldKeypoints {
    /// New keypoints per second.
    fn found_hz(&self) -> f64 {
        self.written_hz * (1.0 - self.repeats.repeated_share())
    }

    /// The problem and its effect.
    pub(crate) fn problem(&self) -> String {
        let RepeatedFrames { repeated, frames } = self.repeats;
        format!(
            "camera `{}`: {repeated} of {frames} lines with people ({:.0} %) repeat the keypoints of the line before, to the \
             last digit: were they detected in {:.1} images per second and written at {}? People then stay where they were",
            self.camera,
            100.0 * self.repeats.repeated_share(),
            self.found_hz(),
            self.written_hz
        )
    }

    /// The remedy.
    pub(crate) fn remedy(&self) -> String {
        format!(
            "if all cameras have this, write one line per image and the images' rate (about {:.1}) as `rate_hz`; \
             if only some have it, detect the keypoints of all in images of one rate",
            self.found_hz()
        )
    }
}

/// The keypoint files, of a venue with `rate_hz`, whose lines repeat.
pub(crate) fn held_keypoints(infos: &[(String, SourceInfo)], rate_hz: f64) -> Vec<HeldKeypoints> {
    let held = |(camera, info): &(String, SourceInfo)| {
        Some(HeldKeypoints {
            camera: camera.clone(),
            repeats: info.repeats?,
            written_hz: rate_hz,
        })
    };
    infos.iter().filter_map(held).collect()
}

/// The median rate of the recordings; `None` if none has a rate.
pub(crate) fn usual_rate_hz(infos: &[(String, SourceInfo)]) -> Option<f64> {
    let mut rates: Vec<f64> = infos.iter().filter_map(|(_, info)| info.rate_hz).collect();
    rates.sort_unstable_by(f64::total_cmp);
    rates.get(rates.len() / 2).copied()
}

/// The recordings whose rate differs from that of most others.
pub(crate) fn odd_rates(infos: &[(String, SourceInfo)]) -> Vec<OddRate> {
    let Some(others_hz) = usual_rate_hz(infos) else {
        return Vec::new();
    };
    let odd = |(camera, info): &(String, SourceInfo)| {
        let rate_hz = info.rate_hz?;
        are_apart(rate_hz, others_hz).then(|| OddRate {
            camera: camera.clone(),
            rate_hz,
            others_hz,
        })
    };
    infos.iter().filter_map(odd).collect()
}

/// Whether two rates differ.
pub(crate) fn are_apart(a_hz: f64, b_hz: f64) -> bool {
    (a_hz / b_hz - 1.0).abs() > APART
}

/// Keypoint files with lines at which all people jump.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LeapingKeypoints {
    /// Cameras, with the number of jumps in each.
    cameras: Vec<(String, LeapingFrames)>,
}

impl LeapingKeypoints {
    /// The problem and its effect.
    pub(crate) fn problem(&self) -> String {
        let counts = self.cameras.iter().map(|(camera, found)| {
            let LeapingFrames { leaps, frames } = found;
            format!("camera `{camera}`: at {leaps} of {frames} lines")
        });
        let counts: Vec<String> = counts.collect();
        format!(
            "{} all people suddenly jump to other places: the lines are not in the order of their images (sorted by \
             file names: 1, 10, 100, 2), alternate between two cameras, or show one person at a time, a different one each time. \
             Tracked people jump, too",
            counts.join(", ")
        )
    }

    /// The remedy.
    pub(crate) const REMEDY: &str =
        "write one line per image in the order of their numbers, with all people that it shows";
}

/// All keypoint files whose lines jump; `None` if there are none.
pub(crate) fn leaping_keypoints(infos: &[(String, SourceInfo)]) -> Option<LeapingKeypoints> {
    let leaping = |(camera, info): &(String, SourceInfo)| Some((camera.clone(), info.leaps?));
    let cameras: Vec<_> = infos.iter().filter_map(leaping).collect();
    (!cameras.is_empty()).then_some(LeapingKeypoints { cameras })
}

/// Smaller differences of first times in containers come from codecs and sound, seconds.
const APART_S: f64 = 0.1;

/// The command that cuts the others to a recording that begins `frames` later.
fn cut_others(frames: i64) -> String {
    format!(
        "cut the first {frames} of the others: `ffmpeg -i IN -vf trim=start_frame={frames},setpts=PTS-STARTPTS OUT`"
    )
}

/// The recordings whose ticks are counted from their first frame.
fn counted<'a>(
    venue: &'a Venue,
    infos: &'a [(String, SourceInfo)],
) -> impl Iterator<Item = (&'a str, &'a SourceInfo)> {
    infos.iter().filter_map(move |(name, info)| {
        let mut cameras = venue.cameras.iter();
        let camera = cameras.find(|camera| camera.model.name() == name)?;
        let is_counted = matches!(camera.source, Source::Video { .. } | Source::Images { .. })
            && camera.tick_from != TickFrom::Timecode;
        is_counted.then_some((name.as_str(), info))
    })
}

/// A recording whose container states a later first time than another's.
pub(crate) fn starts_apart(venue: &Venue, infos: &[(String, SourceInfo)]) -> Option<Advice> {
    let starts = counted(venue, infos);
    let mut starts: Vec<(f64, &str)> = starts
        .filter_map(|(name, info)| Some((info.labels.start_s?, name)))
        .collect();
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let ((first_s, first), (last_s, last)) = (*starts.first()?, *starts.last()?);
    let apart_s = last_s - first_s;
    let frames = (apart_s * venue.rate_hz).round() as i64;
    (apart_s > APART_S).then(|| Advice::doubtful(
        format!(
            "by their containers, the recording of camera `{last}` begins {apart_s:.3} s ({frames} frames) after that of `{first}`"
        ),
        format!(
            "if they were not cut to the same moment, {}",
            cut_others(frames)
        ),
    ))
}

/// Recordings with different numbers of frames: frames may be missing at the start of one.
pub(crate) fn lengths_apart(venue: &Venue, infos: &[(String, SourceInfo)]) -> Option<Advice> {
    let lengths = counted(venue, infos);
    let mut lengths: Vec<(i64, &str)> = lengths
        .filter_map(|(name, info)| {
            let ticks = info.ticks.as_ref()?;
            Some((ticks.end - ticks.start, name))
        })
        .collect();
    lengths.sort_unstable();
    let ((fewest, short), (most, long)) = (*lengths.first()?, *lengths.last()?);
    let missing = most - fewest;
    (missing > 0).then(|| Advice::doubtful(
        format!(
            "camera `{short}` has {fewest} frames and camera `{long}` {most}: it is assumed that both begin at the same moment"
        ),
        format!(
            "if the {missing} are missing at the start of `{short}`, {}",
            cut_others(missing)
        ),
    ))
}

/// Notes on how the video `named` is stored. Most videos have none.
pub(crate) fn format_remarks(named: &str, info: &SourceInfo) -> impl Iterator<Item = Advice> {
    let remarks = info.format.remarks(info.rate_hz).into_iter();
    remarks.map(move |it| it.of(named))
}

/// Prints these notes line by line.
pub(crate) fn print_format(named: &str, info: &SourceInfo) {
    for remark in format_remarks(named, info) {
        say(format_args!("{remark}"));
    }
}

/// Display name of a camera.
pub(crate) fn camera_name(name: &str) -> String {
    format!("camera `{name}`")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::Path;

    use farfield_proto::tick::Tick;

    use super::*;

    #[test]
    fn a_recording_with_fewer_images_keeps_its_rate() {
        assert!(to_one_rate(59.94, 60.0).contains("-vf fps=60.000000"));
        assert!(to_one_rate(120.0, 60.0).contains("-vf fps=60.000000"));
        let slower = to_one_rate(30.0, 60.0);
        assert!(
            slower.contains("-vf fps=30.000000") && slower.contains("rate_hz = 30.0"),
            "{slower}"
        );
    }

    fn infos(rates_hz: &[Option<f64>]) -> Vec<(String, SourceInfo)> {
        let info = |(i, rate_hz): (usize, &Option<f64>)| {
            let info = SourceInfo {
                rate_hz: *rate_hz,
                ..SourceInfo::default()
            };
            (format!("c{i}"), info)
        };
        rates_hz.iter().enumerate().map(info).collect()
    }

    #[test]
    fn a_camera_at_59_94_among_60_is_reported_with_its_drift() {
        let infos = infos(&[Some(60.0), None, Some(60_000.0 / 1001.0), Some(60.0)]);
        let odd = odd_rates(&infos);
        assert_eq!(odd.len(), 1);
        assert_eq!(odd[0].camera, "c2");
        assert!(odd[0].problem().contains("3.6 s"));
        assert!((odd[0].drift_ticks(1000) - 0.999).abs() < 1e-3);
    }

    #[test]
    fn keypoints_of_half_the_rate_are_reported_with_it() {
        let mut infos = infos(&[None, None]);
        infos[1].1.repeats = Some(RepeatedFrames {
            repeated: 60,
            frames: 120,
        });
        let held = held_keypoints(&infos, 60.0);
        assert_eq!(held.len(), 1);
        assert!((held[0].found_hz() - 30.0).abs() < 1e-9);
        assert_eq!(held[0].camera, "c1");
        assert!(held[0].problem().contains("60 of 120"));
    }

    #[test]
    fn a_run_too_short_to_confirm_people_is_reported() {
        let warning = too_short(3, 30.0, &[]).unwrap();
        assert!(warning.contains("0.10 s"), "{warning}");
        assert!(too_short(120, 1000.0, &[]).is_some(), "a wrong rate");
        assert_eq!(too_short(15, 60.0, &[]), None);
        let given = GivenPerson {
            tick: Tick(0),
            keypoints_m: BTreeMap::new(),
        };
        assert_eq!(too_short(3, 30.0, &[given]), None);
    }

    #[test]
    fn small_differences_of_rates_are_accepted() {
        assert_eq!(
            odd_rates(&infos(&[Some(60.0), Some(60.005), Some(59.999)])),
            []
        );
        assert_eq!(odd_rates(&infos(&[None, None])), []);
    }

    #[test]
    fn files_whose_lines_jump_are_reported_with_counts() {
        let info = |leaps: Option<LeapingFrames>| SourceInfo {
            leaps,
            ..SourceInfo::default()
        };
        let leaping = |leaps: u64| Some(LeapingFrames { leaps, frames: 119 });
        let all = [
            ("c0".to_owned(), info(leaping(19))),
            ("c1".to_owned(), info(None)),
            ("c2".to_owned(), info(leaping(21))),
        ];
        let cameras = leaping_keypoints(&all).unwrap().cameras;
        let counts = cameras
            .iter()
            .map(|(name, found)| (name.as_str(), found.leaps));
        assert_eq!(counts.collect::<Vec<_>>(), [("c0", 19), ("c2", 21)]);
        assert_eq!(leaping_keypoints(&all[1..2]), None);
    }

    /// Advice on a venue with two videos: first time of the container in seconds, number of frames.
    fn advice(a: (f64, i64), b: (f64, i64)) -> [Option<Advice>; 2] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("venue.sample.toml");
        let mut venue = farfield_node::files::load_venue(&path).unwrap();
        venue.cameras.truncate(2);
        venue.rate_hz = 60.0;
        let mut infos = Vec::new();
        for (camera, (start_s, frames)) in venue.cameras.iter_mut().zip([a, b]) {
            camera.source = Source::Video {
                path: "a.mp4".into(),
            };
            let mut info = SourceInfo {
                ticks: Some(Tick(0)..Tick(frames)),
                ..SourceInfo::default()
            };
            info.labels.start_s = Some(start_s);
            infos.push((camera.model.name().to_owned(), info));
        }
        [starts_apart(&venue, &infos), lengths_apart(&venue, &infos)]
    }

    #[test]
    fn ten_frames_missing_at_the_start_are_reported_with_a_remedy() {
        assert_eq!(advice((0.0, 100), (0.067, 100)), [None, None]);
        let [by_container, by_length] = advice((0.0, 100), (0.166, 90));
        for remark in [by_container, by_length] {
            let remark = remark.unwrap();
            assert!(remark.remedy.contains("trim=start_frame=10,"), "{remark:?}");
        }
    }
}
