//! Names that pages give to people: stored next to the run and its recording, where `farfield people` and exports read
//! them, and sent to pages and streams at once.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};
use std::thread::{self, JoinHandle};
use std::time::{Duration, SystemTime};

use anyhow::Context as _;
use farfield_export::EditsFile;
use farfield_export::edits::change::check_name;
use farfield_export::edits::{Change, EditList, Identities};
use farfield_fusion::export::unfinished::write_whole_again;
use farfield_fusion_node::{CopiedMessage, CopiedStep, Wiretap};
use farfield_node::files::read_text_bounded;
use farfield_node::process::{NodeError, say};
use farfield_page::{Action, ActionKind, PageActions, PageState};
use farfield_proto::key::Keys;
use farfield_proto::message::naming::{Naming, NamingSet};
use farfield_proto::venue::Venue;
use farfield_proto::wire;
use farfield_streams::Streams;

use crate::exchange::people::now;

/// Limit for named people.
const MAX_NAMES: usize = 1024;
/// Limit for the file with names of an earlier fusion, bytes.
const MOST_KEPT_BYTES: u64 = 1 << 20;

/// Detects edits by other programs: length of the file and time of its last change.
type Stamp = (u64, SystemTime);

/// The names of the people of a run or recording.
pub(super) struct GivenNames {
    known: Mutex<Known>,
    /// File with names for a restarted fusion of the same venue; `None`: none is saved.
    saved: Option<PathBuf>,
    page: OnceLock<Weak<PageState>>,
    streams: OnceLock<Weak<Streams>>,
}

struct Known {
    by_person: BTreeMap<u32, String>,
    /// Merged and split people with their names: streams show people as edited.
    people: Identities,
    /// State of the first file when it was read.
    read: Option<Stamp>,
    /// Next to the run and to its recording: all get the same names.
    files: Vec<EditsFile>,
}

impl GivenNames {
    /// Names of a run in the folder `out` that begins. A restarted fusion finds them in `saved`.
    pub(super) fn of_run(out: &Path, saved: Option<PathBuf>) -> Arc<Self> {
        let given = Self::new(vec![EditsFile::of_run(out)], saved);
        // A replay begins with the edits of its recording.
        given.reload();
        given
    }

    /// Names of a recording, with the edits next to it.
    ///
    /// # Errors
    /// Invalid edits.
    pub(super) fn of_recording(path: &Path) -> anyhow::Result<Arc<Self>> {
        let file = EditsFile::of_recording(path);
        let (by_person, people) = named(&file)?;
        let given = Self::new(vec![file], None);
        let mut known = given.known();
        (known.by_person, known.people) = (by_person, people);
        drop(known);
        Ok(given)
    }

    fn new(files: Vec<EditsFile>, saved: Option<PathBuf>) -> Arc<Self> {
        let known = Known {
            by_person: BTreeMap::new(),
            people: Identities::default(),
            read: None,
            files,
        };
        Arc::new(Self {
            known: Mutex::new(known),
            saved,
            page: OnceLock::new(),
            streams: OnceLock::new(),
        })
    }

    /// Sends the names to `page`, now and at every change.
    pub(super) fn attach_page(&self, page: &Arc<PageState>) {
        self.page.get_or_init(|| Arc::downgrade(page));
        self.publish(&self.known());
    }

    /// Sends the names to `streams`, now and at every change.
    pub(super) fn attach_streams(&self, streams: &Arc<Streams>) {
        self.streams.get_or_init(|| Arc::downgrade(streams));
        self.publish(&self.known());
    }

    /// A recording begins at `path`: it gets all names so far and later ones, unless they cannot be written.
    pub(super) fn recording_begins(&self, path: &Path) {
        let mut known = self.known();
        let file = EditsFile::of_recording(path);
        let mut named = known.by_person.iter();
        let written = named.try_for_each(|(person, name)| add(&file, *person, name));
        if let Err(error) = written {
            say(format_args!(
                "cannot store names next to the recording: {error}"
            ));
            return;
        }
        // Only one recording runs at a time; an ended one has the names of its people.
        known.files.truncate(1);
        known.files.push(file);
    }

