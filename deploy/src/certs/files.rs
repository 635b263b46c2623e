//! A folder of keys: private keys are readable only by their owner, and no file is overwritten.

use std::fs::{self, DirBuilder, OpenOptions};
use std::io::Write as _;
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_proto::venue::Venue;

use super::authority::{Bearer, NodeRole, Pair};

/// The authority's certificate.
pub(super) const AUTHORITY: &str = "ca.pem";
/// Readable by all, writable by the owner.
const PUBLIC: u32 = 0o644;
/// Only for the owner.
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

    /// Refuses the first of `names` that exists.
    pub(super) fn check_free(&self, names: &[String]) -> anyhow::Result<()> {
        let taken = names.iter().map(|name| self.path.join(name));
        let taken = taken
            .into_iter()
            .find(|path| path.symlink_metadata().is_ok());
        taken.map_or(Ok(()), |path| {
            Err(anyhow::anyhow!(
                "{} already exists, and keys are not overwritten: choose another folder, or replace the key of a node with --renew NODE",
                path.display()
            ))
        })
    }

    pub(super) fn make(&self) -> anyhow::Result<()> {
        fs::create_dir_all(&self.path)
            .with_context(|| format!("creating the folder {}", self.path.display()))
    }

    /// Creates it, readable only by its owner, unless it exists.
    pub(super) fn make_secret(&self) -> anyhow::Result<()> {
        let made = DirBuilder::new()
            .recursive(true)
            .mode(SECRET_FOLDER)
            .create(&self.path);
        made.with_context(|| format!("creating the folder {}", self.path.display()))
    }

    /// The text of `name`; `None` if there is no such file.
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

    /// A file that everyone can read, still to be written.
    pub(super) fn public<'a>(&self, name: &str, text: &'a str) -> NewFile<'a> {
        self.file(name, text, PUBLIC)
    }

    /// A file that only its owner can read, still to be written.
    pub(super) fn secret<'a>(&self, name: &str, text: &'a str) -> NewFile<'a> {
        self.file(name, text, SECRET)
    }

    /// The key and certificate of a node, still to be written.
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

/// A file that gets its name together with others.
pub(super) struct NewFile<'a> {
    path: PathBuf,
    /// Its temporary name until all are written.
    new: PathBuf,
    text: &'a str,
    mode: u32,
}

/// Handling of existing files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Old {
    /// There are none: new files are removed again if not all can be created.
    None,
    /// They are replaced; a node that reads at the same time finds complete files.
    Replaced,
}

/// Writes all of `files` to the disk, and only then renames them to their final names.
///
/// # Errors
/// When one cannot be written. Then no new file remains, but some of the replaced files may be new.
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
            // Files that were not created cannot be removed.
            drop(fs::remove_file(&file.new));
        }
        let taken_away = files.iter().take(named).filter(|_| old == Old::None);
        taken_away.for_each(|file| drop(fs::remove_file(&file.path)));
    }
    done
}

impl NewFile<'_> {
    fn write(&self) -> anyhow::Result<()> {
        // Left by an earlier, interrupted run.
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

/// The text of the README in the folder.
pub(super) fn readme(venue: &Venue, bearers: &[Bearer]) -> String {
    let head = format!(
        "Keys of the venue \"{}\", created by `farfield certs`.\n\n\
         Each node gets ca.pem, generations.toml and the two files with its own name, in the folder\n\
         of `[security] certificates` in its venue file. No node needs another node's .key.\n\n",
        venue.name
    );
    let line = |Bearer { node, role }: &Bearer| {
        let (who, what) = match role {
            NodeRole::Fusion(hosts) => {
                ("the fusion node", format!("valid for {}", hosts.join(", ")))
            }
            NodeRole::Edge => (
                "an edge",
                format!("publishes only as {node}, receives its own boxes"),
            ),
            NodeRole::Recorder => (
                "`farfield record`",
                "receives everything, publishes nothing".to_owned(),
            ),
            NodeRole::Reader => (
                "a reader",
                "receives poses and statuses, publishes nothing".to_owned(),
            ),
        };
        format!("{node}.pem, {node}.key: {who}; {what}\n")
    };
    let lines: String = bearers.iter().map(line).collect();
    let foot = "\nca.key creates new keys for this venue. Keep it away from all nodes, offline if possible;\n\
         only `farfield certs VENUE --out DIR --renew NODE` needs it (its folder: `--authority DIR`).\n\
         If a node's key was stolen: use `--renew NODE`, copy the new files to that node,\n\
         copy generations.toml to fusion's machine (after `--renew fusion` to all machines), and restart\n\
         fusion: it then refuses the old key. To reach fusion by another name:\n\
         `--renew fusion --host NAME`; the names in its current certificate stay.\n";
    head + &lines + foot
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
    fn a_failed_creation_leaves_no_files() {
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
        // A file cannot be written if a folder has its temporary name.
        fs::create_dir_all(dir.path().join("fusion.pem.new/in the way")).unwrap();
        assert!(write_together(&files(), Old::None).is_err());
        assert_eq!(names(dir.path()), ["fusion.pem.new"]);
        fs::remove_dir_all(dir.path().join("fusion.pem.new")).unwrap();
        // Files of a killed run are no obstacle.
        fs::write(dir.path().join("ca.pem.new"), "half").unwrap();
        write_together(&files(), Old::None).unwrap();
        assert_eq!(names(dir.path()), ["ca.pem", "fusion.key", "fusion.pem"]);
        assert_eq!(folder.read("ca.pem").unwrap(), "a");
    }
}
