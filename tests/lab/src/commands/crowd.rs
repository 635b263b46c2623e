//! `lab crowd`: many people and viewpoints live. This process plays recorded sets over real sessions, and a fusion node must
//! keep up.

use std::fmt::Write as _;
use std::ops::Range;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use anyhow::{Context as _, ensure};
use farfield::output;
use farfield_node::process::{NodeError, say};
use farfield_proto::order_statistics::percentile;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::tick::Tick;
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::points::PointSet;
use farfield_score::score;
use farfield_sim::recorded_venue::{RATE_HZ, RecordedPasses, RecordedVenue, VenueSize};
use serde_json::Value;

use crate::live_venue::{
    LiveVenue, NodeProcess, Played, Player, SeenVenue, VenueWatch, Vitals, write_played_venue,
};

/// Longest time from the last tick to fusion's end.
const GRACE: Duration = Duration::from_mins(1);
/// Delays are counted from this tick on; before it people are being found.
const DELAYS_FROM: Tick = Tick(60);

/// Arguments of `lab crowd`.
#[derive(Debug, clap::Args)]
pub(super) struct CrowdArgs {
    /// Viewpoints of one camera each.
    #[arg(long, value_name = "V", default_value_t = 16)]
    viewpoints: usize,
    /// People.
    #[arg(long, value_name = "P", default_value_t = 22)]
    people: usize,
    /// Length of the recording, at 60 ticks per second.
    #[arg(long, value_name = "S", default_value_t = 20.0)]
    seconds: f64,
    /// Run fusion on this core only (needs `taskset`).
    #[arg(long, value_name = "CORE")]
    core: Option<usize>,
    /// Number of processes that compute without end, on fusion's core if one is given.
    #[arg(long, value_name = "N", default_value_t = 0)]
    busy: usize,
    /// Start of these processes, seconds after fusion.
    #[arg(long, value_name = "S", default_value_t = 0)]
    busy_after: u32,
}

/// Plays the recording and prints how fusion kept up.
///
/// # Errors
/// The venue cannot be recorded, or fusion does not run to the end.
pub(super) fn crowd(args: &CrowdArgs) -> Result<(), NodeError> {
    let report = run(args).map_err(NodeError::Failed)?;
    output::print(&report).map_err(NodeError::Failed)
}

fn run(args: &CrowdArgs) -> anyhow::Result<String> {
    let size = VenueSize {
        viewpoints: args.viewpoints,
        people: args.people,
    };
    let ticks = (args.seconds * RATE_HZ).ceil() as u32;
    say(format_args!(
        "recording {ticks} ticks in memory, which takes a while"
    ));
    let passes = RecordedPasses::AtEveryTick;
    let level = CompressionLevel::DEFAULT;
    let recorded = RecordedVenue::record_with(size, ticks, level, passes, &mut || {})?;
    let folder = tempfile::tempdir()?;
    let venue = write_played_venue(&recorded, folder.path())?;
    let program = std::env::current_exe().context("finding this program's own file")?;
    let mut live = LiveVenue::prepare(&program, &venue, None)?;
    if let Some(core) = args.core {
        live.fusion_on_core(core);
    }
    let out = folder.path().join("run");
    live.start_fusion(&out, &[])?;
    let watch = live.watch()?;
    let player = Player::connect(&recorded, live.venue(), &live.endpoint())?;
    let _busy = BusyProcesses::start(args)?;
    say(format_args!("playing {:.0} s", args.seconds));
    let played = player.play()?;
    // Edges leave after the run, and fusion waits for that.
    let vitals = live.fusion.as_ref().and_then(NodeProcess::vitals);
    drop(player);
    let fusion = live.fusion.as_mut().context("fusion was started")?;
    let ended = fusion.wait(GRACE)?;
    ensure!(
        ended.is_some_and(|status| status.success()),
        "fusion did not end well ({ended:?})\n{}",
        live.output()
    );
    let ran = FinishedRun {
        watch: &watch,
        played,
        vitals,
        ticks: Tick(0)..Tick(i64::from(ticks)),
    };
    ran.report(folder.path(), &out, &live.output())
}

/// A finished run.
struct FinishedRun<'a> {
    watch: &'a VenueWatch,
    played: Played,
    /// Of fusion, at the last tick.
    vitals: Option<Vitals>,
    ticks: Range<Tick>,
}

