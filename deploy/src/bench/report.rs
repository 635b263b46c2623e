//! The report of `farfield bench`.

use std::fmt;

use farfield_proto::patch::CompressionLevel;
use serde::Serialize;

/// All results.
#[derive(Debug, Serialize)]
pub(super) struct BenchReport {
    /// Rate of the cameras, ticks per second.
    pub(super) rate_hz: f64,
    /// Cores that this process may use.
    pub(super) cores: usize,
    /// The compression level of the patches, unless they come from a recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) compression_level: Option<u8>,
    pub(super) runs: Vec<BenchRun>,
    /// Cost per patch, with `--scaling`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) lines: Vec<CostLine>,
}

/// One venue on a number of threads.
#[derive(Debug, Serialize)]
pub(super) struct BenchRun {
    pub(super) viewpoints: usize,
    pub(super) people: usize,
    pub(super) threads: usize,
    /// Measured ticks, of all rounds.
    pub(super) ticks: usize,
    /// How often the same ticks were processed.
    pub(super) rounds: usize,
    /// Ticks with a detection pass.
    pub(super) ticks_with_detection: usize,
    pub(super) p50_ms: f64,
    pub(super) p99_ms: f64,
    /// 99th percentile of the median time of each tick over all rounds: without disturbances by other programs.
    pub(super) typical_p99_ms: f64,
    pub(super) max_ms: f64,
    /// Share of the time that data for the agreement of the cameras took. Mean, not median: crops are stored only at
    /// some ticks.
    pub(super) agreement_share: f64,
    /// In the order of a step.
    pub(super) stages: Vec<StageMedian>,
    /// People with a pose at the last tick.
    pub(super) tracked: usize,
}

/// The median time of a stage.
#[derive(Debug, Serialize)]
pub(super) struct StageMedian {
    pub(super) stage: &'static str,
    pub(super) p50_us: f64,
}

/// A line of median tick times over patches per tick, on a number of threads.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct CostLine {
    pub(super) threads: usize,
    /// Time per viewpoint and person, microseconds.
    pub(super) us_per_patch: f64,
    /// Time of the size farthest from the line, relative to the line.
    pub(super) farthest: f64,
}

impl BenchReport {
    pub(super) fn new(rate_hz: f64, cores: usize, level: Option<CompressionLevel>) -> Self {
        Self {
            rate_hz,
            cores,
            compression_level: level.map(CompressionLevel::number),
            runs: Vec::new(),
            lines: Vec::new(),
        }
    }

    fn write_stages(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "viewpoints  people  threads")?;
        let names = self.runs.first().map_or(&[][..], |run| &run.stages);
        for StageMedian { stage, .. } in names {
            write!(f, "  {stage:>9}")?;
        }
        writeln!(f, "  median us per tick")?;
        for run in &self.runs {
            run.write_size(f)?;
            for StageMedian { stage, p50_us } in &run.stages {
                write!(f, "  {p50_us:>width$.0}", width = stage.len().max(9))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

impl fmt::Display for BenchReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tick_ms = 1e3 / self.rate_hz;
        for run in &self.runs {
            let threads = if run.threads == 1 {
                "thread"
            } else {
                "threads"
            };
            writeln!(
                f,
                "{} viewpoints x {} people: {:.1} ms per tick at P99 on {} {threads}, or {:.0} Hz; the {tick_ms:.1} ms \
                 between ticks at {:.0} Hz are {:.1} times as long",
                run.viewpoints,
                run.people,
                run.p99_ms,
                run.threads,
                1e3 / run.p99_ms,
                self.rate_hz,
                tick_ms / run.p99_ms
            )?;
        }
        for line in &self.lines {
            writeln!(
                f,
                "threads: {}: {:.1} us per viewpoint and person at the median; the size farthest from this \
                 line takes {:.2} times its value",
                line.threads, line.us_per_patch, line.farthest
            )?;
        }
        writeln!(f)?;
        writeln!(
            f,
            "viewpoints  people  threads   P50 ms   P99 ms  typical   max ms  detection  tracked  agreement"
        )?;
        for run in &self.runs {
            run.write_size(f)?;
            writeln!(
                f,
                "  {:>7.2}  {:>7.2}  {:>7.2}  {:>7.2}  {:>7.1} %  {:>7}  {:>7.2} %",
                run.p50_ms,
                run.p99_ms,
                run.typical_p99_ms,
                run.max_ms,
                100.0 * run.ticks_with_detection as f64 / run.ticks.max(1) as f64,
                run.tracked,
                100.0 * run.agreement_share
            )?;
        }
        let rounds = self.runs.iter().map(|run| run.rounds).min();
        writeln!(
            f,
            "typical: P99 of the median time of each tick over its rounds ({} or more): without disturbances by other \
             programs\n",
            rounds.unwrap_or_default()
        )?;
        self.write_stages(f)?;
        Ok(())
    }
}

impl BenchRun {
    fn write_size(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:>10}  {:>6}  {:>7}",
            self.viewpoints, self.people, self.threads
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report() -> BenchReport {
        let stage = |stage, p50_us| StageMedian { stage, p50_us };
        let run = BenchRun {
            viewpoints: 12,
            people: 22,
            threads: 2,
            ticks: 750,
            rounds: 5,
            ticks_with_detection: 15,
            p50_ms: 6.0,
            p99_ms: 8.125,
            typical_p99_ms: 7.25,
            max_ms: 9.5,
            agreement_share: 0.0123,
            stages: vec![stage("views", 1200.4), stage("peak_assignment", 80.0)],
            tracked: 21,
        };
        let mut report = BenchReport::new(60.0, 4, Some(CompressionLevel::DEFAULT));
        report.runs.push(run);
        report
    }

    #[test]
    fn a_run_has_a_sentence_a_row_of_times_and_a_row_of_stages() {
        assert_eq!(
            report().to_string(),
            "12 viewpoints x 22 people: 8.1 ms per tick at P99 on 2 threads, or 123 Hz; the 16.7 ms between ticks at \
             60 Hz are 2.1 times as long\n\n\
             viewpoints  people  threads   P50 ms   P99 ms  typical   max ms  detection  tracked  agreement\n        \
             12      22        2     6.00     8.12     7.25     9.50      2.0 %       21     1.23 %\n\
             typical: P99 of the median time of each tick over its rounds (5 or more): without disturbances by other \
             programs\n\n\
             viewpoints  people  threads      views  peak_assignment  median us per tick\n        \
             12      22        2       1200               80\n"
        );
    }

    #[test]
    fn json_has_all_numbers() {
        let json = serde_json::to_value(report()).unwrap();
        assert_eq!(json["cores"], 4);
        assert_eq!(json["compression_level"], 2);
        assert_eq!(json["runs"][0]["p99_ms"], 8.125);
        assert_eq!(json["runs"][0]["stages"][1]["stage"], "peak_assignment");
    }
}
