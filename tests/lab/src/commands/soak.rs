//! `lab soak`: a venue that runs live for long must not grow.
//!
//! People walk back and forth in the scene without end. Memory, threads and file handles of every node are sampled from
//! `/proc`; the first fifth of the samples is for buffers to reach their size. Identities are scored by minute. `--faults`
//! adds small faults.

mod people;
mod small_faults;

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::thread;
use std::time::Duration;

use crate::live_venue::{LiveVenue, VenueWatch, Vitals};
use crate::namespaces::Namespaces;
use crate::relay::{Direction, Impairment};
use anyhow::{Context as _, anyhow, ensure};
use farfield_node::process::{NodeError, say};
use farfield_proto::order_statistics::percentile;
use farfield_proto::tick::Tick;

use self::people::SoakedPeople;
use self::small_faults::SmallFaults;
use super::made_maps::{self, MadeMaps};
use farfield::output;
use farfield_node::clock;

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
    farfield_fusion::node::check_folder(folder).map_err(NodeError::Refused)?;
    let maps = made_maps::make(args.scene.as_deref(), folder, &["--there-and-back"], "");
    let maps = maps.map_err(NodeError::Refused)?;
    let (text, grown) = run(args, &maps, folder).map_err(NodeError::Failed)?;
    output::print(&text).map_err(NodeError::Failed)?;
    if grown.is_empty() {
        Ok(())
    } else {
        Err(NodeError::Failed(anyhow!("{}", grown.join("; "))))
    }
}

/// The report, and what has grown.
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
    let samples = sample_vitals(&mut live, (&watch, &mut people), &mut faults, length)?;
    let mut text = headline(args, &live, &watch, length)?;
    let mut grown = people.wrong();
    for (node, samples) in &samples {
        let (line, growth) = judge(node, samples, length);
        text += &line;
        grown.extend(growth);
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
    Ok((text, grown))
}

/// The vitals of every node by name, sampled evenly over `length`.
fn sample_vitals(
    live: &mut LiveVenue,
    (watch, people): (&VenueWatch, &mut SoakedPeople),
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
    let mut grown = Vec::new();
    if memory[1] > memory[0] * (1.0 + MEMORY_SHARE) + MEMORY_SLACK_BYTES {
        grown.push(format!(
            "{node}: memory from {:.1} to {:.1} MB",
            memory[0] / 1e6,
            memory[1] / 1e6
        ));
    }
    for (what, [first, last]) in [("threads", threads), ("file handles", handles)] {
        if last > first + 1.0 {
            grown.push(format!("{node}: {what} from {first:.1} to {last:.1}"));
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
    (line, grown)
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

    fn grown(samples: &[Vitals]) -> Vec<String> {
        judge("north", samples, Duration::from_secs(100)).1
    }

    #[test]
    fn initial_allocations_are_no_growth() {
        let settled = samples(|i| 50_000_000 + 1_000_000 * i.min(20), |_| 12);
        assert_eq!(grown(&settled), [""; 0]);
    }

    #[test]
    fn growing_memory_and_threads_are_reported() {
        let leak = samples(
            |i| 50_000_000 + 200_000 * i,
            |i| 12 + u32::try_from(i).unwrap() / 20,
        );
        let growth = grown(&leak);
        assert_eq!(growth.len(), 2, "{growth:?}");
        assert!(
            growth[0].contains("north: memory") && growth[1].contains("threads"),
            "{growth:?}"
        );
    }
}
