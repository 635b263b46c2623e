//! `lab soak`: a venue that runs live for long must not grow.
//!
//! People walk back and forth in the scene without end. Memory, threads and file handles of every node are sampled from
//! `/proc`; the first fifth of the samples is for buffers to reach their size. Identities are scored by minute. `--faults`
//! adds small faults.

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, anyhow, ensure};
use farfield::output;
use farfield_node::clock;
use farfield_node::process::{NodeError, say};
use farfield_proto::order_statistics::percentile;
use farfield_proto::tick::Tick;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::scenes::{MadeMaps, make_maps};
use crate::live_venue::{LiveVenue, PoseLog, RepeatingTruth, VenueWatch, Vitals};
use crate::namespaces::Namespaces;
use crate::relay::{Direction, Impairment};

/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(50);
/// Samples of a run.
const SAMPLES: u32 = 120;
/// Growth of memory that does not count, bytes: some pages of the allocator.
const MEMORY_SLACK_BYTES: f64 = 4e6;
/// Accepted relative difference of memory.
const MEMORY_SHARE: f64 = 0.05;

/// Least share of poses with all people, else the venue did not run. Far below that of a quiet machine.
const LEAST_WHOLE: f64 = 0.5;

/// Arguments of `lab soak`.
#[derive(Debug, clap::Args)]
pub(crate) struct SoakArgs {
    /// Duration, minutes.
    #[arg(long, value_name = "MIN", default_value_t = 30.0)]
    minutes: f64,
    /// The scene file. Default: the embedded scene of eight players.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Round trip of every link, milliseconds.
    #[arg(long, value_name = "MS", default_value_t = 20)]
    round_trip: u32,
    /// Share of datagrams lost each way, percent.
    #[arg(long, value_name = "PERCENT", default_value_t = 0.1)]
    loss: f64,
    /// Add small faults at random moments with this seed: links are cut or lossy for a moment; edges are killed and started again
    /// with clocks that are wrong and then set right.
    #[arg(long, value_name = "SEED")]
    faults: Option<u64>,
    /// Keep the results in this folder, which must be empty or missing.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the soak and prints the resources of every node, and the delays of the poses.
///
/// # Errors
/// The scene or the folder is refused, a node ends early, people are not tracked, ids are swapped or invented, or something
/// grows.
pub(crate) fn soak(args: &SoakArgs) -> Result<(), NodeError> {
    let scratch = tempfile::tempdir().map_err(NodeError::failed)?;
    let folder = args.out.as_deref().unwrap_or(scratch.path());
    farfield_fusion_node::check_folder(folder).map_err(NodeError::Refused)?;
    let maps = make_maps(args.scene.as_deref(), folder, &["--there-and-back"], "");
    let maps = maps.map_err(NodeError::Refused)?;
    let (text, failures) = run(args, &maps, folder).map_err(NodeError::Failed)?;
    output::print(&text).map_err(NodeError::Failed)?;
    if failures.is_empty() {
        Ok(())
    } else {
        Err(NodeError::Failed(anyhow!("{}", failures.join("; "))))
    }
}

/// The report, and the failures.
fn run(
    args: &SoakArgs,
    maps: &MadeMaps,
    folder: &std::path::Path,
) -> anyhow::Result<(String, Vec<String>)> {
    let n = farfield_node::files::load_venue(&maps.venue)?
        .viewpoints
        .len();
    let mut live = LiveVenue::prepare(&maps.program, &maps.venue, Namespaces::make(n).ok())?;
    let usual = Impairment {
        delay_us: args.round_trip * 500,
        loss: args.loss / 100.0,
        ..Impairment::default()
    };
    for relay in &live.relays {
        relay.set_both(usual);
    }
    live.start_fusion(&folder.join("run"), &[])?;
    let watch = live.watch()?;
    let mut people = SoakedPeople::subscribe(&watch, &maps.truth, live.venue().rate_hz)?;
    live.start_edges()?;
    let length = Duration::from_secs_f64(args.minutes * 60.0);
    let mut faults = args.faults.map(|seed| SmallFaults::new(seed, usual, n));
    let samples = sample_vitals(&mut live, &watch, &mut people, &mut faults, length)?;
    let mut text = headline(args, &live, &watch, length)?;
    let mut failures = people.failures();
    for (node, samples) in &samples {
        let (line, growth) = judge(node, samples, length);
        text += &line;
        failures.extend(growth);
    }
    for (relay, viewpoint) in live.relays.iter().zip(&live.venue().viewpoints) {
        let up = relay.counts(Direction::Up);
        // Writing to a String cannot fail.
        let _infallible = writeln!(
            text,
            "link of {}: {:.1} kB/s, {:.1} in the fullest second",
            viewpoint.name,
            up.offered.bytes as f64 / length.as_secs_f64() / 1e3,
            up.offered.peak_bytes_s as f64 / 1e3
        );
    }
    let _infallible = writeln!(text, "{people}");
    if let Some(faults) = &faults {
        let _infallible = writeln!(text, "{faults}");
    }
    Ok((text, failures))
}

/// The vitals of every node by name, sampled evenly over `length`.
fn sample_vitals(
    live: &mut LiveVenue,
    watch: &VenueWatch,
    people: &mut SoakedPeople,
    faults: &mut Option<SmallFaults>,
    length: Duration,
) -> anyhow::Result<BTreeMap<String, Vec<Vitals>>> {
    let mut samples: BTreeMap<String, Vec<Vitals>> = BTreeMap::new();
    let from = clock::now();
    for sample in 1..=SAMPLES {
        loop {
            let elapsed = clock::now().duration_since(from);
            if elapsed >= length / SAMPLES * sample {
                break;
            }
            if let Some(faults) = faults {
                faults.update(live, elapsed)?;
            }
            people.update(watch);
            thread::sleep(PAUSE);
        }
        for node in live.nodes() {
            let vitals = node.vitals();
            let vitals = vitals.with_context(|| format!("a node has ended\n{}", live.output()))?;
            samples
                .entry(node.name().to_owned())
                .or_default()
                .push(vitals);
        }
        if sample % (SAMPLES / 10) == 0 {
            say(format_args!(
                "{} %: {} poses; {people}",
                100 * sample / SAMPLES,
                watch.seen().poses
            ));
        }
    }
    Ok(samples)
}

/// Number and delays of the poses, and the head of the table of nodes.
fn headline(
    args: &SoakArgs,
    live: &LiveVenue,
    watch: &VenueWatch,
    length: Duration,
) -> anyhow::Result<String> {
    let (poses, delays_us, whole) = {
        let seen = watch.seen();
        let delays_us = seen.delays_us(live.venue().rate_hz, Tick(i64::MIN));
        (seen.poses, delays_us, seen.share_with_all_tracked())
    };
    ensure!(poses > 0, "no pose has come\n{}", live.output());
    ensure!(
        whole >= LEAST_WHOLE,
        "all people are tracked in only {:.1} % of the poses\n{}",
        100.0 * whole,
        live.output()
    );
    Ok(format!(
        "{:.1} min, {poses} poses: {:.2} per second, {:.2} % of them with all people tracked; round trip {} ms, loss {} %\n\
         capture to pose, ms: P50 {}, P99 {}, P99.9 {}, max {}\n\n\
         node             memory MB  first   last   threads  first  last  handles  first  last  cores\n",
        args.minutes,
        poses as f64 / length.as_secs_f64(),
        100.0 * whole,
        args.round_trip,
        args.loss,
        ms(&delays_us, 0.5),
        ms(&delays_us, 0.99),
        ms(&delays_us, 0.999),
        ms(&delays_us, 1.0),
    ))
}

fn ms(sorted_us: &[u64], share: f64) -> String {
    let us = percentile(sorted_us, share);
    us.map_or("-".to_owned(), |us| format!("{:.1}", us as f64 / 1e3))
}

/// A line of the table, and what has grown: the last fifth of the samples against the second.
fn judge(node: &str, samples: &[Vitals], length: Duration) -> (String, Vec<String>) {
    let fifth = (samples.len() / 5).max(1);
    let early = &samples[fifth.min(samples.len() - 1)..(2 * fifth).min(samples.len())];
    let late = &samples[samples.len() - fifth..];
    let mean = |of: &[Vitals], what: fn(&Vitals) -> f64| {
        of.iter().map(what).sum::<f64>() / of.len().max(1) as f64
    };
    let pair = |what: fn(&Vitals) -> f64| [mean(early, what), mean(late, what)];
    let memory = pair(|v| v.memory_bytes as f64);
    let threads = pair(|v| f64::from(v.threads));
    let handles = pair(|v| f64::from(v.handles));
    let mut growth = Vec::new();
    if memory[1] > memory[0] * (1.0 + MEMORY_SHARE) + MEMORY_SLACK_BYTES {
        growth.push(format!(
            "{node}: memory from {:.1} to {:.1} MB",
            memory[0] / 1e6,
            memory[1] / 1e6
        ));
    }
    for (what, [first, last]) in [("threads", threads), ("file handles", handles)] {
        if last > first + 1.0 {
            growth.push(format!("{node}: {what} from {first:.1} to {last:.1}"));
        }
    }
    let cpu_ms = samples.last().map_or(0, |v| v.cpu_ms);
    let line = format!(
        "{node:24} {:>7.1} {:>6.1} {:>15.1} {:>5.1} {:>14.1} {:>5.1} {:>6.2}\n",
        memory[0] / 1e6,
        memory[1] / 1e6,
        threads[0],
        threads[1],
        handles[0],
        handles[1],
        cpu_ms as f64 / 1e3 / length.as_secs_f64()
    );
    (line, growth)
}

/// Duration of a scored part, and its overlap with the part before, since a person may be lost between two parts. Seconds.
const PART_S: f64 = 60.0;
const OVERLAP_S: f64 = 5.0;
/// Time at the start that is not scored, seconds: people are found.
const SETTLE_S: f64 = 10.0;

/// Scores of people so far.
pub(super) struct SoakedPeople {
    log: PoseLog,
    truth: RepeatingTruth,
    rate_hz: f64,
    /// The first tick of the current part; `None` before the first pose.
    from: Option<Tick>,
    parts: u32,
    switches: u64,
    false_people: u64,
    gaps: u64,
    frames: u64,
    /// Mean error of the parts, summed, and of the worst.
    sum_mm: f64,
    worst_mm: f64,
}

impl SoakedPeople {
    /// Subscribes to the poses of `watch`.
    ///
    /// # Errors
    /// Zenoh fails, or the truth cannot be read.
    pub(super) fn subscribe(
        watch: &VenueWatch,
        truth: &Path,
        rate_hz: f64,
    ) -> anyhow::Result<Self> {
        Ok(Self {
            log: PoseLog::subscribe(watch)?,
            truth: RepeatingTruth::read(truth)?,
            rate_hz,
            from: None,
            parts: 0,
            switches: 0,
            false_people: 0,
            gaps: 0,
            frames: 0,
            sum_mm: 0.0,
            worst_mm: 0.0,
        })
    }

