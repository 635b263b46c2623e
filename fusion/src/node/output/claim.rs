//! Where results go: never over something that is already there, and never where another run writes.
//!
//! A run holds a lock on [`LOCK`] for as long as it lives, and so one that was killed is known by a lock that
//! nobody holds: what it has left is made whole before the next run begins.

use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::thread::{JoinHandle, sleep};
use std::time::Duration;

use anyhow::{Context as _, anyhow, ensure};
use farfield_node::process::say;
use tracing::warn;

use super::made_folders::MadeFolders;
use crate::export::salvage::salvage;

/// Where the numbered folders of a venue go when nobody names one.
const PARENT: &str = "farfield-out";
/// The file that says that a run writes here.
const LOCK: &str = "run.lock";
/// How often a lock is tried that whoever looks at it holds for an instant, and what is between two tries.
const TRIES: usize = 40;
const TRY_AGAIN: Duration = Duration::from_millis(5);

/// A folder that one run writes to and no other. Dropped, it is free; what was made for the run, folders above it too, is
/// taken away where it is empty.
#[derive(Debug)]
pub struct FolderClaim {
    folder: PathBuf,
    holder: Holder,
    /// Held together by a run and the nodes that it has started; `None` where the file system has no locks.
    lock: Option<File>,
    /// Makes whole what killed runs have left.
    salvage: Option<JoinHandle<()>>,
    /// Those that were not there.
    _made: MadeFolders,
}

/// Who frees a folder in the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Holder {
    /// This process.
    Taker,
    /// The process that started this one.
    Parent,
}

impl FolderClaim {
    /// Claims `asked`, or without it the first `farfield-out/<venue>-<n>`, n from 1, that nobody has. What
    /// runs have left there that were killed is made whole.
    ///
    /// # Errors
    /// When `asked` holds something, is a file, is claimed, or a folder cannot be made: names it.
    pub fn take(asked: Option<&Path>, venue: &str) -> anyhow::Result<Self> {
        let Some(asked) = asked else {
            return Self::numbered(Path::new(PARENT), venue);
        };
        let parent = asked.parent().unwrap_or(Path::new(""));
        let mut made = MadeFolders::with_parents(parent)?;
        made.make(asked)?;
        let mut claim = lock(asked, made)?;
        claim.salvage_beside(parent, venue);
        Ok(claim)
    }

    /// The folder that the process which started this one has claimed for it.
    pub(in crate::node) fn of_parent(folder: PathBuf) -> Self {
        // Where the parent dies first the folder is still written to.
        let lock = File::open(folder.join(LOCK)).ok();
        Self {
            lock: lock.filter(|lock| lock.try_lock_shared().is_ok()),
            salvage: None,
            folder,
            holder: Holder::Parent,
            _made: MadeFolders::default(),
        }
    }

    fn numbered(parent: &Path, venue: &str) -> anyhow::Result<Self> {
        let mut made = MadeFolders::with_parents(parent)?;
        for n in 1..u32::MAX {
            let folder = parent.join(format!("{venue}-{n}"));
            if made.make(&folder)? {
                let mut claim = lock(&folder, made)?;
                claim.salvage_beside(parent, venue);
                return Ok(claim);
            }
        }
        Err(anyhow!("{} is full", parent.display()))
    }

    /// Makes whole, on a thread that nobody waits for, what killed runs of `venue` have left in `parent`: of a long run
    /// that is gigabytes to read. What the thread does not get done the next run does.
    fn salvage_beside(&mut self, parent: &Path, venue: &str) {
        let parent = if parent.as_os_str().is_empty() {
            PathBuf::from(".")
        } else {
            parent.to_owned()
        };
        let venue = venue.to_owned();
        let thread = std::thread::Builder::new().name("salvage".to_owned());
        match thread.spawn(move || finish_killed(&parent, &venue)) {
            Ok(thread) => self.salvage = Some(thread),
            Err(error) => warn!(%error, "what killed runs have left stays as it is"),
        }
    }

