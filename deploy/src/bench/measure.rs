//! Times the steps of fusion over recorded ticks.

use anyhow::Context as _;
use farfield_fusion::pipeline::Stage;
use farfield_proto::order_statistics::{mean_median, percentile};
use rayon::ThreadPoolBuilder;

use super::report::{BenchRun, StageMedian};
use super::ticks::{BenchTick, BenchTicks, Stopwatch};

/// Ticks at the start of a round that are not measured: people are not yet confirmed.
pub(super) const LEFT_OUT: usize = 30;
/// Minimum number of measured ticks over all rounds: then three are above the 99th percentile.
const AT_LEAST: usize = 300;
/// Minimum number of rounds: a disturbance of a tick in two of them does not affect its median.
const FEWEST_ROUNDS: usize = 5;

/// Times of ticks and their stages.
#[derive(Default)]
struct Times {
    /// By measured tick: the time in each round, milliseconds.
    ticks_ms: Vec<Vec<f64>>,
    /// Microseconds.
    stages_us: [Vec<f64>; Stage::ALL.len()],
    rounds: usize,
    with_detection: usize,
    /// People with a pose at the last tick.
    tracked: usize,
    /// Most people with a pose at a tick.
    most_tracked: usize,
}

/// Times fusion on `threads` threads over `ticks`, with so many `viewpoints` and, if known, `people`. `None` if there
/// are no more ticks than [`LEFT_OUT`].
///
/// # Errors
/// When the threads cannot be started, or a tick cannot be read.
pub(super) fn measure(
    ticks: &mut dyn BenchTicks,
    viewpoints: usize,
    people: Option<usize>,
    threads: usize,
) -> anyhow::Result<Option<BenchRun>> {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.with_context(|| format!("starting {threads} threads"))?;
    let mut times = Times::default();
    pool.install(|| {
        while times.needs_more_rounds() {
            times.round(ticks)?;
        }
        anyhow::Ok(())
    })?;
    if times.ticks_ms.is_empty() {
        return Ok(None);
    }
    let people = people.unwrap_or(times.most_tracked);
    Ok(Some(times.run(viewpoints, people, threads)))
}

impl Times {
    fn needs_more_rounds(&self) -> bool {
        let measured = self.rounds * self.ticks_ms.len();
        self.rounds == 0
            || !self.ticks_ms.is_empty() && (self.rounds < FEWEST_ROUNDS || measured < AT_LEAST)
    }

    /// Steps once through all ticks with a new fusion.
    fn round(&mut self, ticks: &mut dyn BenchTicks) -> anyhow::Result<()> {
        ticks.rewind()?;
        let mut watch = Stopwatch::new();
        let mut index = 0_usize;
        while let Some(tick) = ticks.step(&mut watch)? {
            if let Some(measured) = index.checked_sub(LEFT_OUT) {
                self.note(measured, &tick, &watch);
            }
            index += 1;
        }
        self.rounds += 1;
        Ok(())
    }

    fn note(&mut self, index: usize, tick: &BenchTick, watch: &Stopwatch) {
        for (times_us, lap_us) in self.stages_us.iter_mut().zip(watch.laps_us) {
            times_us.push(lap_us);
        }
        if index == self.ticks_ms.len() {
            self.ticks_ms.push(Vec::new());
        }
        if let Some(of_tick) = self.ticks_ms.get_mut(index) {
            of_tick.push(1e-3 * watch.laps_us.iter().sum::<f64>());
        }
        self.with_detection += usize::from(tick.has_detection);
        self.tracked = tick.tracked;
        self.most_tracked = self.most_tracked.max(tick.tracked);
    }

    fn run(mut self, viewpoints: usize, people: usize, threads: usize) -> BenchRun {
        let mut all_ms: Vec<f64> = self.ticks_ms.iter().flatten().copied().collect();
        all_ms.sort_by(f64::total_cmp);
        let of_ticks = |share| percentile(&all_ms, share).unwrap_or_default();
        let mut typical_ms: Vec<f64> = self.ticks_ms.iter_mut().map(|it| median(it)).collect();
        typical_ms.sort_by(f64::total_cmp);
        BenchRun {
            viewpoints,
            people,
            threads,
            ticks: all_ms.len(),
            rounds: self.rounds,
            ticks_with_detection: self.with_detection,
            p50_ms: of_ticks(0.5),
            p99_ms: of_ticks(0.99),
            typical_p99_ms: percentile(&typical_ms, 0.99).unwrap_or_default(),
            max_ms: of_ticks(1.0),
            agreement_share: self.agreement_share(),
            stages: Stage::ALL
                .iter()
                .zip(&mut self.stages_us)
                .map(|(stage, times_us)| StageMedian {
                    stage: stage.name(),
                    p50_us: median(times_us),
                })
                .collect(),
            tracked: self.tracked,
        }
    }

    /// Share of the time that data for the agreement of the cameras took.
    fn agreement_share(&self) -> f64 {
        let sum_us = |stage: Stage| self.stages_us[stage as usize].iter().sum::<f64>();
        let all_us: f64 = Stage::ALL.iter().map(|&stage| sum_us(stage)).sum();
        let agreement_us = sum_us(Stage::AgreementViews) + sum_us(Stage::AgreementFound);
        agreement_us / all_us.max(f64::MIN_POSITIVE)
    }
}

/// Sorts `times`.
fn median(times: &mut [f64]) -> f64 {
    times.sort_by(f64::total_cmp);
    mean_median(times).unwrap_or_default()
}
