//! `lab links`: accuracy of a venue over links that are far, thin and lossy.
//!
//! The maps of a scene are made first. Then, for each line of the table, all nodes run live as processes of this machine.
//! Each edge runs in a network namespace of its own behind our relay of datagrams. The poses of fusion are scored against the
//! truth. The relays count the traffic, with the headers of IP and UDP.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;
use std::{fmt, thread};

use anyhow::{Context as _, bail, ensure};
use farfield::output;
use farfield_node::process::{NodeError, say};
use farfield_proto::order_statistics::percentile;
use farfield_proto::tick::Tick;
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::points::PointSet;
use farfield_score::score;
use serde::Serialize;

use super::scenes::{MadeMaps, make_maps};
use crate::live_venue::{LiveVenue, NodeProcess, SeenVenue, VenueWatch};
use crate::namespaces::Namespaces;
use crate::relay::{Direction, Impairment, UdpRelay};

/// Longest time of a run beyond the scene itself: start, and completion of what is in flight.
const GRACE: Duration = Duration::from_mins(1);
/// Interval of checks whether a run has come far enough for its links to get worse.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Jitter as a share of the delay.
const JITTER_SHARE: f64 = 0.05;

/// Arguments of `lab links`.
#[derive(Debug, clap::Args)]
pub(crate) struct LinksArgs {
    /// The scene file. Default: the embedded scene of eight players.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Use only the first seconds of the scene.
    #[arg(long, value_name = "S", default_value_t = 20)]
    seconds: u32,
    /// Do not score the first seconds, in which people are found and links measured.
    #[arg(long, value_name = "S", default_value_t = 5)]
    settle: u32,
    /// Keep links perfect for the first seconds, so that people are found before links get worse.
    #[arg(long, value_name = "S", default_value_t = 0)]
    good_start: u32,
    /// Round trips to try, milliseconds.
    #[arg(long, value_name = "MS,...", value_delimiter = ',', default_values_t = [0, 20, 80, 200])]
    round_trip: Vec<u32>,
    /// Shares of datagrams lost each way, percent.
    #[arg(long, value_name = "PERCENT,...", value_delimiter = ',', default_values_t = [0.0, 1.0, 5.0])]
    loss: Vec<f64>,
    /// Rate of each edge's link each way, kbit/s with all headers.
    #[arg(long, value_name = "KBIT", default_value_t = 1000)]
    rate: u32,
    /// Queue before such a link, kilobytes.
    #[arg(long, value_name = "KB", default_value_t = 64)]
    queue: u32,
    /// Byte budget in the venue file, bytes per second; 0: none.
    #[arg(long, value_name = "BYTES", default_value_t = 0)]
    budget: u32,
    /// Use one link for all edges together, as behind one radio bridge.
    #[arg(long)]
    shared: bool,
    /// Omit the line of the ideal link.
    #[arg(long)]
    no_ideal: bool,
    /// Keep the results of the runs in this folder, which must be empty or missing.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    json: bool,
}

/// Runs the study and prints its table.
///
/// # Errors
/// The scene or the folder is refused, a run fails, or the table cannot be printed.
pub(crate) fn links(args: &LinksArgs) -> Result<(), NodeError> {
    check_arguments(args).map_err(NodeError::Refused)?;
    let scratch = tempfile::tempdir().map_err(NodeError::failed)?;
    let folder = args.out.as_deref().unwrap_or(scratch.path());
    farfield_fusion_node::check_folder(folder).map_err(NodeError::Refused)?;
    let mut report = LinkReport::new(args.seconds, args.settle);
    report.rows = rows(args, folder).map_err(NodeError::Failed)?;
    let text = if args.json {
        serde_json::to_string_pretty(&report).map_err(NodeError::failed)? + "\n"
    } else {
        report.to_string()
    };
    output::print(&text).map_err(NodeError::Failed)
}

/// Four edges and eight people behind one link of 1 Mbit/s, with the run in `folder`; for `lab faults`.
///
/// # Errors
/// The maps cannot be made, or the run fails.
pub(super) fn one_bottleneck(folder: &Path) -> anyhow::Result<LinkRow> {
    let args = LinksArgs {
        scene: None,
        seconds: 20,
        settle: 5,
        good_start: 0,
        round_trip: vec![20],
        loss: vec![0.0],
        rate: 1000,
        queue: 64,
        budget: 0,
        shared: true,
        no_ideal: true,
        out: None,
        json: false,
    };
    rows(&args, folder)?.pop().context("one link was requested")
}

/// Runs the venue once per link of `args`.
fn rows(args: &LinksArgs, folder: &Path) -> anyhow::Result<Vec<LinkRow>> {
    let study = LinkStudy::prepare(args, folder)?;
    let row = |link: LinkKind| {
        let row = study.run(&link)?;
        say(format_args!("{row}"));
        Ok(row)
    };
    links_of(args).into_iter().map(row).collect()
}

