//! A recorded run: the open recording, its venue and subjects, and the chosen session.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_fusion::identity::subjects::Subject;
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::reader::{Recording, SessionPart};
use farfield_fusion::recording::replay::{
    Choice, PatchOwners, Replay, ReplayError, first_decision,
};
use farfield_node::process::{NodeError, say};
use farfield_proto::id::SessionId;
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::Venue;

use super::super::config::{check_calibration, check_names};
use super::super::recording::{OWN_RECORDING, without_end};
use super::super::subjects::{load_subjects, recorded_subjects};
use super::ReplayArgs;
use super::report::FileFacts;
use super::venue::{Changes, replay_venue};

/// Time after the first boxes of a run in which no one is known yet, seconds: the edges have not detected people yet.
const NONE_KNOWN_S: f64 = 0.5;
/// Time in which no person can have come, been confirmed and left, seconds.
const NONE_LEFT_S: f64 = 5.0;

/// A recorded run: its ticks, and the parts of a core for them.
pub struct RecordedRun {
    pub(super) replay: Replay<BufReader<File>>,
    pub(super) venue: Venue,
    card: Option<HeatmapCard>,
    subjects: Vec<Subject>,
    smooth: bool,
    pub(super) session: SessionId,
    pub(super) names: PatchOwners,
    pub(super) file: FileFacts,
    /// First and last tick.
    pub(super) span: [Tick; 2],
}

impl RecordedRun {
    /// Opens the recording that `args` name, and prints what is unusual about it.
    ///
    /// # Errors
    /// The recording cannot be read, or does not match `args`.
    pub fn open(args: &ReplayArgs) -> Result<Self, NodeError> {
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
        let joined = joined_at(&mut recording, &part, venue.rate_hz).map_err(NodeError::Refused)?;
        let names = owners(&args.file, as_it_was, joined);
        let choice = choice(args, &part);
        report_missing_delay(args, &venue);
        let (file, recorded, session) = (
            FileFacts::from_recording(&recording),
            part.ticks,
            part.session,
        );
        let pipeline = fresh_pipeline(&venue, card.as_ref(), session, &subjects, args.smooth);
        let replay = Replay::new(recording, part, pipeline, choice, names)
            .with_context(|| args.file.display().to_string())
            .map_err(NodeError::Refused)?;
        Ok(Self {
            span: replay.span().unwrap_or(recorded),
            replay,
            venue,
            card,
            subjects,
            smooth: args.smooth,
            session,
            names,
            file,
        })
    }

    /// The venue of the replay.
    pub fn venue(&self) -> &Venue {
        &self.venue
    }

    /// The ticks that are not solved yet.
    pub fn replay(&mut self) -> &mut Replay<BufReader<File>> {
        &mut self.replay
    }

    /// Rewinds to before the first tick, with a new core.
    ///
    /// # Errors
    /// The ticks are not of one run.
    pub fn rewind(&mut self) -> Result<(), ReplayError> {
        let card = self.card.as_ref();
        self.replay.rewind(fresh_pipeline(
            &self.venue,
            card,
            self.session,
            &self.subjects,
            self.smooth,
        ))
    }
}

fn fresh_pipeline(
    venue: &Venue,
    card: Option<&HeatmapCard>,
    session: SessionId,
    subjects: &[Subject],
    smooth: bool,
) -> Pipeline {
    let mut pipeline = Pipeline::new(venue, card, session);
    pipeline.know(subjects.to_vec());
    if smooth {
        pipeline.smooth_in_two_passes();
    }
    pipeline
}

/// The subjects: as recorded, or of another venue file if one is given.
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
/// The file cannot be opened, or is the folder of a run. The error names a recording in the folder, if there is one.
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

/// The venue of the replay, and the card of its network if it has one.
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

/// Reports that a replay has no delayed poses, if the venue asks for them.
fn report_missing_delay(args: &ReplayArgs, venue: &Venue) {
    if !args.smooth && venue.parameters.smoothing.delay_ms > 0.0 {
        say(format_args!(
            "`smoothing.delay_ms`: a replay has no delayed poses; `--smooth` gives poses that use all later data"
        ));
    }
}

/// Reads the whole recording, and reports what is missing.
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
        (end.damaged_chunks, "chunks are damaged and were skipped"),
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

/// The sets to use.
fn choice(args: &ReplayArgs, part: &SessionPart) -> Choice {
    if args.late {
        return Choice::All;
    }
    if part.decisions.is_empty() {
        say(format_args!(
            "{}: the sets that fusion used for each tick are not recorded; all sets are used",
            args.file.display()
        ));
    }
    Choice::Decided
}

/// How a replay assigns patches to people. Reports a recording that `joined` a run at a tick.
fn owners(file: &Path, as_it_was: bool, joined: Option<Tick>) -> PatchOwners {
    if let Some(tick) = joined {
        say(format_args!(
            "{}: the recording begins in the middle of a run, at tick {tick}: people are detected anew, and keep their ids if they are \
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

/// The first tick of `part`, if people may have been known before it; their ids are unknown then.
///
/// # Errors
/// The recording cannot be read.
fn joined_at(
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
    let margin_s = if is_empty { NONE_LEFT_S } else { NONE_KNOWN_S };
    Ok((began_s > margin_s).then_some(decision.tick))
}

/// The requested session.
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
            "{shown}: fusion was restarted during the recording; its first session is replayed (--session N selects another): {}",
            list()
        ));
    }
    chosen.cloned().ok_or_else(|| {
        if sessions.is_empty() {
            anyhow!("{shown}: the recording contains no tick")
        } else {
            anyhow!("`--session` {number}: {shown} has {}", list())
        }
    })
}
