//! What pages call people: kept beside the run and its recording, as `farfield people` and exports read it, and told at once to
//! whoever listens.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};
use std::time::SystemTime;

use anyhow::Context as _;
use farfield_export::EditsFile;
use farfield_export::edits::change::check_name;
use farfield_export::edits::{Change, EditList, Identities};
use farfield_fusion::export::unfinished::write_whole_again;
use farfield_node::files::read_text_bounded;
use farfield_node::process::say;
use farfield_page::{Action, ActionKind, PageActions, PageState};
use farfield_proto::message::naming::Naming;
use farfield_streams::Streams;

use crate::exchange::people::time_of_day::now;

/// Most people that are named.
const MAX_NAMES: usize = 1024;
/// Most bytes that are read of the names that an earlier fusion has left.
const MOST_KEPT_BYTES: u64 = 1 << 20;

/// By which it is seen that somebody else has edited: the length of the file, and when it was written.
type Stamp = (u64, SystemTime);

/// What people of a run or recording are called.
pub(super) struct GivenNames {
    known: Mutex<Known>,
    /// Names that a fusion of the same venue finds when it is started again; `None`: nothing is kept for it.
    kept: Option<PathBuf>,
    page: OnceLock<Weak<PageState>>,
    streams: OnceLock<Weak<Streams>>,
}

struct Known {
    by_person: BTreeMap<u32, String>,
    /// Who is whom, and what they are called: for streams, which show people as edits make them.
    people: Identities,
    /// How the first file was when it was read.
    read: Option<Stamp>,
    /// Beside the run, and beside its recording: the same names go to all.
    files: Vec<EditsFile>,
}

impl GivenNames {
    /// Those of a run in the folder `out` that begins; a fusion that is started again finds them in `kept`.
    pub(super) fn of_run(out: &Path, kept: Option<PathBuf>) -> Arc<Self> {
        let given = Self::new(vec![EditsFile::of_run(out)], kept);
        // A run that solves a recording again begins with its edits.
        given.look_again();
        given
    }

    /// Those of a recording, with what stands beside it.
    ///
    /// # Errors
    /// What of the edits beside it is wrong.
    pub(super) fn of_recording(path: &Path) -> anyhow::Result<Arc<Self>> {
        let file = EditsFile::of_recording(path);
        let (by_person, people) = named(&file)?;
        let given = Self::new(vec![file], None);
        let mut known = given.known();
        (known.by_person, known.people) = (by_person, people);
        drop(known);
        Ok(given)
    }

    fn new(files: Vec<EditsFile>, kept: Option<PathBuf>) -> Arc<Self> {
        let known = Known {
            by_person: BTreeMap::new(),
            people: Identities::default(),
            read: None,
            files,
        };
        Arc::new(Self {
            known: Mutex::new(known),
            kept,
            page: OnceLock::new(),
            streams: OnceLock::new(),
        })
    }

    /// Tells `page` the names, now and whenever one changes.
    pub(super) fn tell_page(&self, page: &Arc<PageState>) {
        self.page.get_or_init(|| Arc::downgrade(page));
        self.tell(&self.known());
    }

    /// Tells `streams` the names, now and whenever one changes.
    pub(super) fn tell_streams(&self, streams: &Arc<Streams>) {
        self.streams.get_or_init(|| Arc::downgrade(streams));
        self.tell(&self.known());
    }

    /// A recording begins at `path`: it has the names so far, and gets those that come; none where they cannot be written.
    pub(super) fn recording_begins(&self, path: &Path) {
        let mut known = self.known();
        let file = EditsFile::of_recording(path);
        let mut named = known.by_person.iter();
        let written = named.try_for_each(|(person, name)| add(&file, *person, name));
        if let Err(error) = written {
            say(format_args!(
                "names are not kept beside the recording: {error}"
            ));
            return;
        }
        // One at a time goes on: one that has ended has the names of those who were in it.
        known.files.truncate(1);
        known.files.push(file);
    }

    /// People of the fusion before keep their ids, and so their names; all other names of then are forgotten.
    pub(super) fn expected(&self, ids: &[u32]) {
        let Some(kept) = &self.kept else { return };
        let before = read_kept(kept).map_err(|error| {
            say(format_args!(
                "names of who was here before are lost: {error:#}"
            ));
        });
        let mut names = before.clone().unwrap_or_default();
        names.retain(|person, _| ids.contains(person));
        // Ids of the others mean other people from now on, also to a fusion that is started after this one.
        if before.as_ref() != Ok(&names)
            && let Err(error) = keep(kept, &names)
        {
            say(format_args!(
                "names of who was here before stay: {error}; remove the file"
            ));
        }
        for (person, name) in names {
            if let Err(error) = self.name(person, &name) {
                say(format_args!("the name of person {person} is lost: {error}"));
            }
        }
    }