fn check_arguments(args: &LinksArgs) -> anyhow::Result<()> {
    ensure!(
        args.settle < args.seconds,
        "`--settle {}` leaves nothing of `--seconds {}`",
        args.settle,
        args.seconds
    );
    let wrong = args.loss.iter().find(|loss| !(0.0..=100.0).contains(*loss));
    if let Some(wrong) = wrong {
        bail!("`--loss`: found {wrong}, expected 0 to 100 percent");
    }
    ensure!(args.rate > 0, "`--rate`: found 0, expected kbit/s");
    Ok(())
}

/// The link of one line of the table.
struct LinkKind {
    name: String,
    up: Impairment,
    down: Impairment,
}

fn links_of(args: &LinksArgs) -> Vec<LinkKind> {
    let mut links = Vec::new();
    if !args.no_ideal {
        links.push(LinkKind {
            name: "ideal".to_owned(),
            up: Impairment::default(),
            down: Impairment::default(),
        });
    }
    for &round_trip_ms in &args.round_trip {
        for &loss in &args.loss {
            let one_way_us = round_trip_ms * 500;
            let one_way = Impairment {
                rate_bytes_s: Some(args.rate * 125),
                queue_bytes: args.queue * 1000,
                delay_us: one_way_us,
                jitter_us: (f64::from(one_way_us) * JITTER_SHARE) as u32,
                loss: loss / 100.0,
                ..Impairment::default()
            };
            links.push(LinkKind {
                name: format!("{round_trip_ms} ms, {loss} %"),
                up: one_way,
                down: one_way,
            });
        }
    }
    links
}

/// A venue with its maps and the truth of its runs.
struct LinkStudy<'a> {
    args: &'a LinksArgs,
    folder: &'a Path,
    maps: MadeMaps,
    n_viewpoints: usize,
    rate_hz: f64,
    ticks: Range<Tick>,
    scored: Range<Tick>,
    truth: PoseLines,
}

impl<'a> LinkStudy<'a> {
    fn prepare(args: &'a LinksArgs, folder: &'a Path) -> anyhow::Result<Self> {
        let budget = match args.budget {
            0 => String::new(),
            bytes => format!("[link]\nbudget_bytes_per_s = {bytes}.0\n"),
        };
        let maps = make_maps(args.scene.as_deref(), folder, &[], &budget)?;
        let venue = farfield_node::files::load_venue(&maps.venue)?;
        let tick = |seconds: u32| Tick((f64::from(seconds) * venue.rate_hz) as i64);
        let (ticks, scored) = (
            Tick(0)..tick(args.seconds),
            tick(args.settle)..tick(args.seconds),
        );
        let truth = read(&maps.truth, LinesRole::Truth, &scored)?;
        Ok(Self {
            args,
            folder,
            n_viewpoints: venue.viewpoints.len(),
            rate_hz: venue.rate_hz,
            maps,
            ticks,
            scored,
            truth,
        })
    }

    fn tick_after(&self, seconds: u32) -> Tick {
        Tick((f64::from(seconds) * self.rate_hz) as i64)
    }

    /// Runs the venue once over `link`.
    fn run(&self, link: &LinkKind) -> anyhow::Result<LinkRow> {
        let namespaces = Namespaces::make(self.n_viewpoints);
        if let Err(reason) = &namespaces {
            say(format_args!(
                "without network namespaces, edges reach their relays over the loopback: {reason}"
            ));
        }
        let mut live = LiveVenue::prepare(&self.maps.program, &self.maps.venue, namespaces.ok())?;
        if self.args.shared {
            live.share_one_link().context("starting the relay")?;
        }
        if self.args.good_start == 0 {
            impair(&live, link);
        }
        let out = self.folder.join(link.name.replace([' ', ',', '%'], ""));
        let ticks = format!("{}..{}", self.ticks.start, self.ticks.end);
        live.start_fusion(&out, &["--ticks", &ticks])?;
        let watch = live.watch()?;
        live.start_edges()?;
        wait_for_tick(&watch, self.tick_after(self.args.good_start));
        impair(&live, link);
        if self.args.shared {
            wait_for_tick(&watch, self.scored.start);
            live.relays.iter().for_each(UdpRelay::restart_counts);
        }
        let patience = Duration::from_secs(u64::from(self.args.seconds)) + GRACE;
        let fusion = live.fusion.as_mut().context("fusion was started")?;
        let ended = fusion.wait(patience)?;
        ensure!(
            ended.is_some_and(|status| status.success()),
            "{}: fusion did not end well ({ended:?})\n{}",
            link.name,
            live.output()
        );
        self.row(link, &out, &live, &watch.seen())
    }

