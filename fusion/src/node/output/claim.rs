//! Where results go: never over something that is already there, and never where another run writes.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use tracing::warn;

/// Where the numbered folders of a venue go when nobody names one.
const PARENT: &str = "farfield-out";
/// The file that says that a run writes here.
const LOCK: &str = "run.lock";

/// A folder that one run writes to and no other. Dropped, it is free; what the run made and left empty
/// is taken away.
#[derive(Debug)]
pub struct FolderClaim {
    folder: PathBuf,
    holder: Holder,
}

/// Who frees a folder in the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Holder {
    /// This process, which has also made the folder.
    Maker,
    /// This process, which has found the folder empty.
    Finder,
    /// The process that started this one.
    Parent,
}

impl FolderClaim {
    /// Claims `asked`, or without it the first `farfield-out/<venue>-<n>`, n from 1, that nobody has.
    ///
    /// # Errors
    /// When `asked` holds something, is a file, is claimed, or a folder cannot be made: names it.
    pub fn take(asked: Option<&Path>, venue: &str) -> anyhow::Result<Self> {
        let Some(asked) = asked else {
            return Self::numbered(Path::new(PARENT), venue);
        };
        if let Some(parent) = asked.parent() {
            make_folder(parent)?;
        }
        match make_new(asked)? {
            Some(claim) => Ok(claim),
            None => lock(asked, Holder::Finder),
        }
    }

    /// The folder that the process which started this one has claimed for it.
    pub(in crate::node) fn of_parent(folder: PathBuf) -> Self {
        Self {
            folder,
            holder: Holder::Parent,
        }
    }

    fn numbered(parent: &Path, venue: &str) -> anyhow::Result<Self> {
        make_folder(parent)?;
        for n in 1..u32::MAX {
            if let Some(claim) = make_new(&parent.join(format!("{venue}-{n}")))? {
                return Ok(claim);
            }
        }
        Err(anyhow!("{} is full", parent.display()))
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
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
        if self.holder == Holder::Maker {
            // Fails where there are results, and then is not wanted.
            drop(fs::remove_dir(&self.folder));
        }
    }
}

/// Makes and claims `folder`; `None` when it is there already.
fn make_new(folder: &Path) -> anyhow::Result<Option<FolderClaim>> {
    match fs::create_dir(folder) {
        Ok(()) => lock(folder, Holder::Maker).map(Some),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(None),
        Err(error) => Err(error).with_context(|| making(folder)),
    }
}

/// Of two runs that come to the same folder at once, one makes the file.
fn lock(folder: &Path, holder: Holder) -> anyhow::Result<FolderClaim> {
    check_folder(folder)?;
    let path = folder.join(LOCK);
    match File::create_new(&path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => return Err(taken(folder)),
        made => drop(made.with_context(|| format!("making {}", path.display()))?),
    }
    let claim = FolderClaim {
        folder: folder.to_owned(),
        holder,
    };
    // Another run may have come and gone since the folder was looked at.
    ensure!(
        holds_only(folder, LOCK)?,
        "output folder {} is not empty: name another, or empty it first",
        folder.display()
    );
    Ok(claim)
}

/// Refuses a folder that holds something, and a path that is not a folder. Makes nothing.
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
    if path.join(LOCK).exists() {
        return Err(taken(path));
    }
    ensure!(
        holds_only(path, LOCK)?,
        "output folder {shown} is not empty: name another, or empty it first"
    );
    Ok(())
}

fn taken(folder: &Path) -> anyhow::Error {
    anyhow!(
        "output folder {} is not empty: another run writes to it, or was killed and left {LOCK} there",
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

fn make_folder(path: &Path) -> anyhow::Result<()> {
    if path.as_os_str().is_empty() {
        return Ok(());
    }
    fs::create_dir_all(path).with_context(|| making(path))
}

fn making(folder: &Path) -> String {
    format!("making output folder {}", folder.display())
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
        assert!(!deeper.exists(), "a folder that was made goes when empty");
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
    fn folders_that_nobody_names_are_numbered() {
        let dir = tempfile::tempdir().unwrap();
        let [first, second] = [1, 2].map(|_| FolderClaim::numbered(dir.path(), "hall").unwrap());
        assert_eq!(first.folder(), dir.path().join("hall-1"));
        assert_eq!(second.folder(), dir.path().join("hall-2"));
    }
}
