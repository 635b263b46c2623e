//! `farfield people RUN|RECORDING`: who is in it, and names and edits that can be undone.

mod so_far;
pub(crate) mod time_of_day;
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
use farfield_node::process::{NodeError, say};

use self::so_far::whole_lines;
use self::time_of_day::now;
use super::export::node_error;
use super::place::{POSES, Place, folder_of};
use super::recorded::RecordedRun;
use super::target::check_file;
use crate::output;

/// What `farfield people` is told.
#[derive(Debug, Args)]
pub(crate) struct PeopleArgs {
    /// The folder of a run, also of one that goes on, its poses.jsonl, or a recording.
    run: PathBuf,
    /// What to do; without it everybody is listed.
    #[command(subcommand)]
    action: Option<PeopleAction>,
    /// Print people and edits, or what went wrong, as JSON.
    #[arg(long, global = true)]
    pub(crate) json: bool,
}

/// What is done. Poses stay as they are: the edit is one more line of a file beside them.
#[derive(Debug, Clone, Subcommand)]
enum PeopleAction {
    /// Call a person by a name; "" takes it away.
    #[command(after_help = "Example: farfield people out name 3 Anna")]
    Name {
        /// Who.
        #[arg(value_parser = id)]
        person: u32,
        /// The name.
        #[arg(value_parser = name)]
        name: String,
    },
    /// Make two ids one person.
    #[command(after_help = "Example: farfield people out merge 7 --into 3")]
    Merge {
        /// The id that goes.
        #[arg(value_parser = id)]
        person: u32,
        /// The id that stays.
        #[arg(long, value_name = "ID", value_parser = id)]
        into: u32,
    },
    /// Make an id two people.
    #[command(after_help = "Example: farfield people out split 3 --at 1200")]
    Split {
        /// Who keeps the id before the tick.
        #[arg(value_parser = id)]
        person: u32,
        /// First tick of the other, who gets a new id.
        #[arg(long, value_name = "TICK", allow_hyphen_values = true)]
        at: i64,
    },
    /// Leave a person out.
    #[command(after_help = "Example: farfield people out drop 9")]
    Drop {
        /// Who.
        #[arg(value_parser = id)]
        person: u32,
    },
    /// Take an edit back: the last, or the one of that number.
    #[command(after_help = "Example: farfield people out undo")]
    Undo {
        /// Its number, as listed.
        number: Option<usize>,
    },
    /// Keep a person's name and lengths in a file, for exports of other runs.
    #[command(after_help = "Example: farfield people out save 3 --to anna.toml")]
    Save {
        /// Who.
        #[arg(value_parser = id)]
        person: u32,
        /// The file, which must not be there.
        #[arg(long, value_name = "FILE.toml")]
        to: PathBuf,
    },
}

fn id(word: &str) -> Result<u32, String> {
    let found = word.parse().ok();
    found.ok_or_else(|| {
        format!(
            "found `{word}`, expected the number of a person: `farfield people RUN` lists them, `farfield people RUN name 3 Anna` names one"
        )
    })
}

fn name(word: &str) -> Result<String, String> {
    let word = word.trim();
    check_name(word).map(|()| word.to_owned())
}

/// A run or recording, and what is known of its people.
struct Known {
    edits: farfield_export::EditsFile,
    list: EditList,
    identities: Identities,
    table: PeopleTable,
    /// Ticks per second; a run that goes on does not say it yet.
    rate_hz: Option<f64>,
}

/// Does what is asked for, and prints it.
///
/// # Errors
/// [`NodeError::Refused`] where the run, its edits or the new edit are wrong, [`NodeError::Failed`] when a file cannot be written.
pub(crate) fn people(args: &PeopleArgs) -> Result<(), NodeError> {
    let place = Place::of(&args.run).map_err(NodeError::Refused)?;
    if let Some(action @ PeopleAction::Save { person, to }) = &args.action {
        return save(&place, action, (*person, to));
    }
    let (place, known) = found(&args.run, place)?;
    if let Place::GoingOn { run, .. } = &place {
        say(format_args!(
            "{}: its run goes on: people and ticks are those so far",
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
    if let Some(run) = place.run_beside() {
        say(format_args!(
            "{}: its run goes on, and neither page nor streams look at the edits of the recording: `farfield people {} ...` edits what they show",
            args.run.display(),
            run.display()
        ));
    }
    let known = if args.json {
        // Who is listed is somebody else now.
        found(&args.run, place)?.1
    } else {
        known.with(edited)?
    };
    print(&known, Some(number), args.json)
}

/// What is known of the people of `place`, which is what `run` names, or was until its run ended.
fn found(run: &Path, place: Place) -> Result<(Place, Known), NodeError> {
    match Known::of(&place) {
        Err(_) if place.has_moved() => {
            let place = Place::of(run).map_err(NodeError::Refused)?;
            let known = Known::of(&place)?;
            Ok((place, known))
        }
        known => Ok((place, known?)),
    }
}

/// The edit that an action is, where these edits are there already.
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
            let number = number.ok_or("there is no edit in force that could be undone")?;
            Change::Undo { number }
        }
        PeopleAction::Save { .. } => return Err("saving is no edit".to_owned()),
    })
}

/// Why an action cannot be done, with the words that ask for it.
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
    /// As it stands on the command line, without names of people and files.
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

/// Keeps the profile of a person in the file `to`, as `action` says.
fn save(place: &Place, action: &PeopleAction, (person, to): (u32, &Path)) -> Result<(), NodeError> {
    check_file("--to", to).map_err(NodeError::Refused)?;
    let edits = place.edits();
    let profile = match place {
        Place::Run { poses, .. } => profile_of(poses, edits.path(), person),
        Place::GoingOn { run, .. } => {
            return Err(NodeError::Refused(anyhow!(
                "{action}: {}: its run goes on, and lengths are still learnt: save them when it has ended",
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
            NodeError::Refused(anyhow!("{} is there already", path.display()))
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
    fn of(place: &Place) -> Result<Self, NodeError> {
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

    /// The same with these edits, held against who is there.
    fn with(mut self, list: EditList) -> Result<Self, NodeError> {
        let identities = list.identities(Some(&self.table.roll));
        self.identities =
            identities.map_err(|fault| NodeError::refused(fault.in_file(self.edits.path())))?;
        self.list = list;
        Ok(self)
    }
}

/// Who is there, and at which rate, where that is known.
fn table(place: &Place, identities: &Identities) -> anyhow::Result<(PeopleTable, Option<f64>)> {
    match place {
        Place::GoingOn { poses, .. } => {
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