    /// The results of a run over `link` into `out`.
    fn row(
        &self,
        link: &LinkKind,
        out: &Path,
        live: &LiveVenue,
        seen: &SeenVenue,
    ) -> anyhow::Result<LinkRow> {
        let rate_hz = self.rate_hz;
        let delays_us = seen.delays_us(rate_hz, self.scored.start);
        let quality = |edge: &NodeProcess| {
            let live = seen.live(edge.name())?;
            Some((live.quality, live.every_nth_tick))
        };
        let qualities: Vec<(u8, u16)> = live.edges.iter().flatten().filter_map(quality).collect();
        let poses = read(&out.join("poses.jsonl"), LinesRole::Poses, &self.scored)?;
        let scores = score(&poses, &self.truth, TruthExtent::Whole, Some(rate_hz));
        let up: Vec<_> = live
            .relays
            .iter()
            .map(|relay| relay.counts(Direction::Up))
            .collect();
        let settle = if self.args.shared {
            self.args.settle
        } else {
            0
        };
        let counted_s = self.args.seconds - settle;
        Ok(LinkRow {
            link: link.name.clone(),
            mpjpe_mm: scores.mean.mpjpe_mm,
            gaps: scores.actors.values().map(|actor| actor.gaps).sum(),
            frames: scores.actors.values().map(|actor| actor.frames).sum(),
            id_switches: scores.identity.switches,
            delay_p50_ms: percentile(&delays_us, 0.5).map(|us| us as f64 / 1e3),
            delay_p99_ms: percentile(&delays_us, 0.99).map(|us| us as f64 / 1e3),
            quality: qualities.iter().map(|(quality, _)| *quality).max(),
            every_nth_tick: qualities.iter().map(|(_, nth)| *nth).max(),
            peak_bytes_s: up.iter().map(|c| c.offered.peak_bytes_s).max().unwrap_or(0),
            rates_apart: match &live.relays[..] {
                [relay] if self.args.shared => furthest_from_mean(relay),
                _ => None,
            },
            edges: shares(live, seen, counted_s),
            mean_bytes_s: up.iter().map(|c| c.offered.bytes).sum::<u64>()
                / (up.len() as u64 * u64::from(counted_s)).max(1),
            dropped: up.iter().map(|c| c.dropped).sum(),
            longest_wait_ms: up.iter().map(|c| c.longest_wait_us).max().unwrap_or(0) as f64 / 1e3,
            mean_wait_ms: up.iter().map(|c| c.waited_us).sum::<u64>() as f64
                / up.iter().map(|c| c.offered.datagrams).sum::<u64>().max(1) as f64
                / 1e3,
        })
    }
}

/// Waits until poses of `tick` are received, or for a minute.
fn wait_for_tick(watch: &VenueWatch, tick: Tick) {
    let is_there = || {
        let newest = watch.seen().newest.as_ref().map(|set| set.tick);
        newest.is_some_and(|newest| newest >= tick)
    };
    for _ in 0..GRACE.as_millis() / POLL_INTERVAL.as_millis() {
        if is_there() {
            break;
        }
        thread::sleep(POLL_INTERVAL);
    }
}

/// Largest difference of an edge's rate behind a shared link from the mean, as a share of the mean.
fn furthest_from_mean(relay: &UdpRelay) -> Option<f64> {
    let bytes = relay.up_bytes_by_client();
    let mean = bytes.iter().sum::<u64>() as f64 / bytes.len() as f64;
    let apart = bytes.iter().map(|bytes| (*bytes as f64 / mean - 1.0).abs());
    apart.reduce(f64::max)
}

/// Each edge's share of a link over `counted_s` seconds. Empty without namespaces, where the addresses of edges have ports
/// chosen by the machine and so another order.
fn shares(live: &LiveVenue, seen: &SeenVenue, counted_s: u32) -> Vec<EdgeShare> {
    let bytes = match &live.relays[..] {
        [relay] if live.is_in_namespaces() => relay.up_bytes_by_client(),
        _ => return Vec::new(),
    };
    let share = |(bytes, edge): (u64, &NodeProcess)| {
        let live = seen.live(edge.name()).cloned().unwrap_or_default();
        EdgeShare {
            bytes_s: bytes / u64::from(counted_s).max(1),
            quality: live.quality,
            persons_per_tick: live.persons_per_tick,
            every_nth_tick: live.every_nth_tick,
        }
    };
    let edges = live.edges.iter().flatten();
    bytes.into_iter().zip(edges).map(share).collect()
}

fn impair(live: &LiveVenue, link: &LinkKind) {
    for relay in &live.relays {
        relay.set(Direction::Up, link.up);
        relay.set(Direction::Down, link.down);
    }
}

fn read(path: &Path, role: LinesRole, ticks: &Range<Tick>) -> anyhow::Result<PoseLines> {
    let file = std::fs::File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let reader = std::io::BufReader::new(file);
    Ok(PoseLines::read(
        reader,
        path,
        role,
        PointSet::Joints,
        Some(ticks),
    )?)
}

