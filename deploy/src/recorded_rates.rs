//! Whether the recordings of a venue run at one rate: a camera at 59.94 among others at 60 is 3.6 seconds off after an
//! hour, and nothing looks wrong at the start.

use farfield_edge::source::SourceInfo;

/// Rates that differ by a greater share are not those of one clock: 59.94 and 60 differ by 1e-3, two good clocks by 1e-4.
const APART: f64 = 2e-4;

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
            "record all cameras at one rate, or bring it to that of the others: `ffmpeg -i IN -vf fps={:.6} OUT`",
            self.others_hz
        )
    }
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
    use super::*;

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
    fn one_rate_that_wanders_a_little_is_one() {
        assert_eq!(
            odd_rates(&infos(&[Some(60.0), Some(60.005), Some(59.999)])),
            []
        );
        assert_eq!(odd_rates(&infos(&[None, None])), []);
    }
}
