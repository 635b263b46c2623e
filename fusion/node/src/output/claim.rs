//! The folder of the results: never over existing files, and never where another run writes.
//!
//! A run holds a lock on [`LOCK`] while it lives. A killed run has left the file without a lock; its files are completed before
//! the next run begins.

use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::thread::{JoinHandle, sleep};
use std::time::Duration;

use anyhow::{Context as _, anyhow, ensure};
use farfield_fusion::export::salvage::salvage;
use farfield_node::process::say;
use tracing::warn;

use super::made_folders::MadeFolders;

/// The parent of a venue's numbered folders, used if no folder is given.
const PARENT: &str = "farfield-out";
/// The lock file of a folder that a run writes to.
const LOCK: &str = "run.lock";
/// Attempts to take a lock that a checking process holds for an instant, and their interval.
const LOCK_ATTEMPTS: usize = 40;
const LOCK_RETRY: Duration = Duration::from_millis(5);

/// A folder that exactly one run writes to. Dropping it frees the folder, and removes the folders that were created for it if
/// they are empty.
#[derive(Debug)]
pub struct FolderClaim {
    folder: PathBuf,
    holder: Holder,
    /// Shared by a run and the nodes that it has started; `None` if the file system has no locks.
    lock: Option<File>,
    /// The thread that completes the files of killed runs.
    salvage: Option<JoinHandle<()>>,
    /// The folders that were created.
    _made: MadeFolders,
}

/// The process that frees the folder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Holder {
    /// This process.
    Taker,
    /// The process that started this one.
    Parent,
}

impl FolderClaim {
    /// Claims `requested`, or by default the first free `farfield-out/<venue>-<n>`, n from 1. Files of killed runs there are
    /// completed.
    ///
    /// # Errors
    /// `requested` is not empty, is a file or is claimed, or a folder cannot be created. The error names it.
    pub fn take(requested: Option<&Path>, venue: &str) -> anyhow::Result<Self> {
        let Some(requested) = requested else {
            return Self::numbered(Path::new(PARENT), venue);
        };
        let parent = requested.parent().unwrap_or(Path::new(""));
        let mut made = MadeFolders::with_parents(parent)?;
        made.make(requested)?;
        let mut claim = lock(requested, made)?;
        claim.salvage_in(parent, venue);
        Ok(claim)
    }