/// All lines of the table.
#[derive(Debug, Serialize)]
pub(super) struct LinkReport {
    /// Length of a run, seconds.
    pub(super) seconds: u32,
    /// Seconds at its start that are not scored.
    pub(super) settle: u32,
    pub(super) rows: Vec<LinkRow>,
}

/// One run.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct LinkRow {
    /// Round trip and loss each way.
    pub(in crate::commands) link: String,
    pub(in crate::commands) mpjpe_mm: Option<f64>,
    /// Persons and ticks without a pose near the truth, and all of them.
    pub(in crate::commands) gaps: u64,
    pub(in crate::commands) frames: u64,
    pub(in crate::commands) id_switches: u64,
    /// From the capture to the arrival of the pose at an observer.
    pub(in crate::commands) delay_p50_ms: Option<f64>,
    pub(in crate::commands) delay_p99_ms: Option<f64>,
    /// The highest compression level of any edge at the end, 0 lossless to 6.
    pub(in crate::commands) quality: Option<u8>,
    /// The slowest edge works on every n-th tick.
    pub(in crate::commands) every_nth_tick: Option<u16>,
    /// Most bytes offered to a link in one second, and the mean.
    pub(in crate::commands) peak_bytes_s: u64,
    pub(in crate::commands) mean_bytes_s: u64,
    /// For a shared link: largest difference of an edge's rate from the mean, as a share of the mean.
    pub(in crate::commands) rates_apart: Option<f64>,
    /// For a shared link: each edge.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(in crate::commands) edges: Vec<EdgeShare>,
    /// Datagrams for which an edge's queue had no room.
    pub(in crate::commands) dropped: u64,
    /// Longest and mean wait in an edge's queue.
    pub(in crate::commands) longest_wait_ms: f64,
    pub(in crate::commands) mean_wait_ms: f64,
}

/// One edge's share of a shared link, and its state at the end.
#[derive(Debug, Serialize)]
pub(in crate::commands) struct EdgeShare {
    /// Bytes that arrived, with headers.
    pub(in crate::commands) bytes_s: u64,
    /// Compression level.
    pub(in crate::commands) quality: u8,
    /// Limit of persons per tick; `None`: all.
    pub(in crate::commands) persons_per_tick: Option<u16>,
    /// It works on every n-th tick.
    pub(in crate::commands) every_nth_tick: u16,
}

impl fmt::Display for EdgeShare {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (kb_s, quality) = (self.bytes_s as f64 / 1e3, self.quality);
        write!(f, "{kb_s:.1} kB/s, quality {quality}")?;
        if let Some(persons) = self.persons_per_tick {
            write!(f, ", {persons} persons a tick")?;
        }
        match self.every_nth_tick {
            0 | 1 => Ok(()),
            nth => write!(f, ", every {nth} ticks"),
        }
    }
}

impl LinkReport {
    pub(super) fn new(seconds: u32, settle: u32) -> Self {
        Self {
            seconds,
            settle,
            rows: Vec::new(),
        }
    }
}

const HEAD: &str = "link           MPJPE    gaps  switches  capture to pose ms  quality  every  kB/s of a link   \
                    queue ms           dropped  edges apart\n                  mm       %            P50      P99         \
                          nth    mean    peak      mean     max                    %";

impl fmt::Display for LinkReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} s a line, the first {} s not scored; bytes as the relays counted them, with headers\n\n{HEAD}",
            self.seconds, self.settle
        )?;
        self.rows.iter().try_for_each(|row| writeln!(f, "{row}"))
    }
}

impl fmt::Display for LinkRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |v| format!("{v:.1}"));
        let whole = |value: Option<u16>| value.map_or("-".to_owned(), |v| v.to_string());
        write!(
            f,
            "{:13} {:>6} {:>7.2} {:>9} {:>8} {:>8} {:>8} {:>6} {:>7.1} {:>7.1} {:>9.1} {:>7.1} {:>9} {:>12}",
            self.link,
            number(self.mpjpe_mm),
            100.0 * self.gaps as f64 / self.frames.max(1) as f64,
            self.id_switches,
            number(self.delay_p50_ms),
            number(self.delay_p99_ms),
            whole(self.quality.map(u16::from)),
            whole(self.every_nth_tick),
            self.mean_bytes_s as f64 / 1e3,
            self.peak_bytes_s as f64 / 1e3,
            self.mean_wait_ms,
            self.longest_wait_ms,
            self.dropped,
            number(self.rates_apart.map(|apart| 100.0 * apart))
        )?;
        let mut edges = self.edges.iter();
        edges.try_for_each(|edge| write!(f, "\n    an edge: {edge}"))
    }
}
