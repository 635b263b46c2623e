//! Latency from capture to pose, by stage, over the last seconds.

use std::collections::VecDeque;

use farfield_proto::order_statistics::percentile;
use farfield_proto::tick::{Micros, SECOND_US, Tick};

use crate::protocol::status::{Latency, LatencyLine};

/// Length of the window, seconds.
const WINDOW_S: u32 = 10;
/// Maximum number of samples per stage: eight viewpoints at 100 Hz for the whole window.
const MAX_SAMPLES: usize = 8192;
/// Longer times come from wrong clocks, microseconds.
const LONGEST_US: Micros = 60 * SECOND_US;

/// A stage on the way from a capture to a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stage {
    /// In the edge.
    CaptureToSend,
    /// From edge to fusion.
    Link,
    /// From the last maps of a tick to its poses.
    Fusion,
    /// Everything.
    CaptureToPose,
}

impl Stage {
    const ALL: [Self; 4] = [
        Self::CaptureToSend,
        Self::Link,
        Self::Fusion,
        Self::CaptureToPose,
    ];

    const fn name(self) -> &'static str {
        match self {
            Self::CaptureToSend => "capture_to_send",
            Self::Link => "link",
            Self::Fusion => "fusion",
            Self::CaptureToPose => "capture_to_pose",
        }
    }
}

/// Samples of the last seconds: time and duration, microseconds.
#[derive(Debug, Clone, Default)]
pub(super) struct LatencyWindow {
    samples: [VecDeque<(Micros, u32)>; Stage::ALL.len()],
}

impl LatencyWindow {
    /// Records that a stage took `took_us` at `at_us`. Small clock differences can make it
    /// negative.
    pub(super) fn note(&mut self, stage: Stage, at_us: Micros, took_us: Micros) {
        if took_us.unsigned_abs() > LONGEST_US.unsigned_abs() {
            return;
        }
        let samples = &mut self.samples[stage as usize];
        if samples.len() >= MAX_SAMPLES {
            samples.pop_front();
        }
        samples.push_back((at_us, took_us.max(0) as u32));
    }

    /// Percentiles of the seconds before `now_us`.
    pub(super) fn lines(&mut self, now_us: Micros) -> Latency {
        let since_us = now_us.saturating_sub(Micros::from(WINDOW_S) * SECOND_US);
        let mut stages = Vec::new();
        for stage in Stage::ALL {
            let samples = &mut self.samples[stage as usize];
            while samples.front().is_some_and(|(at_us, _)| *at_us < since_us) {
                samples.pop_front();
            }
            let mut sorted: Vec<u32> = samples.iter().map(|(_, took_us)| *took_us).collect();
            sorted.sort_unstable();
            if let (Some(p50_us), Some(p99_us)) =
                (percentile(&sorted, 0.5), percentile(&sorted, 0.99))
            {
                stages.push(LatencyLine {
                    stage: stage.name(),
                    samples: sorted.len(),
                    p50_us,
                    p99_us,
                });
            }
        }
        Latency {
            window_s: WINDOW_S,
            stages,
        }
    }
}

/// Time of a tick, microseconds of Unix time, from the time of tick 0 and the venue's rate.
pub(super) fn tick_time_us(epoch_us: u64, tick: Tick, rate_hz: f64) -> Micros {
    // Times of this century are exact to a microsecond in double precision.
    let after_us = (tick.seconds(rate_hz) * SECOND_US as f64).round() as Micros;
    i64::try_from(epoch_us)
        .unwrap_or(i64::MAX)
        .saturating_add(after_us)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_cover_the_last_seconds() {
        let mut window = LatencyWindow::default();
        window.note(Stage::Link, 0, 5_000_000);
        for i in 1..=100 {
            window.note(Stage::Link, 15_000_000, i * 10);
        }
        window.note(Stage::Fusion, 15_000_000, -40);
        window.note(Stage::Fusion, 15_000_000, i64::MIN + 1);
        let lines = window.lines(16_000_000);
        let found: Vec<_> = lines
            .stages
            .iter()
            .map(|s| (s.stage, s.samples, s.p50_us, s.p99_us))
            .collect();
        assert_eq!(found, [("link", 100, 500, 990), ("fusion", 1, 0, 0)]);
    }

    #[test]
    fn tick_times_follow_the_rate_without_overflow() {
        assert_eq!(
            tick_time_us(1_767_225_600_000_000, Tick(90), 60.0),
            1_767_225_601_500_000
        );
        assert_eq!(tick_time_us(u64::MAX, Tick(i64::MAX), 60.0), i64::MAX);
    }
}
