//! The one place of this crate that touches files: reading a run, and writing whole files or none.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufReader, BufWriter, Read as _};
use std::path::{Path, PathBuf};

use crate::error::ExportError;
use crate::options::Existing;

/// What a file is called until it is whole.
const SUFFIX: &str = ".tmp";
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

/// Makes the folder of the files.
pub(crate) fn make_folder(path: &Path) -> Result<(), ExportError> {
    fs::create_dir_all(path).map_err(|source| ExportError::io(path, "making", source))
}

/// A file under its temporary name, which goes unless it is finished.
#[derive(Debug)]
pub(crate) struct Unfinished {
    path: PathBuf,
    temporary: PathBuf,
    file: Option<BufWriter<File>>,
    bytes: u64,
}

impl Unfinished {
    /// Starts the file `path`.
    pub(crate) fn create(path: PathBuf, existing: Existing) -> Result<Self, ExportError> {
        if existing == Existing::Refuse && path.exists() {
            return Err(ExportError::Exists { path });
        }
        let mut temporary = path.clone().into_os_string();
        temporary.push(SUFFIX);
        let temporary = PathBuf::from(temporary);
        let file = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(true)
            .open(&temporary);
        let file = file.map_err(|source| ExportError::io(&temporary, "making", source))?;
        Ok(Self {
            path,
            temporary,
            file: Some(BufWriter::with_capacity(1 << 18, file)),
            bytes: 0,
        })
    }

    /// Its name to be.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The error of writing it.
    pub(crate) fn error(&self, source: io::Error) -> ExportError {
        ExportError::io(&self.path, "writing", source)
    }

    /// Brings all of it to the disk, still under its temporary name.
    pub(crate) fn complete(&mut self) -> Result<(), ExportError> {
        let Some(file) = self.file.take() else {
            return Ok(());
        };
        let synced = file.into_inner().map_err(io::IntoInnerError::into_error);
        let synced = synced.and_then(|file| file.sync_all());
        synced.map_err(|source| self.error(source))
    }

    /// Gives it its name. It must be complete.
    pub(crate) fn name(mut self) -> Result<(PathBuf, u64), ExportError> {
        self.complete()?;
        fs::rename(&self.temporary, &self.path).map_err(|source| self.error(source))?;
        Ok((std::mem::take(&mut self.path), self.bytes))
    }
}

impl io::Write for Unfinished {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(file) = &mut self.file else {
            return Err(io::Error::other("the file is complete"));
        };
        let written = io::Write::write(file, bytes)?;
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.as_mut().map_or(Ok(()), io::Write::flush)
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        // Once it has its name there is none of the temporary one; nothing is left to do where it cannot be removed.
        drop(self.file.take());
        drop(fs::remove_file(&self.temporary));
    }
}