    /// The folder that the parent process has claimed for this one.
    pub(crate) fn of_parent(folder: PathBuf) -> Self {
        // If the parent dies first, this node still writes to the folder.
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
                claim.salvage_in(parent, venue);
                return Ok(claim);
            }
        }
        Err(anyhow!("{} is full", parent.display()))
    }

    /// Completes the files of killed runs of `venue` in `parent`, on a thread that delays no one: a long run may have left
    /// gigabytes. The next run continues what the thread does not finish.
    fn salvage_in(&mut self, parent: &Path, venue: &str) {
        let parent = if parent.as_os_str().is_empty() {
            PathBuf::from(".")
        } else {
            parent.to_owned()
        };
        let venue = venue.to_owned();
        let thread = std::thread::Builder::new().name("salvage".to_owned());
        match thread.spawn(move || finish_killed(&parent, &venue)) {
            Ok(thread) => self.salvage = Some(thread),
            Err(error) => warn!(%error, "files of killed runs are not completed"),
        }
    }

    /// Waits until the files of killed runs are complete.
    #[cfg(test)]
    fn wait_for_salvage(&mut self) {
        self.salvage.take().unwrap().join().unwrap();
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Completes the files of a killed node. Does nothing while a node still writes.
    pub fn salvage(&self) {
        // Only the sole holder can take the exclusive lock.
        let is_alone = |lock: &File| lock.try_lock().is_ok();
        if self.lock.as_ref().is_none_or(is_alone) {
            complete(&self.folder);
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

/// Creates and locks the lock file; of two simultaneous runs only one succeeds. The claim also removes the folders `made`.
fn lock(folder: &Path, made: MadeFolders) -> anyhow::Result<FolderClaim> {
    check_folder(folder)?;
    let path = folder.join(LOCK);
    let file = match File::create_new(&path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Err(taken(folder)),
        opened => opened.with_context(|| format!("making {}", path.display()))?,
    };
    let lock = match take_shared(&file) {
        Ok(()) => Some(file),
        // Another run takes it for the lock of a killed run, and removes it.
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
    // Another run may have come and gone since the check, or have found the file before it was locked.
    ensure!(path.exists(), taken(folder));
    ensure!(
        holds_only(folder, LOCK)?,
        "output folder {} is not empty: name another, or empty it first",
        folder.display()
    );
    Ok(claim)
}

/// Takes the lock of a new file, also while another process checks it ([`is_written_to`]).
fn take_shared(lock: &File) -> Result<(), TryLockError> {
    for _ in 1..LOCK_ATTEMPTS {
        match lock.try_lock_shared() {
            Err(TryLockError::WouldBlock) => sleep(LOCK_RETRY),
            tried => return tried,
        }
    }
    lock.try_lock_shared()
}

/// Refuses a folder that is not empty, and a path that is no folder. Creates nothing, but completes the files of a killed run.
///
/// # Errors
/// Names the path and its fault.
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
        "output folder {shown} is not empty: it contains the results of a killed run, which are complete now; \
         name another"
    );
    ensure!(
        is_empty,
        "output folder {shown} is not empty: name another, or empty it first"
    );
    Ok(())
}

/// Whether a run writes to `folder` now: a killed run no longer holds its lock. If the file system has no locks, the lock file
/// itself counts.
pub fn is_written_to(folder: &Path) -> bool {
    let lock = File::open(folder.join(LOCK));
    lock.is_ok_and(|lock| lock.try_lock().is_err())
}

/// Whether a killed run has left its lock file in `folder`: its files are not completed yet.
pub fn was_killed(folder: &Path) -> bool {
    folder.join(LOCK).exists() && !is_written_to(folder)
}

/// Completes the files of killed runs of `venue` in their numbered folders in `parent`.
fn finish_killed(parent: &Path, venue: &str) {
    let Ok(entries) = parent.read_dir() else {
        // An unreadable folder is reported by the run that wants to write there.
        return;
    };
    for entry in entries.flatten() {
        let name = entry.file_name();
        let number = name.to_str().and_then(|name| name.strip_prefix(venue));
        let number = number.and_then(|rest| rest.strip_prefix('-'));
        let is_ours = number.is_some_and(|number| number.parse::<u32>().is_ok());
        // A folder with only a lock file may belong to a run that is about to lock it.
        if is_ours && !holds_only(&entry.path(), LOCK).unwrap_or(true) {
            release(&entry.path());
        }
    }
}

/// Completes the files in `folder` and frees it if its run was killed. Returns whether there was such a run.
fn release(folder: &Path) -> bool {
    let path = folder.join(LOCK);
    let Ok(lock) = File::open(&path) else {
        return false;
    };
    // The lock is held during completion, so that two starting runs do not interfere.
    if lock.try_lock().is_err() || !path.exists() {
        return false;
    }
    if !complete(folder) {
        return false;
    }
    if let Err(error) = fs::remove_file(&path) {
        warn!(folder = %folder.display(), %error, "the folder stays locked");
    }
    true
}

/// Completes the files in `folder` and reports it; returns whether all are complete.
fn complete(folder: &Path) -> bool {
    match salvage(folder) {
        Ok(files) if files.is_empty() => true,
        Ok(files) => {
            say(format_args!(
                "{}: the run that wrote here was killed; {} of its files were completed",
                folder.display(),
                files.len()
            ));
            true
        }
        Err(error) => {
            say(format_args!(
                "{}: the files of a killed run cannot be completed: {error}",
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
        assert!(empty.exists(), "an existing folder stays");
        let deeper = dir.path().join("new/deeper");
        drop(FolderClaim::take(Some(&deeper), "hall").unwrap());
        let above = deeper.parent().unwrap();
        assert!(!above.exists(), "created folders are removed if empty");
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
        assert!(!is_written_to(&out), "the lock file is not locked");
        assert!(was_killed(&out));
    }

    #[test]
    fn a_check_of_the_lock_does_not_stop_a_starting_run() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(LOCK);
        let lock = File::create_new(&path).unwrap();
        let checked = File::open(&path).unwrap();
        checked.try_lock().unwrap();
        let check = std::thread::spawn(move || drop(checked));
        take_shared(&lock).unwrap();
        check.join().unwrap();
    }

    /// Creates the files that a run leaves if it is killed at its second tick. Its lock ends with it.
    fn killed(folder: &Path) {
        fs::create_dir_all(folder).unwrap();
        fs::write(folder.join(LOCK), "").unwrap();
        fs::write(folder.join("poses.jsonl.tmp"), "{\"tick\":1}\n{\"ti").unwrap();
    }

    fn poses(folder: &Path) -> String {
        fs::read_to_string(folder.join("poses.jsonl")).unwrap()
    }

    #[test]
    fn files_of_killed_runs_of_the_venue_are_completed_by_the_next() {
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
        assert!(folder("hall-3-1").join(LOCK).exists(), "another venue");
        fs::write(running.folder().join("poses.jsonl.tmp"), "half").unwrap();
        let mut next = FolderClaim::take(Some(&folder("named")), "hall").unwrap();
        next.wait_for_salvage();
        let half = fs::read_to_string(running.folder().join("poses.jsonl.tmp")).unwrap();
        assert_eq!(half, "half", "a running run is not changed");
        drop((running, next));
    }

    #[test]
    fn a_named_folder_of_a_killed_run_is_completed_and_refused() {
        let dir = tempfile::tempdir().unwrap();
        killed(dir.path());
        assert!(refused(dir.path()).contains("killed run"));
        assert_eq!(poses(dir.path()), "{\"tick\":1}\n");
        assert!(refused(dir.path()).contains("or empty it"));
        let empty = dir.path().join("empty");
        fs::create_dir(&empty).unwrap();
        fs::write(empty.join(LOCK), "").unwrap();
        drop(FolderClaim::take(Some(&empty), "hall").unwrap());
    }

    #[test]
    fn the_nodes_of_a_killed_run_still_hold_its_folder() {
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
        // A killed process removes nothing.
        let FolderClaim { lock, .. } = &mut *std::mem::ManuallyDrop::new(run);
        drop(lock.take());
        assert!(refused(&out).contains("another run"));
        drop(node);
        assert!(refused(&out).contains("killed run"));
    }

    #[test]
    fn unnamed_folders_are_numbered() {
        let dir = tempfile::tempdir().unwrap();
        let [first, second] = [1, 2].map(|_| FolderClaim::numbered(dir.path(), "hall").unwrap());
        assert_eq!(first.folder(), dir.path().join("hall-1"));
        assert_eq!(second.folder(), dir.path().join("hall-2"));
    }

    #[test]
    fn a_refused_run_leaves_no_folder() {
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
