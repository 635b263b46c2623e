//! `farfield people RUN|RECORDING`: lists people; names and edits that can be undone.

mod words;

use std::fmt;
use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use farfield_export::edits::change::check_name;
use farfield_export::edits::{Change, EditList, Identities};
use farfield_export::run::{PeopleTable, RunFacts};
use farfield_export::{ExportError, profile_of};
use farfield_node::clock;
use farfield_node::process::{NodeError, say};
use time::OffsetDateTime;

use super::export::node_error;
use super::place::{POSES, Place, folder_of, whole_lines};
use super::recorded::RecordedRun;
use super::target::check_file;
use crate::output;

/// Arguments of `farfield people`.
#[derive(Debug, Args)]
pub(crate) struct PeopleArgs {
    /// The folder of a run, also of one in progress, its poses.jsonl, or a recording.
    run: PathBuf,
    /// What to do; default: list all people.
    #[command(subcommand)]
    action: Option<PeopleAction>,
    /// Print people and edits, or the error, as JSON.
    #[arg(long, global = true)]
    pub(crate) json: bool,
}

/// The edits. Poses do not change: an edit is one more line of a file next to them.
#[derive(Debug, Clone, Subcommand)]
enum PeopleAction {
    /// Name a person; "" removes the name.
    #[command(after_help = "Example: farfield people out name 3 Anna")]
    Name {
        /// Id of the person.
        #[arg(value_parser = id)]
        person: u32,
        /// The name.
        #[arg(value_parser = name)]
        name: String,
    },
    /// Merge two ids into one person.
    #[command(after_help = "Example: farfield people out merge 7 --into 3")]
    Merge {
        /// The id that disappears.
        #[arg(value_parser = id)]
        person: u32,
        /// The id that stays.
        #[arg(long, value_name = "ID", value_parser = id)]
        into: u32,
    },
    /// Split an id into two people.
    #[command(after_help = "Example: farfield people out split 3 --at 1200")]
    Split {
        /// The person who keeps the id before the tick.
        #[arg(value_parser = id)]
        person: u32,
        /// First tick of the other person, who gets a new id.
        #[arg(long, value_name = "TICK", allow_hyphen_values = true)]
        at: i64,
    },
    /// Remove a person.
    #[command(after_help = "Example: farfield people out drop 9")]
    Drop {
        /// Id of the person.
        #[arg(value_parser = id)]
        person: u32,
    },
    /// Undo an edit: the last one, or that with a number.
    #[command(after_help = "Example: farfield people out undo")]
    Undo {
        /// Its number in the list.
        number: Option<usize>,
    },
    /// Save a person's name and lengths to a file, for exports of other runs.
    #[command(after_help = "Example: farfield people out save 3 --to anna.toml")]
    Save {
        /// Id of the person.
        #[arg(value_parser = id)]
        person: u32,
        /// The file, which must not exist.
        #[arg(long, value_name = "FILE.toml")]
        to: PathBuf,
    },
}

fn id(word: &str) -> Result<u32, String> {
    let found = word.parse().ok();
    found.ok_or_else(|| {
        format!(
            "found `{word}`, expected the number of a person: `farfield people RUN` lists them, `farfield people RUN name 3 Anna` sets a name"
        )
    })
}

fn name(word: &str) -> Result<String, String> {
    let word = word.trim();
    check_name(word).map(|()| word.to_owned())
}

/// A run or recording, with its people and edits.
struct Known {
    edits: farfield_export::EditsFile,
    list: EditList,
    identities: Identities,
    table: PeopleTable,
    /// Ticks per second; unknown while a run is in progress.
    rate_hz: Option<f64>,
}