    /// Reads edits that another program has made meanwhile, `farfield people` say, and tells what they come to.
    pub(super) fn look_again(&self) {
        let mut known = self.known();
        let Some(path) = known.files.first().map(|file| file.path().to_owned()) else {
            return;
        };
        if stamp(&path) != known.read
            && let Err(error) = self.take_names(&mut known)
        {
            // Until it is written again.
            known.read = stamp(&path);
            say(format_args!("edits are left as they were: {error}"));
        }
    }

    /// Fusion takes a person for a subject of the venue; whom somebody has named, or whose name was taken back, stays as it is.
    pub(super) fn guess(&self, naming: &Naming) {
        say(format_args!("{naming}"));
        let Some(name) = naming.name() else { return };
        let person = naming.person.0;
        let mut known = self.known();
        if known.by_person.len() >= MAX_NAMES {
            return;
        }
        for file in &known.files {
            if let Err(error) = add_guess(file, person, name) {
                let path = file.path().display();
                say(format_args!(
                    "{path} lacks the name of person {person}: {error}"
                ));
            }
        }
        self.take_names(&mut known).unwrap_or_else(|error| {
            say(format_args!("the name of person {person} is lost: {error}"));
        });
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        // What a thread that died left is whole: a map and a list.
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls a person by a name, or by none.
    fn name(&self, person: u32, name: &str) -> Result<(), String> {
        check_name(name)?;
        let mut known = self.known();
        let is_new = !known.by_person.contains_key(&person);
        if is_new && !name.is_empty() && known.by_person.len() >= MAX_NAMES {
            return Err(format!("{MAX_NAMES} people have names already"));
        }
        // What nobody could find again is not shown as if it were kept. The first file decides: a name that it has is given.
        if let Some((first, others)) = known.files.split_first() {
            add(first, person, name)?;
            for file in others {
                if let Err(error) = add(file, person, name) {
                    let path = file.path().display();
                    say(format_args!(
                        "{path} lacks a name of person {person}: {error}"
                    ));
                }
            }
        }
        self.take_names(&mut known)
    }

    /// Reads the names from the edits of the run, tells them and keeps them.
    fn take_names(&self, known: &mut Known) -> Result<(), String> {
        if let Some(file) = known.files.first() {
            // Before: what is written meanwhile is seen the next time.
            let read = stamp(file.path());
            // Several ids may be one person by the edits.
            let (by_person, people) = named(file).map_err(|error| format!("{error:#}"))?;
            (known.by_person, known.people, known.read) = (by_person, people, read);
        }
        self.tell(known);
        if let Some(kept) = &self.kept
            && let Err(error) = keep(kept, &known.by_person)
        {
            say(format_args!(
                "names are not kept for a fusion that is started again: {error}"
            ));
        }
        Ok(())
    }

    fn tell(&self, known: &Known) {
        if let Some(page) = self.page.get().and_then(Weak::upgrade) {
            page.set_names(known.by_person.clone());
        }
        if let Some(streams) = self.streams.get().and_then(Weak::upgrade) {
            streams.set_people(known.people.clone());
        }
    }
}

impl PageActions for GivenNames {
    fn kinds(&self) -> Vec<ActionKind> {
        vec![ActionKind::NamePerson]
    }