    /// Scores the current part once it is complete.
    pub(super) fn update(&mut self, watch: &VenueWatch) {
        let newest = watch.seen().newest.as_ref().map(|set| set.tick);
        let Some(newest) = newest else { return };
        let ticks = |seconds: f64| (seconds * self.rate_hz) as i64;
        let from = *self.from.get_or_insert(newest + ticks(SETTLE_S));
        if newest < from + ticks(PART_S) {
            return;
        }
        let again = if self.parts == 0 { 0 } else { ticks(OVERLAP_S) };
        let scores = self
            .log
            .score(&self.truth, &(from + -again..newest), self.rate_hz);
        self.from = Some(newest);
        self.parts += 1;
        self.switches += scores.identity.switches;
        self.false_people += scores.identity.false_births;
        for actor in scores.actors.values() {
            self.gaps += actor.gaps;
            self.frames += actor.frames;
        }
        let mm = scores.mean.mpjpe_mm.unwrap_or(f64::INFINITY);
        self.sum_mm += mm;
        self.worst_mm = self.worst_mm.max(mm);
    }

    /// Faults that fail the soak.
    pub(super) fn failures(&self) -> Vec<String> {
        let counts = [
            (self.switches, "id switches"),
            (self.false_people, "false people"),
        ];
        let wrong = counts.iter().filter(|(n, _)| *n > 0);
        wrong.map(|(n, what)| format!("{n} {what}")).collect()
    }
}

impl fmt::Display for SoakedPeople {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} minutes scored: {} id switches, {} false people, {:.1} mm from the truth ({:.1} in the worst), {:.3} % gaps",
            self.parts,
            self.switches,
            self.false_people,
            self.sum_mm / f64::from(self.parts.max(1)),
            self.worst_mm,
            100.0 * self.gaps as f64 / self.frames.max(1) as f64
        )
    }
}

