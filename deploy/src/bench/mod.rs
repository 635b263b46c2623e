//! `farfield bench`: how many people and viewpoints fusion can track on this machine, and at which rate.
//!
//! It measures the whole step of fusion's core, with patches and sightings of a tick as input, and poses, boxes and
//! events as output; ticks with detection passes are included. Network, disk and simulator are excluded: a venue is
//! recorded in memory first ([`RecordedVenue`]), and a tick of a recording is read before its time begins.

mod edge;
mod measure;
mod other_work;
mod report;
mod scaling;
mod ticks;

use std::io::{IsTerminal as _, stderr};
use std::path::{Path, PathBuf};
use std::thread;

use anyhow::{Context as _, anyhow};
use farfield_fusion::export::unfinished::write_whole;
use farfield_fusion_node::{RecordedRun, ReplayArgs};
use farfield_node::process::{NodeError, say};
use farfield_proto::patch::CompressionLevel;
use farfield_sim::recorded_venue::{RATE_HZ, RecordedVenue, VenueSize};
use farfield_sim::scene::file::{MAX_CAMERAS, MAX_PEOPLE};
use indicatif::{ProgressBar, ProgressStyle};

use self::edge::{BenchEdgeArgs, bench_edge};
use self::measure::{LEFT_OUT, measure};
use self::report::BenchReport;
use self::ticks::CrowdTicks;
use crate::output;

/// Default sizes: viewpoints, people.
const SIZES: [(usize, usize); 3] = [(4, 5), (4, 8), (12, 22)];
/// Fewest ticks of a recording: one second is measured, so that it contains a detection pass.
const FEWEST_TICKS: usize = LEFT_OUT + RATE_HZ as usize;
/// Most ticks of a recording: all its patches are in memory.
const MOST_TICKS: usize = 3600;
/// Most threads.
const MOST_THREADS: usize = 256;

/// Arguments of `farfield bench`.
#[derive(Debug, Clone, clap::Args)]
#[command(args_conflicts_with_subcommands = true, disable_help_subcommand = true)]
pub(crate) struct BenchArgs {
    #[command(subcommand)]
    of: Option<BenchOf>,
    /// A recording (.mcap) instead of simulated people.
    ///
    /// Written by `--record`; measures the time of its ticks on this machine.
    #[arg(value_name = "RECORDING", conflicts_with_all = ["viewpoints", "people", "ticks", "lossless", "scaling"])]
    recording: Option<PathBuf>,
    /// Viewpoints of one camera each, 2 to 64.
    ///
    /// Default: 4 with 5 people, 4 with 8 and 12 with 22.
    #[arg(long, value_name = "V", requires = "people", value_parser = viewpoints)]
    viewpoints: Option<usize>,
    /// People, 1 to 200.
    #[arg(long, value_name = "P", requires = "viewpoints", value_parser = people)]
    people: Option<usize>,
    /// Number of threads of fusion.
    ///
    /// Default: one, then one per core.
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,
    /// Number of ticks at 60 Hz.
    ///
    /// The first 30 are not measured.
    #[arg(long, value_name = "N", default_value = "180", value_parser = ticks)]
    ticks: usize,
    /// Lossless patches.
    ///
    /// Instead of the initial compression level of a live link.
    #[arg(long)]
    lossless: bool,
    /// Measure many sizes and plot them into this SVG file.
    ///
    /// From 4 x 5 to 28 x 30: time per tick over viewpoints x people.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["viewpoints", "people"])]
    scaling: Option<PathBuf>,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
}

/// Other measurements.
#[derive(Debug, Clone, clap::Subcommand)]
pub(crate) enum BenchOf {
    /// Measure how many people an edge can track: its network, by number of workers.
    #[command(after_help = "Example: farfield bench edge hall.toml")]
    Edge(BenchEdgeArgs),
}

impl BenchArgs {
    pub(crate) fn is_json(&self) -> bool {
        match &self.of {
            Some(BenchOf::Edge(args)) => args.json,
            None => self.json,
        }
    }
}