    /// Waits until all that killed runs have left is whole.
    #[cfg(test)]
    fn wait_for_salvage(&mut self) {
        self.salvage.take().unwrap().join().unwrap();
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Makes whole what a node has left that was killed. Does nothing while one still writes.
    pub fn salvage(&self) {
        // Only who holds it alone gets more than it has.
        let is_alone = |lock: &File| lock.try_lock().is_ok();
        if self.lock.as_ref().is_none_or(is_alone) {
            make_whole(&self.folder);
        }
    }
}

impl Drop for FolderClaim {
    fn drop(&mut self) {
        if self.holder == Holder::Parent {
            return;
        }
        if let Err(error) = fs::remove_file(self.folder.join(LOCK)) {
            warn!(folder = %self.folder.display(), %error, "the folder stays locked");
        }
    }
}

/// Of two runs that come to the same folder at once, one makes the file. What was `made` for the folder goes with the claim.
fn lock(folder: &Path, made: MadeFolders) -> anyhow::Result<FolderClaim> {
    check_folder(folder)?;
    let path = folder.join(LOCK);
    let file = match File::create_new(&path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Err(taken(folder)),
        opened => opened.with_context(|| format!("making {}", path.display()))?,
    };
    let lock = match hold(&file) {
        Ok(()) => Some(file),
        // Somebody takes it for that of a killed run, and takes it away.
        Err(TryLockError::WouldBlock) => return Err(taken(folder)),
        Err(TryLockError::Error(_)) => None,
    };
    let claim = FolderClaim {
        folder: folder.to_owned(),
        holder: Holder::Taker,
        lock,
        salvage: None,
        _made: made,
    };
    // Another run may have come and gone since the folder was looked at, or have found the lock unheld.
    ensure!(path.exists(), taken(folder));
    ensure!(
        holds_only(folder, LOCK)?,
        "output folder {} is not empty: name another, or empty it first",
        folder.display()
    );
    Ok(claim)
}

/// Takes a lock that was just made, also where somebody looks at this moment whether it is held ([`is_written_to`]).
fn hold(lock: &File) -> Result<(), TryLockError> {
    for _ in 1..TRIES {
        match lock.try_lock_shared() {
            Err(TryLockError::WouldBlock) => sleep(TRY_AGAIN),
            tried => return tried,
        }
    }
    lock.try_lock_shared()
}

/// Refuses a folder that holds something, and a path that is not a folder. Makes nothing; what a run has left
/// in it that was killed is made whole.
///
/// # Errors
/// Names the path and what is wrong with it.
pub fn check_folder(path: &Path) -> anyhow::Result<()> {
    if !path.exists() {
        return Ok(());
    }
    let shown = path.display();
    ensure!(
        path.is_dir(),
        "output {shown}: found a file, expected a folder"
    );
    let was_killed = release(path);
    if path.join(LOCK).exists() {
        return Err(taken(path));
    }
    let is_empty = holds_only(path, LOCK)?;
    ensure!(
        is_empty || !was_killed,
        "output folder {shown} is not empty: it holds the results of a run that was killed, which are whole now; \
         name another"
    );
    ensure!(
        is_empty,
        "output folder {shown} is not empty: name another, or empty it first"
    );
    Ok(())
}

/// Whether a run writes to `folder` now: one that was killed holds its lock no more. Where the file system has no locks, one
/// that is there counts.
pub fn is_written_to(folder: &Path) -> bool {
    let lock = File::open(folder.join(LOCK));
    lock.is_ok_and(|lock| lock.try_lock().is_err())
}

/// Whether a run that was killed has left its lock in `folder`: what it has written there is still to be made whole.
pub fn was_killed(folder: &Path) -> bool {
    folder.join(LOCK).exists() && !is_written_to(folder)
}

/// Makes whole what runs of `venue` have left in their numbered folders in `parent` that were killed.
fn finish_killed(parent: &Path, venue: &str) {
    let Ok(entries) = parent.read_dir() else {
        // A folder that cannot be read is told of by who wants to write there.
        return;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let number = name.to_str().and_then(|name| name.strip_prefix(venue));
        let number = number.and_then(|rest| rest.strip_prefix('-'));
        let is_ours = number.is_some_and(|number| number.parse::<u32>().is_ok());
        // A folder with nothing but its lock may be that of a run which is just about to hold it.
        if is_ours && !holds_only(&entry.path(), LOCK).unwrap_or(true) {
            release(&entry.path());
        }
    }
}

/// Makes `folder` whole, and frees it, where the run was killed that had claimed it; says whether there was
/// one.
fn release(folder: &Path) -> bool {
    let path = folder.join(LOCK);
    let Ok(lock) = File::open(&path) else {
        return false;
    };
    // Held while the files are made whole: two that begin at once do not get into each other's way.
    if lock.try_lock().is_err() || !path.exists() {
        return false;
    }
    if !make_whole(folder) {
        return false;
    }
    if let Err(error) = fs::remove_file(&path) {
        warn!(folder = %folder.display(), %error, "the folder stays locked");
    }
    true
}

/// Says which files have become whole; whether all have.
fn make_whole(folder: &Path) -> bool {
    match salvage(folder) {
        Ok(files) if files.is_empty() => true,
        Ok(files) => {
            say(format_args!(
                "{}: the run that wrote here was killed; {} files that it left are whole now",
                folder.display(),
                files.len()
            ));
            true
        }
        Err(error) => {
            say(format_args!(
                "{}: what a killed run has left here is not whole: {error}",
                folder.display()
            ));
            false
        }
    }
}

fn taken(folder: &Path) -> anyhow::Error {
    anyhow!(
        "output folder {} is not empty: another run writes to it ({LOCK})",
        folder.display()
    )
}

fn holds_only(folder: &Path, name: &str) -> anyhow::Result<bool> {
    let reading = || format!("reading output folder {}", folder.display());
    for entry in folder.read_dir().with_context(reading)? {
        if entry.with_context(reading)?.file_name() != name {
            return Ok(false);
        }
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(path: &Path) -> String {
        FolderClaim::take(Some(path), "hall")
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn only_an_empty_or_missing_folder_is_taken() {
        let dir = tempfile::tempdir().unwrap();
        let empty = dir.path().join("empty");
        fs::create_dir(&empty).unwrap();
        drop(FolderClaim::take(Some(&empty), "hall").unwrap());
        assert!(empty.exists(), "a folder that was there stays");
        let deeper = dir.path().join("new/deeper");
        drop(FolderClaim::take(Some(&deeper), "hall").unwrap());
        let above = deeper.parent().unwrap();
        assert!(!above.exists(), "folders that were made go when empty");
        let file = dir.path().join("file");
        fs::write(&file, "x").unwrap();
        assert!(refused(&file).contains("found a file"));
        fs::write(empty.join("poses.jsonl.tmp"), "x").unwrap();
        assert!(refused(&empty).contains("not empty"));
        assert_eq!(fs::read_dir(&empty).unwrap().count(), 1);
    }

    #[test]
    fn two_runs_never_share_a_folder() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let first = FolderClaim::take(Some(&out), "hall").unwrap();
        assert!(refused(&out).contains("another run"));
        fs::write(out.join("poses.jsonl"), "x").unwrap();
        drop(first);
        assert!(refused(&out).contains("name another"));
        assert!(!out.join(LOCK).exists());
    }

    #[test]
    fn a_folder_is_written_to_while_its_run_lives() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        assert!(!is_written_to(&out));
        let run = FolderClaim::take(Some(&out), "hall").unwrap();
        let node = FolderClaim::of_parent(out.clone());
        assert!(is_written_to(&out));
        drop((run, node));
        assert!(!is_written_to(&out));
        assert!(!was_killed(&out));
        killed(&out);
        assert!(!is_written_to(&out), "its lock is there, and nobody's");
        assert!(was_killed(&out));
    }

    #[test]
    fn a_run_that_begins_is_not_held_up_by_who_looks_whether_one_does() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(LOCK);
        let lock = File::create_new(&path).unwrap();
        let looks = File::open(&path).unwrap();
        looks.try_lock().unwrap();
        let looking = std::thread::spawn(move || drop(looks));
        hold(&lock).unwrap();
        looking.join().unwrap();
    }

