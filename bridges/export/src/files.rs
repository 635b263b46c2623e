//! File access of this crate: reads a run, writes files completely or not at all, appends lines.

use std::fs::{self, File};
use std::io::{self, BufReader, Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use farfield_fusion::export::unfinished::{Unfinished, temporary};

use crate::edits::list::whole_lines;
use crate::error::ExportError;
use crate::options::Existing;

/// Maximum size of a summary, bytes; far more than a run writes.
const LARGEST_SUMMARY: u64 = 64 << 20;

/// Opens a file of poses.
pub(crate) fn open(path: &Path) -> Result<BufReader<File>, ExportError> {
    let file = File::open(path).map_err(|source| ExportError::io(path, "opening", source))?;
    Ok(BufReader::with_capacity(1 << 18, file))
}

/// Reads a small text file.
pub(crate) fn read_text(path: &Path) -> Result<String, ExportError> {
    let mut text = String::new();
    let file = open(path)?;
    let read = file.take(LARGEST_SUMMARY).read_to_string(&mut text);
    read.map_err(|source| ExportError::io(path, "reading", source))?;
    Ok(text)
}

/// Reads a file of appended lines; empty if it does not exist. An incomplete character at its end
/// is dropped.
pub(crate) fn read_lines_if_there(path: &Path) -> Result<String, ExportError> {
    match open(path) {
        Err(ExportError::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
            Ok(String::new())
        }
        Err(error) => Err(error),
        Ok(file) => read_lines(file).map_err(|source| ExportError::io(path, "reading", source)),
    }
}

fn read_lines(file: impl io::Read) -> io::Result<String> {
    let mut bytes = Vec::new();
    file.take(LARGEST_SUMMARY).read_to_end(&mut bytes)?;
    if bytes.len() as u64 >= LARGEST_SUMMARY {
        // A truncated read is not an incomplete line and would silently lose lines.
        return Err(io::ErrorKind::FileTooLarge.into());
    }
    String::from_utf8(bytes).or_else(|error| {
        let (end, is_cut_off) = (
            error.utf8_error().valid_up_to(),
            error.utf8_error().error_len().is_none(),
        );
        let mut bytes = error.into_bytes();
        if is_cut_off {
            bytes.truncate(end);
        }
        String::from_utf8(bytes).map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
    })
}

/// Appends the line that `make` creates from the content of the file `path`, which is created if
/// missing. Other writers wait. If the disk is full, the file stays unchanged; an incomplete last
/// line is removed.
pub(crate) fn append(
    path: &Path,
    make: impl FnOnce(&str) -> Result<String, ExportError>,
) -> Result<(), ExportError> {
    let failed = |source| ExportError::io(path, "writing", source);
    let mut file = open_locked(path).map_err(failed)?;
    let text = read_lines(&mut file).map_err(|source| ExportError::io(path, "reading", source))?;
    let made = make(&text).and_then(|line| {
        let complete = whole_lines(&text);
        let begin = if complete.is_empty() || complete.ends_with('\n') {
            ""
        } else {
            "\n"
        };
        let on_disk = file.metadata().map_err(failed)?.len();
        if (complete.len() as u64) < on_disk {
            file.set_len(complete.len() as u64).map_err(failed)?;
        }
        let written = file.write_all(format!("{begin}{line}").as_bytes());
        let written = written.and_then(|()| file.sync_data());
        if written.is_err() {
            // The rest of a line would corrupt all following ones; if this fails too, nothing more
            // can be done.
            drop(file.set_len(complete.len() as u64));
        }
        written.map_err(failed)
    });
    // An editor that ignores the lock may have written in the meantime, so only an empty file is removed.
    let is_empty = || file.metadata().is_ok_and(|it| it.len() == 0);
    if made.is_err() && text.is_empty() && is_empty() {
        drop(fs::remove_file(path));
    }
    if made.is_ok() && file.metadata().map_err(failed)?.nlink() == 0 {
        let words = "the file was replaced by another program meanwhile: repeat the command";
        return Err(failed(io::Error::other(words)));
    }
    made
}

/// Opens a file for appending, when no other writer has it.
fn open_locked(path: &Path) -> io::Result<File> {
    loop {
        let file = File::options()
            .read(true)
            .append(true)
            .create(true)
            .open(path)?;
        file.lock()?;
        // The previous owner of the lock may have removed the file.
        if file.metadata()?.nlink() > 0 {
            return Ok(file);
        }
    }
}

/// Writes the file `path`, which must not exist; creates its folder.
pub(crate) fn write_new(path: &Path, content: &[u8]) -> Result<(), ExportError> {
    check_target(path, Existing::Refuse)?;
    if let Some(folder) = path.parent().filter(|it| !it.as_os_str().is_empty()) {
        make_folder(folder)?;
    }
    let written = farfield_fusion::export::unfinished::write_whole(path, content);
    written.map_err(|source| ExportError::io(path, "writing", source))
}

/// Creates the folder of the files.
pub(crate) fn make_folder(path: &Path) -> Result<(), ExportError> {
    fs::create_dir_all(path).map_err(|source| ExportError::io(path, "making", source))
}

/// Refuses folders, and existing files unless they are to be replaced.
pub(crate) fn check_target(path: &Path, existing: Existing) -> Result<(), ExportError> {
    if path.is_dir() {
        let source = io::Error::from(io::ErrorKind::IsADirectory);
        return Err(ExportError::io(path, "writing", source));
    }
    // A dangling link exists too.
    if existing == Existing::Refuse && path.symlink_metadata().is_ok() {
        return Err(ExportError::Exists {
            path: path.to_owned(),
        });
    }
    Ok(())
}

/// Starts the file `path` under its temporary name; it is removed unless finished.
pub(crate) fn create(path: &Path) -> Result<Unfinished, ExportError> {
    let made = Unfinished::create(path);
    made.map_err(|source| ExportError::io(&temporary(path), "making", source))
}

/// Writes all of a file to the disk, still under its temporary name.
pub(crate) fn complete(file: &mut Unfinished) -> Result<(), ExportError> {
    let synced = file.sync().and_then(|()| file.rest());
    synced.map_err(|source| ExportError::io(file.path(), "writing", source))
}

/// Renames a file to its final name; an error lists the files in `named`, which are already
/// renamed.
pub(crate) fn name(file: Unfinished, named: &[PathBuf]) -> Result<(PathBuf, u64), ExportError> {
    let (path, bytes) = (file.path().to_owned(), file.taken());
    match file.finish() {
        Ok(()) => Ok((path, bytes)),
        Err(source) if named.is_empty() => Err(ExportError::io(&path, "naming", source)),
        Err(source) => {
            let names: Vec<String> = named.iter().map(|it| it.display().to_string()).collect();
            let problem = format!(
                "{source}; these are complete and already renamed: {}",
                names.join(", ")
            );
            let source = io::Error::new(source.kind(), problem);
            Err(ExportError::io(&path, "naming", source))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_renaming_lists_the_renamed_files() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
        let files = [&one, &other].map(|path| {
            let mut file = create(path).unwrap();
            file.write_all(b"text").unwrap();
            complete(&mut file).unwrap();
            file
        });
        // Created after the targets were checked.
        fs::create_dir(&other).unwrap();
        let [first, second] = files;
        assert_eq!(name(first, &[]).unwrap(), (one.clone(), 4));
        let refused = name(second, std::slice::from_ref(&one)).unwrap_err();
        let source = std::error::Error::source(&refused).unwrap().to_string();
        assert!(refused.to_string().starts_with("naming "), "{refused}");
        assert!(source.contains(&one.display().to_string()), "{source}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_file_of_another_running_export_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one");
        let _first = create(&path).unwrap();
        let refused = create(&path).unwrap_err().to_string();
        assert!(refused.ends_with("one.tmp"), "{refused}");
    }

    #[test]
    fn a_folder_as_target_is_always_refused() {
        let folder = tempfile::tempdir().unwrap();
        for existing in [Existing::Refuse, Existing::Replace] {
            assert!(check_target(folder.path(), existing).is_err());
            assert!(check_target(&folder.path().join("new"), existing).is_ok());
        }
    }
}