/// Executes the action and prints the result.
///
/// # Errors
/// [`NodeError::Refused`] if the run, its edits or the new edit are wrong, [`NodeError::Failed`] when a file cannot be
/// written.
pub(crate) fn people(args: &PeopleArgs) -> Result<(), NodeError> {
    let place = Place::find(&args.run).map_err(NodeError::Refused)?;
    if let Some(action @ PeopleAction::Save { person, to }) = &args.action {
        return save(&place, action, *person, to);
    }
    let (place, known) = load(&args.run, place)?;
    if let Place::InProgress { run, .. } = &place {
        say(format_args!(
            "{}: the run is still in progress: people and ticks so far",
            run.display()
        ));
    }
    let Some(action) = &args.action else {
        return print(&known, None, args.json);
    };
    let roll = Some(&known.table.roll);
    let change = |list: &EditList| change(action, list, &known);
    let edited = known.edits.add(&now(), roll, change);
    let edited = edited.map_err(|error| refused(action, error))?;
    let number = edited.next_number() - 1;
    if let Some(run) = place.run_in_progress() {
        say(format_args!(
            "{}: its run is still in progress, and page and streams do not use the edits of the recording: `farfield people {} ...` edits the run",
            args.run.display(),
            run.display()
        ));
    }
    let known = if args.json {
        // The list of people may have changed.
        load(&args.run, place)?.1
    } else {
        known.with(edited)?
    };
    print(&known, Some(number), args.json)
}

/// The people of `place`; if its run has ended meanwhile, those of the finished `run`.
fn load(run: &Path, place: Place) -> Result<(Place, Known), NodeError> {
    match Known::new(&place) {
        Err(_) if place.has_moved() => {
            let place = Place::find(run).map_err(NodeError::Refused)?;
            let known = Known::new(&place)?;
            Ok((place, known))
        }
        known => Ok((place, known?)),
    }
}

/// The edit of an action, given the existing edits.
fn change(action: &PeopleAction, list: &EditList, known: &Known) -> Result<Change, String> {
    Ok(match action.clone() {
        PeopleAction::Name { person, name } => Change::Name { person, name },
        PeopleAction::Merge { person, into } => Change::Merge { person, into },
        PeopleAction::Split { person, at } => {
            let ids = known.table.roll.ids().chain(list.largest_id());
            let new = ids.max().unwrap_or(0).checked_add(1);
            Change::Split {
                person,
                tick: at,
                new: new.ok_or("there is no id left")?,
            }
        }
        PeopleAction::Drop { person } => Change::Drop { person },
        PeopleAction::Undo { number } => {
            let last = list.in_force().last().map(|(number, _)| *number);
            let number = number.or(last);
            let number = number.ok_or("there is no edit to undo")?;
            Change::Undo { number }
        }
        PeopleAction::Save { .. } => return Err("saving is no edit".to_owned()),
    })
}

/// The error of an action, with its command line.
fn refused(action: &PeopleAction, error: ExportError) -> NodeError {
    let list = match action {
        PeopleAction::Undo { .. } => "; `farfield people RUN` lists edits with their numbers",
        _ => "",
    };
    match error {
        ExportError::Options(problem) => NodeError::Refused(anyhow!("{action}: {problem}{list}")),
        error => node_error(error),
    }
}

impl fmt::Display for PeopleAction {
    /// As on the command line, without names of people and files.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Name { person, .. } => write!(f, "name {person}"),
            Self::Merge { person, into } => write!(f, "merge {person} --into {into}"),
            Self::Split { person, at } => write!(f, "split {person} --at {at}"),
            Self::Drop { person } => write!(f, "drop {person}"),
            Self::Undo { number: None } => write!(f, "undo"),
            Self::Undo {
                number: Some(number),
            } => write!(f, "undo {number}"),
            Self::Save { person, .. } => write!(f, "save {person}"),
        }
    }
}