/// Measures, and prints the results.
///
/// # Errors
/// When a venue cannot be recorded, no thread starts, or the result cannot be printed.
pub(crate) fn bench(args: &BenchArgs) -> Result<(), NodeError> {
    if let Some(BenchOf::Edge(args)) = &args.of {
        return bench_edge(args);
    }
    let report = match &args.recording {
        Some(file) => recording_measured(args, file)?,
        None => crowds_measured(args).map_err(NodeError::Failed)?,
    };
    let text = if args.json {
        serde_json::to_string_pretty(&report).map_err(NodeError::failed)? + "\n"
    } else {
        report.to_string()
    };
    output::print(&text).map_err(NodeError::Failed)?;
    let Some(path) = &args.scaling else {
        return Ok(());
    };
    let drawn = scaling::svg(&report.runs, &report.lines, 1e3 / RATE_HZ);
    write_whole(path, drawn.as_bytes())
        .with_context(|| format!("writing {}", path.display()))
        .map_err(NodeError::Failed)
}

/// Measures the ticks of a recording.
fn recording_measured(args: &BenchArgs, file: &Path) -> Result<BenchReport, NodeError> {
    let replayed = ReplayArgs {
        file: file.to_owned(),
        out: None,
        venue: None,
        calibration: None,
        set: Vec::new(),
        late: false,
        smooth: false,
        session: None,
        json: args.json,
    };
    let mut run = RecordedRun::open(&replayed)?;
    let (viewpoints, rate_hz) = (run.venue().viewpoints.len(), run.venue().rate_hz);
    let cores = cores();
    let mut report = BenchReport::new(rate_hz, cores, None);
    for threads in args.threads(cores) {
        say(format_args!(
            "{}: measuring, threads: {threads}",
            file.display()
        ));
        let measured = measure(&mut run, viewpoints, None, threads).map_err(NodeError::Failed)?;
        let measured = measured.ok_or_else(|| {
            NodeError::Refused(anyhow!(
                "{}: found at most {LEFT_OUT} ticks, expected more: the first {LEFT_OUT} are not measured, as people are not yet \
                 confirmed",
                file.display()
            ))
        })?;
        report.runs.push(measured);
    }
    Ok(report)
}

fn cores() -> usize {
    thread::available_parallelism().map_or(1, std::num::NonZero::get)
}

fn crowds_measured(args: &BenchArgs) -> anyhow::Result<BenchReport> {
    let level = if args.lossless {
        CompressionLevel::LOSSLESS
    } else {
        CompressionLevel::DEFAULT
    };
    let cores = cores();
    let mut report = BenchReport::new(RATE_HZ, cores, Some(level));
    for size in args.sizes() {
        let VenueSize { viewpoints, people } = size;
        say(format_args!(
            "{viewpoints} viewpoints x {people} people: recording {} ticks in memory, which takes a while",
            args.ticks
        ));
        let bar = progress(args.ticks);
        let venue = RecordedVenue::record(size, args.ticks as u32, level, &mut || bar.inc(1));
        bar.finish_and_clear();
        let venue = venue?;
        for threads in args.threads(cores) {
            say(format_args!(
                "{viewpoints} viewpoints x {people} people: measuring, threads: {threads}"
            ));
            let mut ticks = CrowdTicks::new(&venue);
            let measured = measure(&mut ticks, viewpoints, Some(people), threads)?;
            report.runs.extend(measured);
        }
    }
    if args.scaling.is_some() {
        report.lines = scaling::cost_lines(&report.runs);
    }
    Ok(report)
}

impl BenchArgs {
    fn sizes(&self) -> Vec<VenueSize> {
        let requested = self.viewpoints.zip(self.people);
        let sizes = match requested {
            Some(size) => vec![size],
            None if self.scaling.is_some() => scaling::SIZES.to_vec(),
            None => SIZES.to_vec(),
        };
        let size = |(viewpoints, people)| VenueSize { viewpoints, people };
        sizes.into_iter().map(size).collect()
    }