    fn act(&self, action: &Action) -> Result<(), String> {
        match action {
            Action::NamePerson { person, name } => self.name(*person, name.trim()),
            _ => Err("only a live run can be recorded from here".to_owned()),
        }
    }
}

/// What people are called in a run or recording with edits beside it, by the ids that are in it, and who they are.
fn named(file: &EditsFile) -> anyhow::Result<(BTreeMap<u32, String>, Identities)> {
    let identities = file.read()?.identities(None);
    let identities = identities.map_err(|fault| fault.in_file(file.path()))?;
    let names = identities.names_of_poses(identities.edited_ids());
    Ok((names, identities))
}

fn stamp(path: &Path) -> Option<Stamp> {
    let facts = fs::metadata(path).ok()?;
    Some((facts.len(), facts.modified().ok()?))
}

/// Adds a name to the edits; whom they call by another id by that.
fn add(file: &EditsFile, person: u32, name: &str) -> Result<(), String> {
    let change = |list: &EditList| {
        let identities = list.identities(None).map_err(|fault| fault.to_string())?;
        let whole = identities.whole(person);
        Ok(Change::Name {
            person: whole.ok_or_else(|| {
                format!("person {person} was split or left out: `farfield people` names whom that has made")
            })?,
            name: name.to_owned(),
        })
    };
    let added = file.add(&now(), None, change);
    added.map(drop).map_err(|error| {
        let error = anyhow::Error::from(error);
        format!("the name is not kept: {error:#}")
    })
}

/// Adds what the body tells of a name, where nobody has said anything of that person's name, and no such edit was undone.
fn add_guess(file: &EditsFile, person: u32, name: &str) -> Result<(), String> {
    let list = file.read().map_err(|error| error.to_string())?;
    let identities = list.identities(None).map_err(|fault| fault.to_string())?;
    let Some(whole) = identities.whole(person) else {
        return Ok(());
    };
    let is_settled = list.all().any(|(_, edit)| match &edit.change {
        Change::Name { person, .. } => *person == whole,
        Change::Guess { person, name: told } => *person == whole && told == name,
        _ => false,
    });
    if is_settled {
        return Ok(());
    }
    let name = name.to_owned();
    let guess = |_: &EditList| {
        Ok(Change::Guess {
            person: whole,
            name,
        })
    };
    let added = file.add(&now(), None, guess);
    added.map(drop).map_err(|error| error.to_string())
}

fn keep(path: &Path, names: &BTreeMap<u32, String>) -> Result<(), String> {
    let text = serde_json::to_string(names).map_err(|error| error.to_string())?;
    let written = write_whole_again(path, text.as_bytes());
    written.map_err(|error| format!("writing {}: {error}", path.display()))
}

fn read_kept(path: &Path) -> anyhow::Result<BTreeMap<u32, String>> {
    let reading = || format!("reading {}", path.display());
    let text = match read_text_bounded(path, MOST_KEPT_BYTES) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(BTreeMap::new()),
        text => text.with_context(reading)?,
    };
    serde_json::from_str(&text).with_context(reading)
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::PersonId;
    use farfield_proto::message::naming::{BodyLikeness, Finding};

    use super::*;

    fn named(person: u32, name: &str) -> Action {
        Action::NamePerson {
            person,
            name: name.to_owned(),
        }
    }

    fn names(file: &EditsFile) -> BTreeMap<u32, String> {
        super::named(file).unwrap().0
    }