    /// People of the earlier fusion that keep their ids keep their names; all other names are discarded.
    pub(super) fn expected(&self, ids: &[u32]) {
        let Some(saved) = &self.saved else { return };
        let before = read_saved(saved).map_err(|error| {
            say(format_args!(
                "names from before the restart are lost: {error:#}"
            ));
        });
        let mut names = before.clone().unwrap_or_default();
        names.retain(|person, _| ids.contains(person));
        // Other ids mean other people from now on, also to a fusion started after this one.
        if before.as_ref() != Ok(&names)
            && let Err(error) = save(saved, &names)
        {
            say(format_args!(
                "cannot remove names from before the restart: {error}; delete the file"
            ));
        }
        for (person, name) in names {
            if let Err(error) = self.name(person, &name) {
                say(format_args!("the name of person {person} is lost: {error}"));
            }
        }
    }

    /// Reads edits by other programs such as `farfield people`, and publishes the result.
    pub(super) fn reload(&self) {
        let mut known = self.known();
        let Some(path) = known.files.first().map(|file| file.path().to_owned()) else {
            return;
        };
        if stamp(&path) != known.read
            && let Err(error) = self.take_names(&mut known)
        {
            // Not again until the next change of the file.
            known.read = stamp(&path);
            say(format_args!("the last valid edits stay in use: {error}"));
        }
    }

    /// Fusion identified a person as a subject of the venue. A name set or removed by an operator stays.
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
                    "cannot write the name of person {person} to {path}: {error}"
                ));
            }
        }
        self.take_names(&mut known).unwrap_or_else(|error| {
            say(format_args!("the name of person {person} is lost: {error}"));
        });
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        // A map and a list: valid also if a thread has panicked.
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets or removes the name of a person.
    fn name(&self, person: u32, name: &str) -> Result<(), String> {
        check_name(name)?;
        let mut known = self.known();
        let is_new = !known.by_person.contains_key(&person);
        if is_new && !name.is_empty() && known.by_person.len() >= MAX_NAMES {
            return Err(format!("{MAX_NAMES} people have names already"));
        }
        // A name that cannot be stored is not shown. The first file decides: a name in it is given.
        if let Some((first, others)) = known.files.split_first() {
            add(first, person, name)?;
            for file in others {
                if let Err(error) = add(file, person, name) {
                    let path = file.path().display();
                    say(format_args!(
                        "cannot write the name of person {person} to {path}: {error}"
                    ));
                }
            }
        }
        self.take_names(&mut known)
    }

    /// Reads the names from the edits of the run, publishes and keeps them.
    fn take_names(&self, known: &mut Known) -> Result<(), String> {
        if let Some(file) = known.files.first() {
            // Read first, so that a change in the meantime is seen next time.
            let read = stamp(file.path());
            // Several ids may be one person by the edits.
            let (by_person, people) = named(file).map_err(|error| format!("{error:#}"))?;
            (known.by_person, known.people, known.read) = (by_person, people, read);
        }
        self.publish(known);
        if let Some(saved) = &self.saved
            && let Err(error) = save(saved, &known.by_person)
        {
            say(format_args!(
                "cannot keep names for a restarted fusion: {error}"
            ));
        }
        Ok(())
    }

    fn publish(&self, known: &Known) {
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
            _ => Err("only a live run can be recorded from the page".to_owned()),
        }
    }
}

/// Names by the ids of a run or recording with edits, and the merged and split people.
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

/// Adds a name to the edits. A merged person is named by its final id.
fn add(file: &EditsFile, person: u32, name: &str) -> Result<(), String> {
    let change = |list: &EditList| {
        let identities = list.identities(None).map_err(|fault| fault.to_string())?;
        let whole = identities.whole(person);
        Ok(Change::Name {
            person: whole.ok_or_else(|| {
                format!("person {person} was split or removed: use `farfield people` to name the resulting people")
            })?,
            name: name.to_owned(),
        })
    };
    let added = file.add(&now(), None, change);
    added.map(drop).map_err(|error| {
        let error = anyhow::Error::from(error);
        format!("cannot store the name: {error:#}")
    })
}

