//! File access of this crate: list a folder, read with a size limit, and write a whole folder or
//! none.

use std::fs::{self, File};
use std::io::{self, BufWriter, Read as _, Write};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use farfield_calibration::formats::TextFile;
use farfield_proto::calibration::text_of;
use time::OffsetDateTime;

use crate::error::ImportError;

/// Maximum depth of nested folders.
const MAX_DEPTH: usize = 6;
/// Maximum number of files in a folder and below; ten hours of eight cameras with one file per
/// frame are fewer.
const MAX_FILES: usize = 20_000_000;
/// Folders that contain this file come from an earlier import and are skipped.
const VENUE: &str = "venue.toml";

/// Lists all files in `folder` and below, sorted by name, without hidden files and imported venues.
pub(crate) fn list(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let mut found = Vec::new();
    let mut open = vec![(folder.to_owned(), 0)];
    while let Some((at, depth)) = open.pop() {
        let mut entries = entries(&at)?;
        entries.sort();
        if depth > 0 && entries.iter().any(|it| it.ends_with(VENUE)) {
            continue;
        }
        for path in entries {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if name.starts_with('.') {
                continue;
            }
            if !path.is_dir() {
                found.push(path);
            } else if depth < MAX_DEPTH {
                open.push((path, depth + 1));
            }
            if found.len() > MAX_FILES {
                return Err(ImportError::refused(format!(
                    "{}: found more than {MAX_FILES} files, expected the folder of one recording",
                    folder.display()
                )));
            }
        }
    }
    found.sort();
    Ok(found)
}

pub(crate) fn is_folder(path: &Path) -> bool {
    path.is_dir()
}

pub(crate) fn is_file(path: &Path) -> bool {
    path.is_file()
}

/// The absolute path of a folder.
pub(crate) fn full(folder: &Path) -> Result<PathBuf, ImportError> {
    let full = folder.canonicalize();
    full.map_err(|source| ImportError::read("reading the folder", folder, source))
}

/// The entries of one folder.
pub(crate) fn entries(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let read = fs::read_dir(folder)
        .map_err(|source| ImportError::read("reading the folder", folder, source))?;
    Ok(read.flatten().map(|entry| entry.path()).collect())
}

/// Reads a file of at most `limit` bytes.
pub(crate) fn read(path: &Path, limit: u64) -> Result<Vec<u8>, ImportError> {
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|source| ImportError::read("opening", path, source))?;
    let read = file.take(limit + 1).read_to_end(&mut bytes);
    read.map_err(|source| ImportError::read("reading", path, source))?;
    if bytes.len() as u64 > limit {
        return Err(ImportError::refused(format!(
            "{}: found a file of more than {limit} bytes",
            path.display()
        )));
    }
    Ok(bytes)
}

/// Reads the first bytes of a file.
pub(crate) fn head(path: &Path, length: u64) -> Result<Vec<u8>, ImportError> {
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|source| ImportError::read("opening", path, source))?;
    let read = file.take(length).read_to_end(&mut bytes);
    read.map_err(|source| ImportError::read("reading", path, source))?;
    Ok(bytes)
}

/// Maximum size of a text file, bytes.
const LARGEST_TEXT: u64 = 32 << 20;

/// Reads a small text file.
pub(crate) fn read_text(path: &Path) -> Result<String, ImportError> {
    String::from_utf8(read(path, LARGEST_TEXT)?).map_err(|_| {
        let problem = format!("{}: found bytes that are no text", path.display());
        ImportError::refused(problem)
    })
}

/// Reads a calibration file as text.
pub(crate) fn read_calibration(path: &Path) -> Result<TextFile, ImportError> {
    Ok(TextFile {
        path: path.to_owned(),
        text: text_of(read(path, LARGEST_TEXT)?, path)?,
    })
}

/// Modification time of a file: `2026-03-01 09:30 UTC`.
pub(crate) fn date(path: &Path) -> Option<String> {
    let written = path.metadata().ok()?.modified().ok()?;
    let unix_s = written.duration_since(UNIX_EPOCH).ok()?.as_secs();
    let at = OffsetDateTime::from_unix_timestamp(i64::try_from(unix_s).ok()?).ok()?;
    let (year, month, day) = at.to_calendar_date();
    let (hour, minute) = (at.hour(), at.minute());
    let month = u8::from(month);
    Some(format!(
        "{year}-{month:02}-{day:02} {hour:02}:{minute:02} UTC"
    ))
}

/// A folder that is written under a temporary name, renamed when complete, and otherwise removed.
#[derive(Debug)]
pub(crate) struct NewFolder {
    made: PathBuf,
    out: PathBuf,
    is_named: bool,
    parents: NewParents,
}

/// Newly created parent folders, innermost first; removed again if the import fails.
#[derive(Debug, Default)]
struct NewParents(Vec<PathBuf>);

impl NewParents {
    fn create(parent: &Path) -> Result<Self, ImportError> {
        let is_new = |it: &&Path| !it.as_os_str().is_empty() && it.symlink_metadata().is_err();
        let new = parent.ancestors().take_while(is_new);
        let new = Self(new.map(Path::to_owned).collect());
        fs::create_dir_all(parent)
            .map_err(|source| ImportError::write("making", parent, source))?;
        Ok(new)
    }
}

impl Drop for NewParents {
    fn drop(&mut self) {
        for folder in &self.0 {
            // Removes only empty folders, from the innermost.
            if fs::remove_dir(folder).is_err() {
                return;
            }
        }
    }
}

