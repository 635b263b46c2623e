//! A folder of keys: keys are for their owner alone, and nothing is written over.

use std::fs::{self, DirBuilder, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;

use super::authority::Pair;

/// The authority's certificate.
pub(super) const AUTHORITY: &str = "ca.pem";
/// Readable by all, writable by the owner.
const PUBLIC: u32 = 0o644;
/// For the owner alone.
const SECRET: u32 = 0o600;
const SECRET_FOLDER: u32 = 0o700;

/// A folder of keys.
pub(super) struct Folder {
    path: PathBuf,
}

impl Folder {
    pub(super) fn new(path: &Path) -> Self {
        Self {
            path: path.to_owned(),
        }
    }

    /// Refuses the first of `names` that is there already.
    pub(super) fn check_free(&self, names: &[String]) -> anyhow::Result<()> {
        let taken = names.iter().map(|name| self.path.join(name));
        let taken = taken
            .into_iter()
            .find(|path| path.symlink_metadata().is_ok());
        taken.map_or(Ok(()), |path| {
            Err(anyhow::anyhow!(
                "{} is there already, and keys are not written over: choose another folder, or issue a node's key again with --renew NODE",
                path.display()
            ))
        })
    }

    pub(super) fn make(&self) -> anyhow::Result<()> {
        fs::create_dir_all(&self.path)
            .with_context(|| format!("making the folder {}", self.path.display()))
    }

    /// Makes it for its owner alone, unless it is there.
    pub(super) fn make_secret(&self) -> anyhow::Result<()> {
        let made = DirBuilder::new()
            .recursive(true)
            .mode(SECRET_FOLDER)
            .create(&self.path);
        made.with_context(|| format!("making the folder {}", self.path.display()))
    }

    /// The text of `name`; `None` where there is no such file.
    pub(super) fn read_if_there(&self, name: &str) -> anyhow::Result<Option<String>> {
        match self.path.join(name).try_exists() {
            Ok(false) => Ok(None),
            _ => self.read(name).map(Some),
        }
    }

    pub(super) fn read(&self, name: &str) -> anyhow::Result<String> {
        let path = self.path.join(name);
        fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))
    }

    /// A file that all may read, still to be written.
    pub(super) fn public<'a>(&self, name: &str, text: &'a str) -> NewFile<'a> {
        self.file(name, text, PUBLIC)
    }

    /// A file for its owner alone, still to be written.
    pub(super) fn secret<'a>(&self, name: &str, text: &'a str) -> NewFile<'a> {
        self.file(name, text, SECRET)
    }

    /// A node's key and certificate, still to be written.
    pub(super) fn pair<'a>(&self, node: &str, pair: &'a Pair) -> [NewFile<'a>; 2] {
        [
            self.secret(&format!("{node}.key"), &pair.key),
            self.public(&format!("{node}.pem"), &pair.certificate),
        ]
    }

    fn file<'a>(&self, name: &str, text: &'a str, mode: u32) -> NewFile<'a> {
        NewFile {
            path: self.path.join(name),
            new: self.path.join(format!("{name}.new")),
            text,
            mode,
        }
    }
}

/// A file that is to get its name together with others.
pub(super) struct NewFile<'a> {
    path: PathBuf,
    /// What it is called until all are whole.
    new: PathBuf,
    text: &'a str,
    mode: u32,
}

/// What becomes of files that are there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Old {
    /// There are none: what is made is taken away again when not all can be made.
    None,
    /// They are replaced; a node that reads meanwhile finds whole files.
    Replaced,
}

/// Writes all of `files` to the disk, and only then gives them their names.
///
/// # Errors
/// When one cannot be written; none is there then, but of those that were replaced some may be new.
pub(super) fn write_together(files: &[NewFile<'_>], old: Old) -> anyhow::Result<()> {
    let written = files.iter().try_for_each(NewFile::write);
    let mut named = 0;
    let done = written.and_then(|()| {
        files.iter().try_for_each(|file| {
            fs::rename(&file.new, &file.path)
                .with_context(|| format!("writing {}", file.path.display()))?;
            named += 1;
            Ok(())
        })
    });
    if done.is_err() {
        for file in files {
            // What was not made cannot be taken away.
            drop(fs::remove_file(&file.new));
        }
        let taken_away = files.iter().take(named).filter(|_| old == Old::None);
        taken_away.for_each(|file| drop(fs::remove_file(&file.path)));
    }
    done
}

impl NewFile<'_> {
    fn write(&self) -> anyhow::Result<()> {
        // What an earlier, interrupted run has left.
        drop(fs::remove_file(&self.new));
        let open = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(self.mode)
            .open(&self.new);
        open.and_then(|mut file| {
            file.write_all(self.text.as_bytes())?;
            file.sync_all()
        })
        .with_context(|| format!("writing {}", self.path.display()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let name = |entry: fs::DirEntry| entry.file_name().into_string().unwrap();
        let mut names: Vec<String> = entries.map(|entry| name(entry.unwrap())).collect();
        names.sort();
        names
    }

    #[test]
    fn keys_that_cannot_all_be_made_leave_nothing_that_refuses_the_next_run() {
        let dir = tempfile::tempdir().unwrap();
        let folder = Folder::new(dir.path());
        let files = || {
            [
                folder.public("ca.pem", "a"),
                folder.secret("fusion.key", "k"),
                folder.public("fusion.pem", "c"),
            ]
        };
        // A folder of that name cannot be replaced by a file.
        fs::create_dir_all(dir.path().join("fusion.pem/in the way")).unwrap();
        assert!(write_together(&files(), Old::None).is_err());
        assert_eq!(names(dir.path()), ["fusion.pem"]);
        fs::remove_dir_all(dir.path().join("fusion.pem")).unwrap();
        // Nor can one be written where a folder has its first name.
        fs::create_dir_all(dir.path().join("fusion.pem.new/in the way")).unwrap();
        assert!(write_together(&files(), Old::None).is_err());
        assert_eq!(names(dir.path()), ["fusion.pem.new"]);
        fs::remove_dir_all(dir.path().join("fusion.pem.new")).unwrap();
        // What a run that was killed has left is no obstacle.
        fs::write(dir.path().join("ca.pem.new"), "half").unwrap();
        write_together(&files(), Old::None).unwrap();
        assert_eq!(names(dir.path()), ["ca.pem", "fusion.key", "fusion.pem"]);
        assert_eq!(folder.read("ca.pem").unwrap(), "a");
    }
}