    /// What a run leaves that is killed at its second tick: its lock dies with it.
    fn killed(folder: &Path) {
        fs::create_dir_all(folder).unwrap();
        fs::write(folder.join(LOCK), "").unwrap();
        fs::write(folder.join("poses.jsonl.tmp"), "{\"tick\":1}\n{\"ti").unwrap();
    }

    fn poses(folder: &Path) -> String {
        fs::read_to_string(folder.join("poses.jsonl")).unwrap()
    }

    #[test]
    fn what_killed_runs_of_the_venue_left_is_whole_when_the_next_begins() {
        let dir = tempfile::tempdir().unwrap();
        let folder = |name: &str| dir.path().join(name);
        for name in ["hall-1", "hall-3", "hall-3-1"] {
            killed(&folder(name));
        }
        let mut running = FolderClaim::numbered(dir.path(), "hall").unwrap();
        assert_eq!(running.folder(), folder("hall-2"));
        running.wait_for_salvage();
        for name in ["hall-1", "hall-3"] {
            assert_eq!(poses(&folder(name)), "{\"tick\":1}\n");
            assert_eq!(fs::read_dir(folder(name)).unwrap().count(), 1, "no lock");
        }
        assert!(folder("hall-3-1").join(LOCK).exists(), "another venue's");
        fs::write(running.folder().join("poses.jsonl.tmp"), "half").unwrap();
        let mut next = FolderClaim::take(Some(&folder("named")), "hall").unwrap();
        next.wait_for_salvage();
        let half = fs::read_to_string(running.folder().join("poses.jsonl.tmp")).unwrap();
        assert_eq!(half, "half", "a run that lives is left alone");
        drop((running, next));
    }

