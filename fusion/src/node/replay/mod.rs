//! `farfield replay`: solves a recording again, as it was or in another way.

mod listening;
mod report;
mod venue;

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_node::clock;
use farfield_node::log::start_log;
use farfield_node::process::{
    Ending, Managed, NodeError, Told, exit_code_told, say, stop_when_told,
};
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::Venue;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use self::listening::Listening;
use self::report::{Done, FileFacts};
use self::venue::{Changes, replay_venue};
pub use self::venue::{of_values, recorded_venue, with_values};
use super::config::{check_calibration, check_names};
use super::listeners::{OpenListeners, ReplayedRecording};
use super::output::claim::{FolderClaim, check_folder};
use super::output::export_thread::{ExportThread, missing};
use super::output::summary_file::SummaryFile;
use super::recording::{OWN_RECORDING, without_end};
use super::session::mode::RunMode;
use super::subjects::{load_subjects, recorded_subjects};
use crate::export::summary::EventCounts;
use crate::identity::subjects::Subject;
use crate::pipeline::Pipeline;
use crate::recording::reader::{Recording, SessionPart};
use crate::recording::replay::{Choice, PatchOwners, Replay, first_decision};

/// How long after the first boxes of a run nobody is known yet, seconds: edges have not yet looked.
const NOBODY_YET_S: f64 = 0.5;
/// How long nobody can have come, been confirmed and gone again, seconds.
const NOBODY_GONE_S: f64 = 5.0;

/// Arguments of a replay.
#[derive(Debug, Clone, clap::Args)]
pub struct ReplayArgs {
    /// The recording, an MCAP file.
    ///
    /// Of `farfield record`, or of `--record`.
    pub file: PathBuf,
    /// Folder for the results.
    ///
    /// It must be empty or not there. Default: `farfield-out/VENUE-N`.
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
    /// Use what came too late, too.
    ///
    /// All sets, those too that were delivered after an outage, instead of those that fusion used then.
    #[arg(long)]
    pub late: bool,
    /// Smooth: two passes, forward and back.
    ///
    /// Instead of the poses that a live listener could have had.
    #[arg(long)]
    pub smooth: bool,
    /// Which life of fusion, where there are several.
    ///
    /// From 1, as they are listed.
    #[arg(long, value_name = "N")]
    pub session: Option<usize>,
    /// Print the summary, or what went wrong, as JSON.
    #[arg(long)]
    pub json: bool,
}