/// Saves the profile of a person to the file `to`.
fn save(place: &Place, action: &PeopleAction, person: u32, to: &Path) -> Result<(), NodeError> {
    check_file("--to", to).map_err(NodeError::Refused)?;
    let edits = place.edits();
    let profile = match place {
        Place::Run { poses, .. } => profile_of(poses, edits.path(), person),
        Place::InProgress { run, .. } => {
            return Err(NodeError::Refused(anyhow!(
                "{action}: {}: the run is still in progress, and lengths are still being measured: save them after its end",
                run.display()
            )));
        }
        Place::Recording(path) => {
            let recorded = RecordedRun::open(path).map_err(NodeError::Refused)?;
            let folder = recorded.as_run(folder_of(path));
            let folder = folder.map_err(NodeError::Failed)?;
            profile_of(&folder.path().join(POSES), edits.path(), person)
        }
    };
    let profile = profile.map_err(|error| refused(action, error))?;
    profile.write(to).map_err(|error| match error {
        ExportError::Exists { path } => {
            NodeError::Refused(anyhow!("{} already exists", path.display()))
        }
        error => node_error(error),
    })?;
    let text = format!(
        "{}: {}, {:.2} m; farfield export RUN --subject {}\n",
        to.display(),
        profile.name,
        profile.stature_m,
        to.display()
    );
    output::print(&text).map_err(NodeError::Failed)
}

fn print(known: &Known, number: Option<usize>, json: bool) -> Result<(), NodeError> {
    let text = match number {
        _ if json => words::json(known).map_err(NodeError::failed)?,
        Some(number) => words::done(known, number),
        None => words::table(known),
    };
    output::print(&text).map_err(NodeError::Failed)
}

impl Known {
    fn new(place: &Place) -> Result<Self, NodeError> {
        let edits = place.edits();
        let list = place.read_edits().map_err(node_error)?;
        let before = list.identities(None);
        let before = before.map_err(|fault| NodeError::refused(fault.in_file(edits.path())))?;
        let (table, rate_hz) = table(place, &before).map_err(NodeError::Refused)?;
        let known = Self {
            edits,
            list: EditList::default(),
            identities: before,
            table,
            rate_hz,
        };
        known.with(list)
    }

    /// The same with these edits, checked against the people.
    fn with(mut self, list: EditList) -> Result<Self, NodeError> {
        let identities = list.identities(Some(&self.table.roll));
        self.identities =
            identities.map_err(|fault| NodeError::refused(fault.in_file(self.edits.path())))?;
        self.list = list;
        Ok(self)
    }
}

/// The people, and the rate if known.
fn table(place: &Place, identities: &Identities) -> anyhow::Result<(PeopleTable, Option<f64>)> {
    match place {
        Place::InProgress { poses, .. } => {
            let opening = || format!("opening {}", poses.display());
            let file = BufReader::new(whole_lines(poses).with_context(opening)?);
            Ok((PeopleTable::of_lines(file, poses, identities)?, None))
        }
        Place::Run { poses, summary, .. } => {
            let reading = || format!("reading {}", summary.display());
            let facts =
                RunFacts::parse(&fs::read_to_string(summary).with_context(reading)?, summary)?;
            let file = File::open(poses).with_context(|| format!("opening {}", poses.display()))?;
            let table = PeopleTable::of_lines(BufReader::new(file), poses, identities)?;
            Ok((table, Some(facts.rate_hz)))
        }
        Place::Recording(path) => {
            let recorded = RecordedRun::open(path)?;
            let mut table = PeopleTable::default();
            recorded.poses(&mut |poses| table.add_poses(poses, identities))?;
            Ok((table, Some(recorded.rate_hz())))
        }
    }
}

/// The current time in UTC, in RFC 3339 format.
pub(crate) fn now() -> String {
    rfc3339(clock::unix_time().as_secs())
}

fn rfc3339(unix_s: u64) -> String {
    let at = i64::try_from(unix_s)
        .ok()
        .and_then(|at| OffsetDateTime::from_unix_timestamp(at).ok());
    let at = at.unwrap_or(OffsetDateTime::UNIX_EPOCH);
    format!(
        "{:04}-{:02}-{:02}T{:02}:{:02}:{:02}Z",
        at.year(),
        u8::from(at.month()),
        at.day(),
        at.hour(),
        at.minute(),
        at.second()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_formatted_as_rfc_3339() {
        // `date -u -d @N`.
        assert_eq!(rfc3339(951_827_696), "2000-02-29T12:34:56Z");
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00Z");
    }
}
