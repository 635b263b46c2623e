//! Whether the recordings of a venue run at one rate: a camera at 59.94 among others at 60 is 3.6 seconds off after an
//! hour, and nothing looks wrong at the start. And whether keypoints are of the rate at which they were written, and in order.

mod line_order;

use farfield_edge::source::{RepeatedFrames, SourceInfo};
use farfield_proto::venue::GivenPerson;

pub(crate) use self::line_order::{LeapingKeypoints, leaping_keypoints};

/// Rates that differ by a greater share are not those of one clock: 59.94 and 60 differ by 1e-3, two good clocks by 1e-4.
const APART: f64 = 2e-4;
/// A recording whose rate is less than this share of the others' has fewer pictures than it would have to: 30 among 60.
const SLOWER: f64 = 0.98;

/// Who is seen for less than this may be a chance, seconds: nobody is told of who was not seen again and again.
const SURE_AFTER_S: f64 = 0.25;
/// What mends a recording that is over before that.
pub(crate) const LONGER: &str =
    "record for longer, or run more ticks; and see whether `rate_hz` is that of the recordings";

/// That so many ticks are over before it is sure that somebody is there. Who is given by hand is followed from the first tick on.
pub(crate) fn too_short(n_ticks: i64, rate_hz: f64, given: &[GivenPerson]) -> Option<String> {
    let span_s = n_ticks as f64 / rate_hz;
    let is_short = span_s < SURE_AFTER_S && given.is_empty();
    is_short.then(|| {
        format!(
            "{n_ticks} ticks at {rate_hz} a second are {span_s:.2} s, expected {SURE_AFTER_S} s or more: nobody may be found in less"
        )
    })
}

/// A recording at another rate than the most.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct OddRate {
    /// Whose it is.
    pub(crate) camera: String,
    /// Its frames per second.
    pub(crate) rate_hz: f64,
    /// Those of the others.
    pub(crate) others_hz: f64,
}

impl OddRate {
    /// By how much it is off after `frames` ticks, in ticks.
    pub(crate) fn drift_ticks(&self, frames: i64) -> f64 {
        frames as f64 * (self.rate_hz / self.others_hz - 1.0).abs()
    }

    /// What is wrong, with what it does.
    pub(crate) fn problem(&self) -> String {
        let off_s = 3600.0 * (self.rate_hz / self.others_hz - 1.0).abs();
        format!(
            "camera `{}` has {:.3} frames per second among others with {:.3}: it is off by {off_s:.1} s after an hour",
            self.camera, self.rate_hz, self.others_hz
        )
    }

    /// What mends it.
    pub(crate) fn remedy(&self) -> String {
        format!(
            "record all cameras at one rate, or {}",
            to_one_rate(self.rate_hz, self.others_hz)
        )
    }
}

/// How a recording comes to the rate of the others, in words. What has fewer pictures cannot get more: it would show each twice,
/// and people who stop at every other tick.
pub(crate) fn to_one_rate(rate_hz: f64, others_hz: f64) -> String {
    if rate_hz < SLOWER * others_hz {
        format!(
            "bring all others to its rate, and the venue: `ffmpeg -i IN -vf fps={rate_hz:.6} OUT`, `rate_hz = {rate_hz:.6}`"
        )
    } else {
        format!("bring it to that of the others: `ffmpeg -i IN -vf fps={others_hz:.6} OUT`")
    }
}

/// A keypoint file of people who were found at a lower rate than it has lines.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct HeldKeypoints {
    /// Whose it is.
    camera: String,
    repeats: RepeatedFrames,
    /// Lines per second: the venue's.
    written_hz: f64,
}

impl HeldKeypoints {
    /// Keypoints per second that are new.
    fn found_hz(&self) -> f64 {
        self.written_hz * (1.0 - self.repeats.repeated_share())
    }

    /// What is wrong, with what it does.
    pub(crate) fn problem(&self) -> String {
        let RepeatedFrames { repeated, frames } = self.repeats;
        format!(
            "camera `{}`: {repeated} of {frames} lines with people ({:.0} %) have the keypoints of the line before, to the \
             last digit: are they of {:.1} pictures per second, written at {}? People are then placed where they were",
            self.camera,
            100.0 * self.repeats.repeated_share(),
            self.found_hz(),
            self.written_hz
        )
    }

    /// What mends it.
    pub(crate) fn remedy(&self) -> String {
        format!(
            "if all cameras are so, write one line per picture and the pictures' rate (about {:.1}) as `rate_hz`; \
             if only some are, find the keypoints of all in pictures of one rate",
            self.found_hz()
        )
    }
}

/// The keypoint files, of a venue with `rate_hz`, whose lines are held.
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

/// The rate that most recordings have; `None` where none says its own.
pub(crate) fn usual_rate_hz(infos: &[(String, SourceInfo)]) -> Option<f64> {
    let mut rates: Vec<f64> = infos.iter().filter_map(|(_, info)| info.rate_hz).collect();
    rates.sort_unstable_by(f64::total_cmp);
    rates.get(rates.len() / 2).copied()
}

/// The recordings whose rate is not that of the most.
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

/// Whether two rates are not one.
pub(crate) fn are_apart(a_hz: f64, b_hz: f64) -> bool {
    (a_hz / b_hz - 1.0).abs() > APART
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use farfield_proto::tick::Tick;

    use super::*;

    #[test]
    fn what_has_fewer_pictures_is_not_brought_to_more() {
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
    fn a_camera_at_59_94_among_60_is_named_with_its_drift() {
        let infos = infos(&[Some(60.0), None, Some(60_000.0 / 1001.0), Some(60.0)]);
        let odd = odd_rates(&infos);
        assert_eq!(odd.len(), 1);
        assert!(
            odd[0].problem().contains("`c2`") && odd[0].problem().contains("3.6 s after an hour")
        );
        assert!((odd[0].drift_ticks(1000) - 0.999).abs() < 1e-3);
    }

    #[test]
    fn keypoints_of_half_the_rate_are_told_with_it() {
        let mut infos = infos(&[None, None]);
        infos[1].1.repeats = Some(RepeatedFrames {
            repeated: 60,
            frames: 120,
        });
        let held = held_keypoints(&infos, 60.0);
        assert_eq!(held.len(), 1);
        let said = held[0].problem();
        for words in [
            "`c1`: 60 of 120",
            "(50 %)",
            "30.0 pictures per second, written at 60",
        ] {
            assert!(said.contains(words), "{words}: {said}");
        }
        assert!(held[0].remedy().contains("about 30.0"));
    }

    #[test]
    fn what_is_over_before_anybody_is_found_is_told() {
        let said = too_short(3, 30.0, &[]).unwrap();
        assert!(said.contains("3 ticks at 30 a second are 0.10 s"), "{said}");
        assert!(too_short(120, 1000.0, &[]).is_some(), "a rate that is none");
        assert_eq!(too_short(15, 60.0, &[]), None);
        let given = GivenPerson {
            tick: Tick(0),
            keypoints_m: BTreeMap::new(),
        };
        assert_eq!(too_short(3, 30.0, &[given]), None);
    }

    #[test]
    fn one_rate_that_wanders_a_little_is_one() {
        assert_eq!(
            odd_rates(&infos(&[Some(60.0), Some(60.005), Some(59.999)])),
            []
        );
        assert_eq!(odd_rates(&infos(&[None, None])), []);
    }
}
