//! The one place of this crate that touches files: reading a run, writing whole files or none, adding lines.

use std::fs::{self, File};
use std::io::{self, BufReader, Read as _, Write as _};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use farfield_fusion::export::unfinished::{Unfinished, temporary};

use crate::edits::list::whole_lines;
use crate::error::ExportError;
use crate::options::Existing;

/// Bytes of a summary, far above any that a run writes.
const LARGEST_SUMMARY: u64 = 64 << 20;

/// Opens a file of poses.
pub(crate) fn open(path: &Path) -> Result<BufReader<File>, ExportError> {
    let file = File::open(path).map_err(|source| ExportError::io(path, "opening", source))?;
    Ok(BufReader::with_capacity(1 << 18, file))
}

/// The text of a small file.
pub(crate) fn read_text(path: &Path) -> Result<String, ExportError> {
    let mut text = String::new();
    let file = open(path)?;
    let read = file.take(LARGEST_SUMMARY).read_to_string(&mut text);
    read.map_err(|source| ExportError::io(path, "reading", source))?;
    Ok(text)
}

/// The same of a file that lines are added to and that may be missing: no text. Half a letter at its end is left out.
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
        // What is cut off here is no half line, and would be lost without a word.
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

/// Adds the line that `make` makes of what stands in the file `path` (made where it is not there); others who add wait. Where the
/// disk does not take all of it the file is as it was; half a line at its end goes.
pub(crate) fn append(
    path: &Path,
    make: impl FnOnce(&str) -> Result<String, ExportError>,
) -> Result<(), ExportError> {
    let failed = |source| ExportError::io(path, "writing", source);
    let mut file = open_locked(path).map_err(failed)?;
    let text = read_lines(&mut file).map_err(|source| ExportError::io(path, "reading", source))?;
    let made = make(&text).and_then(|line| {
        let kept = whole_lines(&text);
        let begin = if kept.is_empty() || kept.ends_with('\n') {
            ""
        } else {
            "\n"
        };
        let on_disk = file.metadata().map_err(failed)?.len();
        if (kept.len() as u64) < on_disk {
            file.set_len(kept.len() as u64).map_err(failed)?;
        }
        let written = file.write_all(format!("{begin}{line}").as_bytes());
        let written = written.and_then(|()| file.sync_data());
        if written.is_err() {
            // What is left of a line would be in the way of all that come; nothing more can be done where this fails, too.
            drop(file.set_len(kept.len() as u64));
        }
        written.map_err(failed)
    });
    // An editor that knows nothing of the lock may have written meanwhile: only an empty file is taken away.
    let is_empty = || file.metadata().is_ok_and(|it| it.len() == 0);
    if made.is_err() && text.is_empty() && is_empty() {
        drop(fs::remove_file(path));
    }
    if made.is_ok() && file.metadata().map_err(failed)?.nlink() == 0 {
        let words = "it was replaced by another program meanwhile: say it again";
        return Err(failed(io::Error::other(words)));
    }
    made
}

/// Opens a file to add to, when nobody else does.
fn open_locked(path: &Path) -> io::Result<File> {
    loop {
        let file = File::options()
            .read(true)
            .append(true)
            .create(true)
            .open(path)?;
        file.lock()?;
        // Whoever had it before may have taken it away again.
        if file.metadata()?.nlink() > 0 {
            return Ok(file);
        }
    }
}

/// Writes the file `path`, which must not be there; its folder is made.
pub(crate) fn write_new(path: &Path, content: &[u8]) -> Result<(), ExportError> {
    check_target(path, Existing::Refuse)?;
    if let Some(folder) = path.parent().filter(|it| !it.as_os_str().is_empty()) {
        make_folder(folder)?;
    }
    let written = farfield_fusion::export::unfinished::write_whole(path, content);
    written.map_err(|source| ExportError::io(path, "writing", source))
}

/// Makes the folder of the files.
pub(crate) fn make_folder(path: &Path) -> Result<(), ExportError> {
    fs::create_dir_all(path).map_err(|source| ExportError::io(path, "making", source))
}

/// Refuses targets that are in the way: folders, and where nothing is to be replaced files that are there.
pub(crate) fn check_target(path: &Path, existing: Existing) -> Result<(), ExportError> {
    if path.is_dir() {
        let source = io::Error::from(io::ErrorKind::IsADirectory);
        return Err(ExportError::io(path, "writing", source));
    }
    // A link that leads nowhere is there, too.
    if existing == Existing::Refuse && path.symlink_metadata().is_ok() {
        return Err(ExportError::Exists {
            path: path.to_owned(),
        });
    }
    Ok(())
}

/// Starts the file `path` under its temporary name, which goes unless it is finished.
pub(crate) fn create(path: &Path) -> Result<Unfinished, ExportError> {
    let made = Unfinished::create(path);
    made.map_err(|source| ExportError::io(&temporary(path), "making", source))
}

/// Brings all of a file to the disk, still under its temporary name.
pub(crate) fn complete(file: &mut Unfinished) -> Result<(), ExportError> {
    let synced = file.sync().and_then(|()| file.rest());
    synced.map_err(|source| ExportError::io(file.path(), "writing", source))
}

/// Gives a file its name; `named` have theirs already, which an error tells.
pub(crate) fn name(file: Unfinished, named: &[PathBuf]) -> Result<(PathBuf, u64), ExportError> {
    let (path, bytes) = (file.path().to_owned(), file.taken());
    match file.finish() {
        Ok(()) => Ok((path, bytes)),
        Err(source) if named.is_empty() => Err(ExportError::io(&path, "naming", source)),
        Err(source) => {
            let names: Vec<String> = named.iter().map(|it| it.display().to_string()).collect();
            let problem = format!(
                "{source}; these are whole and have their names already: {}",
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
    fn a_name_that_cannot_be_given_tells_which_were() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other] = ["one", "other"].map(|name| folder.path().join(name));
        let files = [&one, &other].map(|path| {
            let mut file = create(path).unwrap();
            file.write_all(b"text").unwrap();
            complete(&mut file).unwrap();
            file
        });
        // Made after the targets were looked at.
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
    fn a_file_that_another_export_has_begun_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one");
        let _first = create(&path).unwrap();
        let refused = create(&path).unwrap_err().to_string();
        assert!(refused.ends_with("one.tmp"), "{refused}");
    }

    #[test]
    fn a_folder_in_the_way_is_refused_even_where_files_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        for existing in [Existing::Refuse, Existing::Replace] {
            assert!(check_target(folder.path(), existing).is_err());
            assert!(check_target(&folder.path().join("new"), existing).is_ok());
        }
    }
}