/// Adds a name guessed from body proportions, unless an operator ever named the person, or the same guess was added before,
/// even if it was undone.
fn add_guess(file: &EditsFile, person: u32, name: &str) -> Result<(), String> {
    let list = file.read().map_err(|error| error.to_string())?;
    let identities = list.identities(None).map_err(|fault| fault.to_string())?;
    let Some(whole) = identities.whole(person) else {
        return Ok(());
    };
    let is_settled = list.all().any(|(_, edit)| match &edit.change {
        Change::Name { person, .. } => *person == whole,
        Change::Guess {
            person,
            name: guessed,
        } => *person == whole && guessed == name,
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

fn save(path: &Path, names: &BTreeMap<u32, String>) -> Result<(), String> {
    let text = serde_json::to_string(names).map_err(|error| error.to_string())?;
    let written = write_whole_again(path, text.as_bytes());
    written.map_err(|error| format!("writing {}: {error}", path.display()))
}

fn read_saved(path: &Path) -> anyhow::Result<BTreeMap<u32, String>> {
    let reading = || format!("reading {}", path.display());
    let text = match read_text_bounded(path, MOST_KEPT_BYTES) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(BTreeMap::new()),
        text => text.with_context(reading)?,
    };
    serde_json::from_str(&text).with_context(reading)
}

/// Queue of naming sets that wait for the disk. A venue has at most two for each person, and few people per tick.
const QUEUE: usize = 256;

/// Interval of checks for edits by other programs.
const RELOAD_INTERVAL: Duration = Duration::from_secs(1);

/// Passes events of the run on to its names. A separate thread writes files, as a wiretap must not wait.
pub(super) struct NamesTap {
    given: Arc<GivenNames>,
    naming_key: String,
    queue: Option<SyncSender<NamingSet>>,
    thread: Option<JoinHandle<()>>,
}

impl NamesTap {
    /// For the names `given` in a run of `venue`.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn start(venue: &Venue, given: Arc<GivenNames>) -> Result<Self, NodeError> {
        let (queue, namings) = sync_channel(QUEUE);
        let names = Arc::clone(&given);
        let thread = thread::Builder::new()
            .name("names".to_owned())
            .spawn(move || process(&names, &namings))
            .context("starting the thread of names")
            .map_err(NodeError::Failed)?;
        Ok(Self {
            given,
            naming_key: Keys::new(&venue.name).naming(),
            queue: Some(queue),
            thread: Some(thread),
        })
    }
}

/// Runs until the end of the run.
fn process(given: &GivenNames, namings: &Receiver<NamingSet>) {
    loop {
        match namings.recv_timeout(RELOAD_INTERVAL) {
            Ok(set) => set.namings.iter().for_each(|naming| given.guess(naming)),
            Err(RecvTimeoutError::Timeout) => given.reload(),
            Err(RecvTimeoutError::Disconnected) => return,
        }
    }
}

impl Drop for NamesTap {
    /// Waits until all names are written.
    fn drop(&mut self) {
        drop(self.queue.take());
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was printed already.
            drop(thread.join());
        }
    }
}