/// Time at the start without faults: people are found.
const SETTLE: Duration = Duration::from_secs(15);
/// Time from one fault to the next, seconds.
const EVERY_S: [f64; 2] = [5.0, 15.0];
/// Duration of a cut, duration and loss of a lossy link, and downtime of an edge.
const CUT_S: [f64; 2] = [0.1, 1.5];
const LOSSY_S: [f64; 2] = [1.0, 5.0];
const LOSS: [f64; 2] = [0.02, 0.2];
const AWAY_S: [f64; 2] = [0.2, 2.0];
/// Offset of an edge's clock at its start, within what fusion corrects, and time until it is set right. A clock that is set
/// farther off is refused, which is no small fault.
const OFF_MS: [f64; 2] = [-80.0, 80.0];
const SET_AFTER_S: [f64; 2] = [5.0, 60.0];

/// Causes the faults, and counts them.
pub(super) struct SmallFaults {
    rng: ChaCha8Rng,
    usual: Impairment,
    next: Duration,
    /// End of each link's loss.
    lossy_until: Vec<Option<Duration>>,
    /// End of each edge's downtime.
    away_until: Vec<Option<Duration>>,
    cuts: u32,
    lossy: u32,
    /// Edges that were started again, each with a clock that is off and then set right.
    restarts: u32,
}