impl NewFolder {
    /// Creates the temporary folder for `out`, which must not exist or be empty.
    pub(crate) fn create(out: &Path) -> Result<Self, ImportError> {
        let is_link = |it: fs::Metadata| it.file_type().is_symlink();
        if out.symlink_metadata().is_ok_and(is_link) {
            return Err(ImportError::refused(format!(
                "{} is a link, expected a folder to create: give its target, or another folder, with `--out DIR`",
                out.display()
            )));
        }
        let is_empty = || fs::read_dir(out).is_ok_and(|mut it| it.next().is_none());
        if out.symlink_metadata().is_ok() && !is_empty() {
            return Err(ImportError::refused(format!(
                "{} is there already, and is not written over: name another with `--out DIR`",
                out.display()
            )));
        }
        let name = out.file_name().ok_or_else(|| {
            ImportError::refused(format!("{}: expected the name of a folder", out.display()))
        })?;
        let parent = out.parent().filter(|it| !it.as_os_str().is_empty());
        let parent = parent.unwrap_or(Path::new("."));
        let parents = NewParents::create(parent)?;
        let made = parent.join(format!(".{}.tmp", name.to_string_lossy()));
        fs::create_dir(&made).map_err(|source| match source.kind() {
            io::ErrorKind::AlreadyExists => ImportError::refused(format!(
                "{} is there: another import is writing it, or an import was killed; if none is running, delete it",
                made.display()
            )),
            _ => ImportError::write("making", &made, source),
        })?;
        Ok(Self {
            made,
            out: out.to_owned(),
            is_named: false,
            parents,
        })
    }

    /// Writes one file, and creates its subfolder.
    pub(crate) fn write(
        &self,
        name: &Path,
        write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    ) -> Result<(), ImportError> {
        let path = self.made.join(name);
        let written = || {
            if let Some(folder) = path.parent() {
                fs::create_dir_all(folder)?;
            }
            let mut file = BufWriter::new(File::create_new(&path)?);
            write(&mut file)?;
            file.flush()?;
            file.get_ref().sync_all()
        };
        written().map_err(|source| ImportError::write("writing", &path, source))
    }

    /// Renames the folder to its final name.
    pub(crate) fn finish(mut self) -> Result<(), ImportError> {
        fs::rename(&self.made, &self.out).map_err(|source| {
            ImportError::write("naming the finished folder", &self.out, source)
        })?;
        self.is_named = true;
        self.parents.0.clear();
        Ok(())
    }
}

impl Drop for NewFolder {
    fn drop(&mut self) {
        if !self.is_named {
            // The failure itself was already reported.
            fs::remove_dir_all(&self.made).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_renamed_when_complete_and_removed_otherwise() {
        let at = tempfile::tempdir().unwrap();
        let out = at.path().join("venue");
        let folder = NewFolder::create(&out).unwrap();
        let full = |_: &mut BufWriter<File>| Err(io::ErrorKind::StorageFull.into());
        folder.write(Path::new("a/b.txt"), full).unwrap_err();
        assert!(!out.exists());
        drop(folder);
        assert_eq!(fs::read_dir(at.path()).unwrap().count(), 0);
        let folder = NewFolder::create(&out).unwrap();
        folder
            .write(Path::new("a/b.txt"), |file| file.write_all(b"text"))
            .unwrap();
        folder.finish().unwrap();
        assert_eq!(fs::read(out.join("a/b.txt")).unwrap(), b"text");
        let error = NewFolder::create(&out).unwrap_err().to_string();
        assert!(error.contains("is there already"), "{error}");
        assert_eq!(fs::read_dir(at.path()).unwrap().count(), 1);
    }

    #[test]
    fn leftovers_of_a_killed_import_are_reported_with_a_remedy() {
        let at = tempfile::tempdir().unwrap();
        let left = at.path().join(".venue.tmp");
        fs::create_dir(&left).unwrap();
        let refused = NewFolder::create(&at.path().join("venue")).unwrap_err();
        assert!(matches!(refused, ImportError::Refused(_)));
        let refused = refused.to_string();
        assert!(
            refused.contains(".venue.tmp") && refused.contains("delete it"),
            "{refused}"
        );
        // Another import may still be running.
        assert!(left.exists());
    }

    #[test]
    fn created_parents_are_removed_unless_the_import_succeeds() {
        let at = tempfile::tempdir().unwrap();
        let out = at.path().join("a/b/venue");
        drop(NewFolder::create(&out).unwrap());
        assert_eq!(fs::read_dir(at.path()).unwrap().count(), 0);
        fs::create_dir(at.path().join("a")).unwrap();
        drop(NewFolder::create(&out).unwrap());
        assert!(at.path().join("a").exists() && !at.path().join("a/b").exists());
        NewFolder::create(&out).unwrap().finish().unwrap();
        assert!(out.exists());
    }

    #[cfg(unix)]
    #[test]
    fn links_are_refused_before_reading() {
        let at = tempfile::tempdir().unwrap();
        let (to, out) = (at.path().join("empty"), at.path().join("venue"));
        fs::create_dir(&to).unwrap();
        std::os::unix::fs::symlink(&to, &out).unwrap();
        let refused = NewFolder::create(&out).unwrap_err().to_string();
        assert!(refused.contains("is a link"), "{refused}");
    }

    #[test]
    fn hidden_files_and_venues_are_skipped() {
        let at = tempfile::tempdir().unwrap();
        for name in [
            "a.json",
            ".hidden/b.json",
            "made/venue.toml",
            "made/c.json",
            "in/d.json",
        ] {
            let path = at.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        let found = list(at.path()).unwrap();
        assert_eq!(
            found,
            [at.path().join("a.json"), at.path().join("in/d.json")]
        );
    }
}
