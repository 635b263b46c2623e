//! A recorded run: opened, its venue and people known, the life of fusion chosen.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use anyhow::{Context as _, anyhow, bail, ensure};
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
use crate::identity::subjects::Subject;
use crate::pipeline::Pipeline;
use crate::recording::reader::{Recording, SessionPart};
use crate::recording::replay::{Choice, PatchOwners, Replay, ReplayError, first_decision};

/// How long after the first boxes of a run nobody is known yet, seconds: edges have not yet looked.
const NOBODY_YET_S: f64 = 0.5;
/// How long nobody can have come, been confirmed and gone again, seconds.
const NOBODY_GONE_S: f64 = 5.0;

/// A recorded run: its ticks on their way through the core, and what a core for them is made of.
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
    /// Opens the recording that `args` name, and says on standard error what is unusual about it.
    ///
    /// # Errors
    /// What of it cannot be read, or does not fit what `args` ask for.
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
        let joined = joined(&mut recording, &part, venue.rate_hz).map_err(NodeError::Refused)?;
        let names = owners(&args.file, as_it_was, joined);
        let choice = choice(args, &part);
        say_how_it_smooths(args, &venue);
        let (file, recorded, session) = (FileFacts::of(&recording), part.ticks, part.session);
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

    /// The venue that is solved for.
    pub fn venue(&self) -> &Venue {
        &self.venue
    }

    /// Its ticks, of which those that were solved are gone.
    pub fn replay(&mut self) -> &mut Replay<BufReader<File>> {
        &mut self.replay
    }

    /// Goes back to before the first tick, with a core that knows nothing of it.
    ///
    /// # Errors
    /// When the ticks are not those of one run.
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

/// Says which poses there are of a venue that smooths with a delay.
fn say_how_it_smooths(args: &ReplayArgs, venue: &Venue) {
    if !args.smooth && venue.parameters.smoothing.delay_ms > 0.0 {
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