/// Replays a recording to its end and says on standard error what went wrong. Whom `listeners` opens gets the poses, at
/// the venue's rate.
pub fn main(
    args: &ReplayArgs,
    listeners: Box<dyn OpenListeners>,
    print: fn(&str) -> anyhow::Result<()>,
) -> ExitCode {
    start_log();
    exit_code_told(replay(args, listeners, print), Told::as_json_if(args.json))
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
    let mut recording = open(&args.file).map_err(NodeError::Refused)?;
    let part = choose(args, recording.sessions()).map_err(NodeError::Refused)?;
    let changes = Changes {
        venue: args.venue.as_deref(),
        calibration: args.calibration.as_deref(),
        set: &args.set,
    };
    let (venue, card) = checked_venue(args, &recording, &changes)?;
    let subjects = subjects_of(args, &recording, &venue).map_err(NodeError::refused)?;
    let as_it_was = changes.none() && !args.late && !part.decisions.is_empty();
    let joined = joined(&mut recording, &part, venue.rate_hz).map_err(NodeError::Refused)?;
    let names = owners(&args.file, as_it_was, joined);
    let choice = choice(args, &part);
    let (file, recorded) = (FileFacts::of(&recording), part.ticks);
    let mut pipeline = Pipeline::new(&venue, card.as_ref(), part.session);
    pipeline.know(subjects);
    smooth(args, &venue, &mut pipeline);
    let (keypoints, session) = (pipeline.keypoints().clone(), part.session);
    let replay = Replay::new(recording, part, pipeline, choice, names)
        .with_context(|| args.file.display().to_string())
        .map_err(NodeError::Refused)?;
    let span = replay.span().unwrap_or(recorded);
    let claim = FolderClaim::take(args.out.as_deref(), &venue.name).map_err(NodeError::Refused)?;
    let (stop, runtime) = watch_signals().map_err(NodeError::Failed)?;
    let replays = ReplayedRecording {
        file: &args.file,
        session,
        keeps_ids: names == PatchOwners::AsRecorded,
        ticks: span,
    };
    let of = (&venue, &keypoints, replays);
    let mut listening = Listening::open(&runtime, listeners, of, claim.folder())?;
    let exporter = ExportThread::start(claim.folder(), &venue, &keypoints, RunMode::LockStep)
        .map_err(NodeError::Failed)?;
    let mut file_of_summary = SummaryFile::in_folder(claim.folder());
    file_of_summary.reserve().map_err(NodeError::Failed)?;
    let done = Solving {
        replay,
        exporter,
        smooth: args.smooth,
        events: EventCounts::default(),
        listening: &mut listening,
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
    // As JSON one thing is said: what went wrong.
    if !args.json || done.exported.missing.is_none() {
        print(&text).map_err(NodeError::Failed)?;
    }
    if done.ending == Ending::Done && done.exported.missing.is_none() {
        listening.stay(&runtime, &stop);
    }
    stop.cancel();
    runtime.shutdown_background();
    match &done.exported.missing {
        Some(poses) => Err(NodeError::Failed(missing(poses))),
        None => Ok(done.ending),
    }
}

/// The bodies of whom the venue names: as recorded, or of another venue file where one was given.
fn subjects_of(
    args: &ReplayArgs,
    recording: &Recording<BufReader<File>>,
    venue: &Venue,
) -> Result<Vec<Subject>, FileError> {
    match args.venue {
        Some(_) => load_subjects(venue).map(|known| known.subjects),
        None => recorded_subjects(&args.file, recording.attached(), venue),
    }
}

/// Opens the file of a recording.
///
/// # Errors
/// When it cannot be opened, or is the folder of a run: then the recording in it is named, where there is one.
pub fn open_recording(path: &Path) -> anyhow::Result<File> {
    let shown = path.display();
    if path.is_dir() {
        let inside = path.join(OWN_RECORDING);
        ensure!(
            !inside.is_file(),
            "{shown}: found a folder, expected a recording: the one in it is {}",
            inside.display()
        );
        bail!(
            "{shown}: found a folder without a recording in it, expected a recording (.mcap): `farfield run --record` writes one"
        );
    }
    File::open(path).with_context(|| format!("opening the recording {shown}"))
}

/// The venue that is solved for, and the card of its network if it has one.
fn checked_venue(
    args: &ReplayArgs,
    recording: &Recording<BufReader<File>>,
    changes: &Changes<'_>,
) -> Result<(Venue, Option<HeatmapCard>), NodeError> {
    let (venue, card) =
        replay_venue(&args.file, recording.attached(), changes).map_err(NodeError::Refused)?;
    check_names(&venue).map_err(NodeError::Refused)?;
    match (changes.calibration, changes.venue) {
        (Some(path), _) => check_calibration(&venue, path)?,
        (None, Some(_)) => check_calibration(&venue, &venue.calibration_path)?,
        (None, None) => {}
    }
    Ok((venue, card))
}

/// Smooths as it is asked for.
fn smooth(args: &ReplayArgs, venue: &Venue, pipeline: &mut Pipeline) {
    if args.smooth {
        pipeline.smooth_in_two_passes();
    } else if venue.parameters.smoothing.delay_ms > 0.0 {
        say(format_args!(
            "`smoothing.delay_ms`: a replay has no poses with a delay; `--smooth` gives those that know all that came after"
        ));
    }
}

/// Reads the recording through, and says what is missing of it.
fn open(path: &Path) -> anyhow::Result<Recording<BufReader<File>>> {
    let shown = path.display();
    let file = open_recording(path)?;
    let recording = Recording::open(BufReader::new(file));
    let recording = recording.map_err(|error| anyhow!("{shown}: {error}"))?;
    let end = recording.end();
    if !end.whole {
        let why = without_end(path, [end.read_bytes, end.file_bytes]);
        say(format_args!("{shown}: {why}"));
    }
    for (count, what) in [
        (
            end.damaged_chunks,
            "chunks are damaged and were passed over",
        ),
        (recording.unreadable(), "messages cannot be read"),
        (
            recording.lost(),
            "messages were not recorded: the disk was too slow",
        ),
    ] {
        if count > 0 {
            say(format_args!("{shown}: {count} {what}"));
        }
    }
    Ok(recording)
}

/// Which sets are used.
fn choice(args: &ReplayArgs, part: &SessionPart) -> Choice {
    if args.late {
        return Choice::All;
    }
    if part.decisions.is_empty() {
        say(format_args!(
            "{}: nobody recorded what fusion used for each tick; every set is used",
            args.file.display()
        ));
    }
    Choice::Decided
}

/// How a replay tells whose patches are; says so where the recording has `joined` a run at a tick.
fn owners(file: &Path, as_it_was: bool, joined: Option<Tick>) -> PatchOwners {
    if let Some(tick) = joined {
        say(format_args!(
            "{}: it begins in the middle of a run, at tick {tick}: people are found anew, and keep their ids where they are \
             recognised",
            file.display()
        ));
    }
    if as_it_was && joined.is_none() {
        PatchOwners::AsRecorded
    } else {
        PatchOwners::ByPlace
    }
}

/// The first tick of `part`, where people may have been known before it, whom nobody can name then.
///
/// # Errors
/// What of the recording cannot be read.
fn joined(
    recording: &mut Recording<BufReader<File>>,
    part: &SessionPart,
    rate_hz: f64,
) -> anyhow::Result<Option<Tick>> {
    let Some(decision) = first_decision(part) else {
        return Ok(None);
    };
    let began_s = (decision.tick - decision.first) as f64 / rate_hz;
    let poses = recording.poses(part.session, decision.tick)?;
    let is_empty = poses.is_some_and(|poses| poses.persons.is_empty());
    let nobody_s = if is_empty {
        NOBODY_GONE_S
    } else {
        NOBODY_YET_S
    };
    Ok((began_s > nobody_s).then_some(decision.tick))
}

/// The life of fusion that is asked for.
fn choose(args: &ReplayArgs, sessions: &[SessionPart]) -> anyhow::Result<SessionPart> {
    let shown = args.file.display();
    let number = args.session.unwrap_or(1);
    let chosen = number.checked_sub(1).and_then(|i| sessions.get(i));
    let list = || {
        let line = |(i, part): (usize, &SessionPart)| {
            let [from, to] = part.ticks;
            format!("{}: ticks {from} to {to}, {} sets", i + 1, part.sets)
        };
        let lines: Vec<String> = sessions.iter().enumerate().map(line).collect();
        lines.join("; ")
    };
    if sessions.len() > 1 && args.session.is_none() {
        say(format_args!(
            "{shown}: fusion was restarted while it was recorded, and its first life here is replayed (--session N takes another): {}",
            list()
        ));
    }
    chosen.cloned().ok_or_else(|| {
        if sessions.is_empty() {
            anyhow!("{shown}: there is no tick in the recording")
        } else {
            anyhow!("`--session` {number}: {shown} has {}", list())
        }
    })
}

/// A replay under way.
struct Solving<'a> {
    replay: Replay<BufReader<File>>,
    exporter: ExportThread,
    /// Whether the poses of two passes are written.
    smooth: bool,
    events: EventCounts,
    listening: &'a mut Listening,
}

impl Solving<'_> {
    fn run(mut self, stop: &CancellationToken) -> anyhow::Result<Done> {
        let began = clock::now();
        let mut ending = Ending::Done;
        while !self.exporter.has_failed()
            && let Some(output) = self.replay.step(&mut |_| {})?
        {
            self.listening.tell(&output, stop);
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
                .saturating_sub(self.listening.waited())
                .as_secs_f64(),
        })
    }
}

/// A token that is cancelled when somebody wants the process to end.
fn watch_signals() -> anyhow::Result<(CancellationToken, tokio::runtime::Runtime)> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .enable_all()
        .build()
        .context("starting the runtime")?;
    let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
    let entered = runtime.enter();
    stop_when_told(&tasks, &stop, Managed::No).context("listening for signals")?;
    drop(entered);
    Ok((stop, runtime))
}