    fn threads(&self, cores: usize) -> Vec<usize> {
        match self.threads {
            Some(threads) => vec![threads],
            None if cores > 1 => vec![1, cores],
            None => vec![1],
        }
    }
}

/// A bar on a terminal, otherwise nothing.
fn progress(ticks: usize) -> ProgressBar {
    if !stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(ticks as u64);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {pos}/{len} ticks {eta}") {
        bar.set_style(style);
    }
    bar
}

fn viewpoints(text: &str) -> Result<usize, String> {
    count(text, [2, MAX_CAMERAS])
        .map_err(|e| format!("{e}: a single viewpoint cannot measure distances"))
}

fn people(text: &str) -> Result<usize, String> {
    count(text, [1, MAX_PEOPLE])
}

fn threads(text: &str) -> Result<usize, String> {
    count(text, [1, MOST_THREADS])
}

fn ticks(text: &str) -> Result<usize, String> {
    count(text, [FEWEST_TICKS, MOST_TICKS])
}

fn count(text: &str, [min, max]: [usize; 2]) -> Result<usize, String> {
    let count = text.parse().ok().filter(|n| (min..=max).contains(n));
    count.ok_or_else(|| format!("expected a whole number from {min} to {max}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(clap::Parser)]
    struct BenchLine {
        #[command(flatten)]
        args: BenchArgs,
    }

    fn parsed(words: &str) -> Result<BenchArgs, clap::Error> {
        let words = ["bench"].into_iter().chain(words.split_whitespace());
        <BenchLine as clap::Parser>::try_parse_from(words).map(|line| line.args)
    }

    #[track_caller]
    fn refused(words: &str, why: &str) {
        let error = parsed(words).unwrap_err();
        assert_eq!(error.exit_code(), 2, "{words}");
        assert!(error.to_string().contains(why), "{words}: {error}");
    }

    #[test]
    fn by_default_three_sizes_are_measured_on_one_and_all_threads() {
        let args = parsed("").unwrap();
        let sizes = args.sizes().into_iter().map(|s| (s.viewpoints, s.people));
        assert_eq!(sizes.collect::<Vec<_>>(), SIZES);
        assert_eq!(args.threads(8), [1, 8]);
        assert_eq!(args.threads(1), [1]);
        let args = parsed("--viewpoints 16 --people 22 --threads 3").unwrap();
        let [size] = args.sizes()[..] else { panic!() };
        assert_eq!((size.viewpoints, size.people), (16, 22));
        assert_eq!(args.threads(8), [3]);
    }

    #[test]
    fn invalid_sizes_are_refused() {
        refused("--viewpoints 4 --people 0", "a whole number from 1 to 200");
        refused("--viewpoints 1 --people 5", "from 2 to 64: a single");
        refused("--viewpoints 65 --people 5", "from 2 to 64");
        refused("--viewpoints four --people 5", "from 2 to 64");
        refused("--viewpoints 4", "--people");
        refused("--people 4", "--viewpoints");
        refused("--threads 0", "from 1 to 256");
        refused("--ticks 89", "from 90 to 3600");
        refused("a.mcap --ticks 90", "cannot be used with");
        refused("a.mcap --viewpoints 4 --people 5", "cannot be used with");
    }

    #[test]
    fn a_small_venue_is_measured_and_its_people_are_tracked() {
        let args = parsed("--viewpoints 3 --people 2 --threads 1 --ticks 90").unwrap();
        let report = crowds_measured(&args).unwrap();
        let [run] = &report.runs[..] else { panic!() };
        assert_eq!(run.tracked, 2);
        assert!(run.ticks >= 300 && run.ticks_with_detection > 0);
        assert!(run.p50_ms > 0.0 && run.p50_ms <= run.p99_ms && run.p99_ms <= run.max_ms);
        assert!(run.rounds >= 5 && run.typical_p99_ms <= run.max_ms);
        let text = report.to_string();
        assert!(text.contains("3 viewpoints x 2 people: "), "{text}");
    }
}
