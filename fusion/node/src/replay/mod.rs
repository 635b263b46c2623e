//! `farfield replay`: solves a recording again, unchanged or with other settings.

mod listening;
mod recorded_run;
mod report;
mod venue;

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use farfield_fusion::export::summary::EventCounts;
use farfield_fusion::recording::replay::{PatchOwners, Replay};
use farfield_node::clock;
use farfield_node::log::start_log;
use farfield_node::process::{
    Ending, ErrorFormat, Managed, NodeError, exit_code_with_format, stop_on_signal,
};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use self::listening::ReplayObservers;
pub use self::recorded_run::{RecordedRun, open_recording};
use self::report::Done;
pub use self::venue::{of_values, recorded_venue, with_values};
use super::listeners::{OpenListeners, ReplayedRecording};
use super::output::claim::{FolderClaim, check_folder};
use super::output::export_thread::{ExportThread, missing};
use super::output::summary_file::SummaryFile;
use super::session::messages::RunMode;

/// Arguments of a replay.
#[derive(Debug, Clone, clap::Args)]
pub struct ReplayArgs {
    /// The recording, an MCAP file.
    ///
    /// It is made by `farfield record` or `--record`.
    pub file: PathBuf,
    /// Folder for the results.
    ///
    /// It must be empty or not exist. Default: `farfield-out/VENUE-N`.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Use this venue file, not the recorded one.
    ///
    /// Its viewpoints and cameras must be the same.
    #[arg(long, value_name = "VENUE.toml")]
    pub venue: Option<PathBuf>,
    /// Use this calibration, not the recorded one.
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,
    /// Use another value of a parameter.
    ///
    /// See `farfield parameters`; for example `smoothing.cutoff_hz=3`.
    #[arg(long, value_name = "TABLE.FIELD=VALUE")]
    pub set: Vec<String>,
    /// Use late sets too.
    ///
    /// Uses all sets, also those delivered after an outage, instead of those that fusion used then.
    #[arg(long)]
    pub late: bool,
    /// Smooth: two passes, forward and back.
    ///
    /// Writes these instead of the poses that a live client could have had.
    #[arg(long)]
    pub smooth: bool,
    /// The session of fusion, if there are several.
    ///
    /// Numbered from 1, as they are listed.
    #[arg(long, value_name = "N")]
    pub session: Option<usize>,
    /// Print the summary, or the error, as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Replays a recording to its end, and prints errors on standard error. The observers that `listeners` opens get the poses at the
/// venue's rate.
pub fn main(
    args: &ReplayArgs,
    listeners: Box<dyn OpenListeners>,
    print: fn(&str) -> anyhow::Result<()>,
) -> ExitCode {
    start_log();
    exit_code_with_format(
        replay(args, listeners, print),
        ErrorFormat::as_json_if(args.json),
    )
}

fn replay(
    args: &ReplayArgs,
    listeners: Box<dyn OpenListeners>,
    print: fn(&str) -> anyhow::Result<()>,
) -> Result<Ending, NodeError> {
    listeners.check(None)?;
    if let Some(out) = &args.out {
        check_folder(out).map_err(NodeError::Refused)?;
    }
    let RecordedRun {
        replay,
        venue,
        session,
        names,
        file,
        span,
        ..
    } = RecordedRun::open(args)?;
    let keypoints = replay.keypoints().clone();
    let claim = FolderClaim::take(args.out.as_deref(), &venue.name).map_err(NodeError::Refused)?;
    let (stop, runtime) = watch_signals().map_err(NodeError::Failed)?;
    let replays = ReplayedRecording {
        file: &args.file,
        session,
        keeps_ids: names == PatchOwners::AsRecorded,
        ticks: span,
    };
    let folder = claim.folder();
    let mut observers =
        ReplayObservers::open(&runtime, listeners, &venue, &keypoints, replays, folder)?;
    let exporter = ExportThread::start(claim.folder(), &venue, &keypoints, RunMode::LockStep)
        .map_err(NodeError::Failed)?;
    let mut file_of_summary = SummaryFile::in_folder(claim.folder());
    file_of_summary.reserve().map_err(NodeError::Failed)?;
    let done = Solving {
        replay,
        exporter,
        smooth: args.smooth,
        events: EventCounts::default(),
        observers: &mut observers,
    }
    .run(&stop)
    .map_err(NodeError::Failed)?;
    let summary = done.summary(&venue, span);
    file_of_summary
        .put(summary.clone())
        .map_err(NodeError::Failed)?;
    file_of_summary.finish(None).map_err(NodeError::Failed)?;
    let text = if args.json {
        done.json(&summary, &file).map_err(NodeError::Failed)?
    } else {
        done.words(claim.folder(), args.smooth)
    };
    // With `--json` only one object is printed: on failure it is the error.
    if !args.json || done.exported.missing().is_none() {
        print(&text).map_err(NodeError::Failed)?;
    }
    if done.ending == Ending::Done && done.exported.missing().is_none() {
        observers.stay(&runtime, &stop);
    }
    stop.cancel();
    runtime.shutdown_background();
    match done.exported.missing() {
        Some(poses) => Err(NodeError::Failed(missing(poses))),
        None => Ok(done.ending),
    }
}

/// A replay in progress.
struct Solving<'a> {
    replay: Replay<BufReader<File>>,
    exporter: ExportThread,
    /// Whether the poses of two passes are written.
    smooth: bool,
    events: EventCounts,
    observers: &'a mut ReplayObservers,
}

impl Solving<'_> {
    fn run(mut self, stop: &CancellationToken) -> anyhow::Result<Done> {
        let began = clock::now();
        let mut ending = Ending::Done;
        while !self.exporter.has_failed()
            && let Some(output) = self.replay.step()?
        {
            self.observers.publish_tick(&output, stop);
            let written = if self.smooth {
                output.smoothed
            } else {
                output.finished
            };
            self.exporter.write(written, Vec::new());
            self.events.count(&output.events);
            if stop.is_cancelled() && self.replay.left() > 0 {
                ending = Ending::Interrupted;
                break;
            }
        }
        let last = if self.smooth {
            self.replay.finish_smoothed()
        } else {
            self.replay.finish()
        };
        Ok(Done {
            ending,
            choice: self.replay.choice(),
            tally: self.replay.tally(),
            events: self.events,
            agreement: self.replay.agreement().report(),
            exported: self.exporter.finish(last, Vec::new())?,
            elapsed_s: clock::now()
                .duration_since(began)
                .saturating_sub(self.observers.waited())
                .as_secs_f64(),
        })
    }
}

/// A token that is cancelled when the process is to end.
fn watch_signals() -> anyhow::Result<(CancellationToken, tokio::runtime::Runtime)> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .context("starting the runtime")?;
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    let entered = runtime.enter();
    stop_on_signal(&tasks, &stop, Managed::No).context("listening for signals")?;
    drop(entered);
    Ok((stop, runtime))
}