impl FinishedRun<'_> {
    fn report(&self, venue: &Path, out: &Path, log: &str) -> anyhow::Result<String> {
        let summary = std::fs::read_to_string(out.join("summary.json"))?;
        let summary: Value = serde_json::from_str(&summary)?;
        let poses = read(&out.join("poses.jsonl"), LinesRole::Poses, &self.ticks)?;
        let truth = read(&venue.join("truth.jsonl"), LinesRole::Truth, &self.ticks)?;
        let scores = score(&poses, &truth, TruthExtent::Whole, Some(RATE_HZ));
        let seen = self.watch.seen();
        let seconds = self.played.ticks as f64 / RATE_HZ;
        let cpu_s = self.vitals.map_or(f64::NAN, |v| v.cpu_ms as f64 / 1e3);
        let drops = &summary["drops"];
        let mut text = format!(
            "played {} ticks, the latest {:.1} ms late; fusion stepped {}, {} received\n\
             fusion: {:.2} cores; patches shed: {}, late {}, missing {}, unsent {}\n",
            self.played.ticks,
            self.played.latest_us as f64 / 1e3,
            summary["ticks"]["done"],
            seen.poses,
            cpu_s / seconds,
            drops["shed"],
            drops["late"],
            drops["missing"],
            drops["unsent"],
        );
        // A growing delay shows in the last quarter.
        let last_quarter = Tick(self.ticks.end.0 * 3 / 4);
        for (name, from) in [("all", DELAYS_FROM), ("last quarter", last_quarter)] {
            let delays_us = seen.delays_us(RATE_HZ, from);
            let ms = |share| percentile(&delays_us, share).map_or(f64::NAN, |us| us as f64 / 1e3);
            writeln!(
                text,
                "capture to pose, {name}: P50 {:.1}, P99 {:.1}, max {:.1} ms",
                ms(0.5),
                ms(0.99),
                ms(1.0)
            )?;
        }
        let per_second = (self.ticks.start.0..self.ticks.end.0).step_by(RATE_HZ as usize);
        let worst = per_second.map(|from| worst_ms(&seen, Tick(from)));
        let worst: Vec<String> = worst.map(|ms| format!("{ms:.0}")).collect();
        writeln!(text, "worst of each second: {} ms", worst.join(" "))?;
        writeln!(
            text,
            "id switches {}, false initiations {}, mean error {:.1} mm, {:.2} % of the poses with all people",
            scores.identity.switches,
            scores.identity.false_births,
            scores.mean.mpjpe_mm.unwrap_or(f64::NAN),
            100.0 * seen.share_with_all_tracked(),
        )?;
        for line in log.lines().filter(|line| !line.starts_with("---")) {
            writeln!(text, "  fusion: {line}")?;
        }
        Ok(text)
    }
}

/// Longest delay of the second from tick `from` on, milliseconds; NaN without a pose.
fn worst_ms(seen: &SeenVenue, from: Tick) -> f64 {
    let until = from + RATE_HZ as i64;
    let arrivals = seen.arrivals.iter();
    let own = arrivals.filter(|arrival| (from..until).contains(&arrival.tick));
    let own = SeenVenue {
        arrivals: own.copied().collect(),
        statuses: seen.statuses.clone(),
        ..SeenVenue::default()
    };
    let last = own.delays_us(RATE_HZ, from).last().copied();
    last.map_or(f64::NAN, |us| us as f64 / 1e3)
}

fn read(path: &Path, role: LinesRole, ticks: &Range<Tick>) -> anyhow::Result<PoseLines> {
    let file = std::fs::File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let reader = std::io::BufReader::new(file);
    let points = PointSet::Joints;
    Ok(PoseLines::read(reader, path, role, points, Some(ticks))?)
}

/// Processes that compute until they are dropped.
struct BusyProcesses(Vec<Child>);

impl BusyProcesses {
    fn start(args: &CrowdArgs) -> anyhow::Result<Self> {
        let mut all = Self(Vec::new());
        let script = format!("sleep {}; while :; do :; done", args.busy_after);
        for _ in 0..args.busy {
            let mut command = match args.core {
                Some(core) => {
                    let mut command = Command::new("taskset");
                    command.args(["-c", &core.to_string(), "sh"]);
                    command
                }
                None => Command::new("sh"),
            };
            command.args(["-c", &script]).stdin(Stdio::null());
            all.0
                .push(command.spawn().context("starting a busy process")?);
        }
        Ok(all)
    }
}

impl Drop for BusyProcesses {
    fn drop(&mut self) {
        for child in &mut self.0 {
            // The process may have ended already.
            drop(child.kill());
            drop(child.wait());
        }
    }
}