impl Wiretap for NamesTap {
    fn received(&self, _: CopiedMessage<'_>) {}

    fn published(&self, message: CopiedMessage<'_>) {
        // Fusion has just encoded it, so it can be decoded.
        if message.key == self.naming_key
            && let Ok(set) = wire::decode::<NamingSet>(message.bytes)
            && let Some(queue) = &self.queue
            && let Err(TrySendError::Full(set)) = queue.try_send(set)
        {
            let n = set.namings.len();
            say(format_args!("the disk is too slow: {n} names are lost"));
        }
    }

    fn decided(&self, _: CopiedStep<'_>) {}

    fn recording_begins(&self, path: &Path) {
        self.given.recording_begins(path);
    }

    fn expected(&self, ids: &[u32]) {
        self.given.expected(ids);
    }
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
    fn names_are_stored_with_the_run_and_with_a_later_recording() {
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
        // A page of the recording shows them and can add more.
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
    fn a_name_set_by_hand_has_priority_over_a_guess() {
        let folder = tempfile::tempdir().unwrap();
        let file = EditsFile::of_run(folder.path());
        let given = GivenNames::of_run(folder.path(), None);
        given.guess(&naming(3, "Anna"));
        given.guess(&naming(4, "Bo"));
        assert_eq!(names(&file)[&3], "Anna");
        given.act(&named(3, "Cy")).unwrap();
        given.guess(&naming(3, "Anna"));
        assert_eq!(names(&file)[&3], "Cy");
        // A person unnamed by hand has no name, and an undone guess does not return.
        given.act(&named(5, "Di")).unwrap();
        given.act(&named(5, "")).unwrap();
        given.guess(&naming(5, "Anna"));
        file.add("now", None, |_| Ok(Change::Undo { number: 2 }))
            .unwrap();
        given.guess(&naming(4, "Bo"));
        assert_eq!(names(&file), BTreeMap::from([(3, "Cy".to_owned())]));
        // Of two merged people the name set by hand has priority.
        given.guess(&naming(7, "Eve"));
        file.add("now", None, |_| Ok(Change::Merge { person: 3, into: 7 }))
            .unwrap();
        assert_eq!(names(&file)[&7], "Cy");
    }

    #[test]
    fn edits_by_other_programs_are_reloaded() {
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
        given.reload();
        assert_eq!(given.known().by_person[&4], "Anna");
        assert_eq!(given.known().people.person_at(0, 4), Some(3));
        // An unreadable file changes nothing.
        fs::write(file.path(), "{\n").unwrap();
        given.reload();
        assert_eq!(given.known().by_person.len(), 2);
    }

    #[test]
    fn a_name_that_cannot_be_stored_is_refused() {
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
    fn people_who_keep_their_id_over_a_restart_keep_their_name() {
        let folder = tempfile::tempdir().unwrap();
        let saved = folder.path().join("hall.names.json");
        let runs = ["one", "two", "three"].map(|name| folder.path().join(name));
        for run in &runs {
            fs::create_dir(run).unwrap();
        }
        let first = GivenNames::of_run(&runs[0], Some(saved.clone()));
        for (person, name) in [(3, "Anna"), (4, "Bo")] {
            first.act(&named(person, name)).unwrap();
        }
        let again = GivenNames::of_run(&runs[1], Some(saved.clone()));
        again.expected(&[4, 5]);
        let expected = BTreeMap::from([(4, "Bo".to_owned())]);
        assert_eq!(names(&EditsFile::of_run(&runs[1])), expected);
        // If no people are expected, the ids mean others.
        let anew = GivenNames::of_run(&runs[2], Some(saved));
        anew.act(&named(3, "Cy")).unwrap();
        let expected = BTreeMap::from([(3, "Cy".to_owned())]);
        assert_eq!(names(&EditsFile::of_run(&runs[2])), expected);
    }

    #[test]
    fn names_of_an_earlier_session_are_discarded_when_ids_restart() {
        let folder = tempfile::tempdir().unwrap();
        let saved = folder.path().join("hall.names.json");
        let run = || GivenNames::of_run(folder.path(), Some(saved.clone()));
        run().act(&named(3, "Anna")).unwrap();
        run().expected(&[]);
        assert_eq!(read_saved(&saved).unwrap(), BTreeMap::new());
        fs::remove_file(folder.path().join("edits.jsonl")).unwrap();
        let third = run();
        third.expected(&[3]);
        assert!(third.known().by_person.is_empty());
        fs::write(&saved, "{\"3\": ").unwrap();
        run().expected(&[3]);
        assert_eq!(read_saved(&saved).unwrap(), BTreeMap::new());
    }

    #[test]
    fn a_name_stored_with_the_run_is_given_even_if_other_files_fail() {
        let folder = tempfile::tempdir().unwrap();
        let saved = folder.path().join("hall.names.json");
        // Left by a fusion that was killed while writing.
        fs::write(
            folder
                .path()
                .join(format!("hall.names.json.{}-0.tmp", u32::MAX)),
            "{",
        )
        .unwrap();
        let given = GivenNames::of_run(folder.path(), Some(saved.clone()));
        given.recording_begins(&folder.path().join("nowhere/a.mcap"));
        given.act(&named(3, "Anna")).unwrap();
        let expected = BTreeMap::from([(3, "Anna".to_owned())]);
        assert_eq!(names(&EditsFile::of_run(folder.path())), expected);
        assert_eq!(read_saved(&saved).unwrap(), expected);
        let given = GivenNames::of_run(folder.path(), Some(folder.path().join("nowhere/b.json")));
        given.act(&named(3, "Bo")).unwrap();
        assert_eq!(given.known().by_person[&3], "Bo");
        given.recording_begins(&folder.path().join("nowhere/a.mcap"));
        assert_eq!(given.known().files.len(), 1);
    }
}
