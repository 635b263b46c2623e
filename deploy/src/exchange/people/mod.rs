//! `farfield people RUN|RECORDING`: who is in it, and names and edits that can be undone.

pub(crate) mod time_of_day;
mod words;

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::{Args, Subcommand};
use farfield_export::edits::change::check_name;
use farfield_export::edits::{Change, EditList, Identities};
use farfield_export::run::{PeopleTable, RunFacts};
use farfield_export::{ExportError, profile_of};
use farfield_node::process::NodeError;

use self::time_of_day::now;
use super::export::node_error;
use super::place::{POSES, Place};
use super::recorded::RecordedRun;
use super::target::check_file;
use crate::output;

/// What `farfield people` is told.
#[derive(Debug, Args)]
pub(crate) struct PeopleArgs {
    /// The folder of a run, its poses.jsonl, or a recording.
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
    rate_hz: f64,
}

/// Does what is asked for, and prints it.
///
/// # Errors
/// [`NodeError::Refused`] where the run, its edits or the new edit are wrong, [`NodeError::Failed`] when a file cannot be written.
pub(crate) fn people(args: &PeopleArgs) -> Result<(), NodeError> {
    let place = Place::of(&args.run).map_err(NodeError::Refused)?;
    if let Some(PeopleAction::Save { person, to }) = &args.action {
        return save(&place, *person, to);
    }
    let known = Known::of(&place)?;
    let Some(action) = &args.action else {
        return print(&known, None, args.json);
    };
    let roll = Some(&known.table.roll);
    let change = |list: &EditList| change(action, list, &known);
    let edited = known.edits.add(&now(), roll, change).map_err(node_error)?;
    let number = edited.next_number() - 1;
    let known = if args.json {
        // Who is listed is somebody else now.
        Known::of(&place)?
    } else {
        known.with(edited)?
    };
    print(&known, Some(number), args.json)
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

/// Keeps the profile of a person in the file `to`.
fn save(place: &Place, person: u32, to: &Path) -> Result<(), NodeError> {
    check_file("--to", to).map_err(NodeError::Refused)?;
    let edits = place.edits();
    let profile = match place {
        Place::Run { poses, .. } => profile_of(poses, edits.path(), person),
        Place::Recording(path) => {
            let recorded = RecordedRun::open(path).map_err(NodeError::Refused)?;
            let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
            let folder = recorded.as_run(folder.unwrap_or(Path::new(".")));
            let folder = folder.map_err(NodeError::Failed)?;
            profile_of(&folder.path().join(POSES), edits.path(), person)
        }
    };
    let profile = profile.map_err(node_error)?;
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

/// Who is there, and at which rate.
fn table(place: &Place, identities: &Identities) -> anyhow::Result<(PeopleTable, f64)> {
    match place {
        Place::Run { poses, summary, .. } => {
            let reading = || format!("reading {}", summary.display());
            let facts =
                RunFacts::parse(&fs::read_to_string(summary).with_context(reading)?, summary)?;
            let file = File::open(poses).with_context(|| format!("opening {}", poses.display()))?;
            let table = PeopleTable::of_lines(BufReader::new(file), poses, identities)?;
            Ok((table, facts.rate_hz))
        }
        Place::Recording(path) => {
            let recorded = RecordedRun::open(path)?;
            let mut table = PeopleTable::default();
            recorded.poses(&mut |poses| table.add_poses(poses, identities))?;
            Ok((table, recorded.rate_hz()))
        }
    }
}