enum SmallFault {
    Cut,
    Lossy,
    Restart,
}

impl SmallFaults {
    /// For a venue of `n` viewpoints with `usual` links.
    pub(super) fn new(seed: u64, usual: Impairment, n: usize) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            usual,
            next: SETTLE,
            lossy_until: vec![None; n],
            away_until: vec![None; n],
            cuts: 0,
            lossy: 0,
            restarts: 0,
        }
    }

    /// Causes the faults that are due after `elapsed`.
    ///
    /// # Errors
    /// A node cannot be started or ended.
    pub(super) fn update(&mut self, live: &mut LiveVenue, elapsed: Duration) -> anyhow::Result<()> {
        for i in 0..self.away_until.len() {
            if self.lossy_until[i].is_some_and(|until| until <= elapsed) {
                self.lossy_until[i] = None;
                live.relays[i].set_both(self.usual);
            }
            if self.away_until[i].is_some_and(|until| until <= elapsed) {
                self.away_until[i] = None;
                self.start(live, i)?;
            }
        }
        if elapsed < self.next {
            return Ok(());
        }
        self.next = elapsed + self.span(EVERY_S);
        // The last edge runs as long as the venue, so that growth shows.
        let kind = match self.rng.random_range(0..3u8) {
            0 => SmallFault::Cut,
            1 => SmallFault::Lossy,
            _ => SmallFault::Restart,
        };
        let n = self.away_until.len();
        let most = if matches!(kind, SmallFault::Restart) {
            n.saturating_sub(1).max(1)
        } else {
            n
        };
        let i = self.rng.random_range(0..most);
        self.act(live, &kind, i, elapsed)
    }

    fn act(
        &mut self,
        live: &mut LiveVenue,
        kind: &SmallFault,
        i: usize,
        elapsed: Duration,
    ) -> anyhow::Result<()> {
        match kind {
            SmallFault::Cut => {
                self.cuts += 1;
                live.relays[i].cut(self.span(CUT_S));
            }
            SmallFault::Lossy => {
                self.lossy += 1;
                self.lossy_until[i] = Some(elapsed + self.span(LOSSY_S));
                live.relays[i].set_both(Impairment {
                    loss: self.between(LOSS),
                    ..self.usual
                });
            }
            SmallFault::Restart => {
                if let Some(edge) = live.edges[i].take() {
                    self.restarts += 1;
                    self.away_until[i] = Some(elapsed + self.span(AWAY_S));
                    edge.kill()?;
                }
            }
        }
        Ok(())
    }

    fn start(&mut self, live: &mut LiveVenue, i: usize) -> anyhow::Result<()> {
        let off_ms = self.between(OFF_MS).round();
        let (off, by) = (format!("{off_ms:.0}"), format!("{:.0}", -off_ms));
        let after = format!("{:.0}", self.between(SET_AFTER_S));
        let arguments = [
            ["--clock-shift-ms", &off],
            ["--clock-set-after-s", &after],
            ["--clock-set-by-ms", &by],
        ];
        live.start_edge(i, None, &arguments.concat())?;
        Ok(())
    }

    fn between(&mut self, range: [f64; 2]) -> f64 {
        self.rng.random_range(range[0]..range[1])
    }

    fn span(&mut self, seconds: [f64; 2]) -> Duration {
        Duration::from_secs_f64(self.between(seconds))
    }
}

impl fmt::Display for SmallFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} links cut and {} lossy for a moment, {} edges started again with clocks that were off and then set right",
            self.cuts, self.lossy, self.restarts
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(memory: impl Fn(u64) -> u64, threads: impl Fn(u64) -> u32) -> Vec<Vitals> {
        let vitals = |i| Vitals {
            memory_bytes: memory(i),
            threads: threads(i),
            handles: 20,
            cpu_ms: 1000 * i,
        };
        (0..100).map(vitals).collect()
    }

    fn growth_of_samples(samples: &[Vitals]) -> Vec<String> {
        judge("north", samples, Duration::from_secs(100)).1
    }

    #[test]
    fn initial_allocations_are_no_growth() {
        let settled = samples(|i| 50_000_000 + 1_000_000 * i.min(20), |_| 12);
        assert_eq!(growth_of_samples(&settled), [""; 0]);
    }

    #[test]
    fn growing_memory_and_threads_are_reported() {
        let leak = samples(
            |i| 50_000_000 + 200_000 * i,
            |i| 12 + u32::try_from(i).unwrap() / 20,
        );
        let growth = growth_of_samples(&leak);
        assert_eq!(growth.len(), 2, "{growth:?}");
        assert!(
            growth[0].contains("north: memory") && growth[1].contains("threads"),
            "{growth:?}"
        );
    }
}
