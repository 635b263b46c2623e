//! The steps of fusion over a recorded venue, timed.

use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::pipeline::Stage;
use farfield_node::clock;
use farfield_proto::order_statistics::{mean_median, percentile};
use farfield_sim::recorded_venue::{RecordedVenue, VenueSize};
use rayon::ThreadPoolBuilder;

use super::report::{BenchRun, StageMedian};

/// Ticks at the start of a round that are not measured: people are being found.
pub(super) const LEFT_OUT: usize = 30;
/// Ticks that are measured at least, in as many rounds as that takes: three lie above the 99th percentile.
const AT_LEAST: usize = 300;

/// How long ticks and their stages took, milliseconds and microseconds.
#[derive(Default)]
struct Times {
    ticks_ms: Vec<f64>,
    stages_us: [Vec<f64>; Stage::ALL.len()],
    with_detection: usize,
    tracked: usize,
    /// What all ticks took together, and of that what keeps for whether the cameras agree, microseconds.
    all_us: f64,
    agreement_us: f64,
}

/// Times fusion on `threads` threads over `venue`, which is of `size`.
///
/// # Errors
/// When the threads do not start.
pub(super) fn measure(
    venue: &RecordedVenue,
    size: VenueSize,
    threads: usize,
) -> anyhow::Result<BenchRun> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.with_context(|| format!("starting {threads} threads"))?;
    let measured = venue.groups().len().saturating_sub(LEFT_OUT).max(1);
    let mut times = Times::default();
    pool.install(|| {
        for _ in 0..AT_LEAST.div_ceil(measured) {
            times.round(venue);
        }
    });
    Ok(times.run(size, threads))
}

impl Times {
    /// Steps once through all ticks with a fresh fusion.
    fn round(&mut self, venue: &RecordedVenue) {
        let mut fusion = venue.fusion();
        for (index, group) in venue.groups().iter().enumerate() {
            let is_measured = index >= LEFT_OUT;
            let start = clock::now();
            let mut lap_start = start;
            let output = fusion.step(group, &mut |stage| {
                let now = clock::now();
                if is_measured {
                    let lap_us = 1e6 * seconds(now - lap_start);
                    self.stages_us[stage as usize].push(lap_us);
                    self.all_us += lap_us;
                    if matches!(stage, Stage::AgreementViews | Stage::AgreementFound) {
                        self.agreement_us += lap_us;
                    }
                }
                lap_start = now;
            });
            let tick_ms = 1e3 * seconds(clock::now() - start);
            self.tracked = output.poses.persons.len();
            if is_measured {
                self.ticks_ms.push(tick_ms);
                self.with_detection += usize::from(!group.sighting_sets.is_empty());
            }
        }
    }

    fn run(mut self, size: VenueSize, threads: usize) -> BenchRun {
        self.ticks_ms.sort_by(f64::total_cmp);
        let of_ticks = |share| percentile(&self.ticks_ms, share).unwrap_or_default();
        let stages = Stage::ALL.iter().zip(&mut self.stages_us);
        BenchRun {
            viewpoints: size.viewpoints,
            people: size.people,
            threads,
            ticks: self.ticks_ms.len(),
            ticks_with_detection: self.with_detection,
            p50_ms: of_ticks(0.5),
            p99_ms: of_ticks(0.99),
            max_ms: of_ticks(1.0),
            agreement_share: self.agreement_us / self.all_us.max(f64::MIN_POSITIVE),
            stages: stages
                .map(|(stage, times_us)| {
                    times_us.sort_by(f64::total_cmp);
                    StageMedian {
                        stage: stage.name(),
                        p50_us: mean_median(times_us).unwrap_or_default(),
                    }
                })
                .collect(),
            tracked: self.tracked,
        }
    }
}

fn seconds(span: Duration) -> f64 {
    span.as_secs_f64()
}