    #[test]
    fn a_name_stands_beside_the_run_and_a_recording_that_begins_later() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("hall.mcap");
        let given = GivenNames::of_run(folder.path(), None);
        given.act(&named(3, "Anna")).unwrap();
        given.recording_begins(&recording);
        given.act(&named(4, " Bo ")).unwrap();
        given.act(&named(3, "")).unwrap();
        let expected = BTreeMap::from([(4, "Bo".to_owned())]);
        assert_eq!(names(&EditsFile::of_run(folder.path())), expected);
        assert_eq!(names(&EditsFile::of_recording(&recording)), expected);
        assert!(given.act(&named(4, "a\u{7}b")).is_err());
        // Who looks at the recording sees them, and names on.
        let seen = GivenNames::of_recording(&recording).unwrap();
        seen.act(&named(5, "Cy")).unwrap();
        assert_eq!(names(&EditsFile::of_recording(&recording)).len(), 2);
    }

    fn naming(person: u32, name: &str) -> Naming {
        let why = BodyLikeness {
            lengths_sigma: 0.5,
            log_ratio: 5.0,
            margin: None,
        };
        Naming {
            person: PersonId(person),
            finding: Finding::Named {
                subject: name.to_owned(),
                why,
            },
        }
    }

    #[test]
    fn a_name_given_by_hand_wins_over_one_that_the_body_tells_whichever_comes_first() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_run(folder.path());
        let given = GivenNames::of_run(folder.path(), None);
        given.guess(&naming(3, "Anna"));
        given.guess(&naming(4, "Bo"));
        assert_eq!(names(&file)[&3], "Anna");
        given.act(&named(3, "Cy")).unwrap();
        given.guess(&naming(3, "Anna"));
        assert_eq!(names(&file)[&3], "Cy");
        // Who is called nothing by hand has no name, and a guess that was undone does not come back.
        given.act(&named(5, "Di")).unwrap();
        given.act(&named(5, "")).unwrap();
        given.guess(&naming(5, "Anna"));
        file.add("now", None, |_| Ok(Change::Undo { number: 2 }))
            .unwrap();
        given.guess(&naming(4, "Bo"));
        assert_eq!(names(&file), BTreeMap::from([(3, "Cy".to_owned())]));
        // Of two who are one by hand the name counts that somebody gave.
        given.guess(&naming(7, "Eve"));
        file.add("now", None, |_| Ok(Change::Merge { person: 3, into: 7 }))
            .unwrap();
        assert_eq!(names(&file)[&7], "Cy");
    }

    #[test]
    fn what_another_program_edits_is_seen_when_it_is_looked_for() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_run(folder.path());
        let add = |change: Change| drop(file.add("now", None, |_| Ok(change)).unwrap());
        add(Change::Name {
            person: 3,
            name: "Anna".to_owned(),
        });
        let given = GivenNames::of_run(folder.path(), None);
        assert_eq!(given.known().by_person[&3], "Anna");
        add(Change::Merge { person: 4, into: 3 });
        given.look_again();
        assert_eq!(given.known().by_person[&4], "Anna");
        assert_eq!(given.known().people.person_at(0, 4), Some(3));
        // What cannot be read leaves all as it was.
        fs::write(file.path(), "{\n").unwrap();
        given.look_again();
        assert_eq!(given.known().by_person.len(), 2);
    }

    #[test]
    fn a_name_that_cannot_be_kept_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let given = GivenNames::of_run(&folder.path().join("nowhere"), None);
        let refused = given.act(&named(3, "Anna")).unwrap_err();
        assert!(refused.contains("edits.jsonl"), "{refused}");
        fs::write(folder.path().join("edits.jsonl"), "{\n").unwrap();
        let given = GivenNames::of_run(folder.path(), None);
        let refused = given.act(&named(3, "Anna")).unwrap_err();
        assert!(refused.contains("edits.jsonl:1:"), "{refused}");
    }

    #[test]
    fn who_keeps_the_id_over_a_restart_keeps_the_name() {
        let folder = tempfile::tempdir().unwrap();
        let kept = folder.path().join("hall.names.json");
        let runs = ["one", "two", "three"].map(|name| folder.path().join(name));
        for run in &runs {
            fs::create_dir(run).unwrap();
        }
        let first = GivenNames::of_run(&runs[0], Some(kept.clone()));
        for (person, name) in [(3, "Anna"), (4, "Bo")] {
            first.act(&named(person, name)).unwrap();
        }
        let again = GivenNames::of_run(&runs[1], Some(kept.clone()));
        again.expected(&[4, 5]);
        let expected = BTreeMap::from([(4, "Bo".to_owned())]);
        assert_eq!(names(&EditsFile::of_run(&runs[1])), expected);
        // Where nobody is expected ids mean others.
        let anew = GivenNames::of_run(&runs[2], Some(kept));
        anew.act(&named(3, "Cy")).unwrap();
        let expected = BTreeMap::from([(3, "Cy".to_owned())]);
        assert_eq!(names(&EditsFile::of_run(&runs[2])), expected);
    }

    #[test]
    fn names_of_an_earlier_session_are_forgotten_when_ids_begin_anew() {
        let folder = tempfile::tempdir().unwrap();
        let kept = folder.path().join("hall.names.json");
        let run = || GivenNames::of_run(folder.path(), Some(kept.clone()));
        run().act(&named(3, "Anna")).unwrap();
        run().expected(&[]);
        assert_eq!(read_kept(&kept).unwrap(), BTreeMap::new());
        fs::remove_file(folder.path().join("edits.jsonl")).unwrap();
        let third = run();
        third.expected(&[3]);
        assert!(third.known().by_person.is_empty());
        fs::write(&kept, "{\"3\": ").unwrap();
        run().expected(&[3]);
        assert_eq!(read_kept(&kept).unwrap(), BTreeMap::new());
    }

    #[test]
    fn a_name_that_the_run_has_is_given_whatever_becomes_of_the_other_files() {
        let folder = tempfile::tempdir().unwrap();
        let kept = folder.path().join("hall.names.json");
        // Of a fusion that was killed while it wrote.
        fs::write(
            folder
                .path()
                .join(format!("hall.names.json.{}-0.tmp", u32::MAX)),
            "{",
        )
        .unwrap();
        let given = GivenNames::of_run(folder.path(), Some(kept.clone()));
        given.recording_begins(&folder.path().join("nowhere/a.mcap"));
        given.act(&named(3, "Anna")).unwrap();
        let expected = BTreeMap::from([(3, "Anna".to_owned())]);
        assert_eq!(names(&EditsFile::of_run(folder.path())), expected);
        assert_eq!(read_kept(&kept).unwrap(), expected);
        let given = GivenNames::of_run(folder.path(), Some(folder.path().join("nowhere/b.json")));
        given.act(&named(3, "Bo")).unwrap();
        assert_eq!(given.known().by_person[&3], "Bo");
        given.recording_begins(&folder.path().join("nowhere/a.mcap"));
        assert_eq!(given.known().files.len(), 1);
    }
}