    #[test]
    fn a_named_folder_of_a_killed_run_is_made_whole_and_refused() {
        let dir = tempfile::tempdir().unwrap();
        killed(dir.path());
        let said = refused(dir.path());
        assert!(
            said.contains("killed") && said.contains("whole now"),
            "{said}"
        );
        assert_eq!(poses(dir.path()), "{\"tick\":1}\n");
        assert!(refused(dir.path()).contains("name another, or empty it"));
        let empty = dir.path().join("empty");
        fs::create_dir(&empty).unwrap();
        fs::write(empty.join(LOCK), "").unwrap();
        drop(FolderClaim::take(Some(&empty), "hall").unwrap());
    }

    #[test]
    fn a_folder_is_held_by_the_nodes_of_a_run_that_was_killed_itself() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let run = FolderClaim::take(Some(&out), "hall").unwrap();
        let node = FolderClaim::of_parent(out.clone());
        fs::write(out.join("poses.jsonl.tmp"), "{}\n").unwrap();
        run.salvage();
        assert!(
            out.join("poses.jsonl.tmp").exists(),
            "the node may still write"
        );
        // Killed, it takes nothing away.
        let FolderClaim { lock, .. } = &mut *std::mem::ManuallyDrop::new(run);
        drop(lock.take());
        assert!(refused(&out).contains("another run"));
        drop(node);
        assert!(refused(&out).contains("whole now"));
    }

    #[test]
    fn folders_that_nobody_names_are_numbered() {
        let dir = tempfile::tempdir().unwrap();
        let [first, second] = [1, 2].map(|_| FolderClaim::numbered(dir.path(), "hall").unwrap());
        assert_eq!(first.folder(), dir.path().join("hall-1"));
        assert_eq!(second.folder(), dir.path().join("hall-2"));
    }

    #[test]
    fn a_run_that_is_refused_leaves_not_even_the_folder_of_all_runs() {
        let dir = tempfile::tempdir().unwrap();
        let parent = dir.path().join("farfield-out");
        let [first, second] = [1, 2].map(|_| FolderClaim::numbered(&parent, "hall").unwrap());
        fs::write(second.folder().join("poses.jsonl"), "x").unwrap();
        drop(first);
        assert!(!parent.join("hall-1").exists() && parent.join("hall-2").is_dir());
        drop(second);
        assert!(parent.join("hall-2/poses.jsonl").is_file());
        let of_other = dir.path().join("others");
        drop(FolderClaim::numbered(&of_other, "hall").unwrap());
        assert!(!of_other.exists());
    }
}
