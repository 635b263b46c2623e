//! A file of rows that survives disk errors: it continues in another part, and the parts are joined
//! at the end.
//!
//! A part is cut where the disk had all of it, and the next begins with the bytes after that. They
//! are read back from the system, which keeps what it could not write, or from the buffer. No byte
//! is in two parts. The parts of `poses_2.trc` are `poses_2-2.trc` and so on. If the parts of a
//! file cannot be joined, each is kept complete under its name.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::disk_policy::{DiskPolicy, is_full};
use super::refusal::{Refusal, WriteError};
use super::unfinished::{Unfinished, open_own, temporary};
use super::whole::{Kind, make_whole};

/// Most parts of a file: a disk that fails more often needs another report.
const MOST_PARTS: u32 = 999;

/// A growing file of a run.
#[derive(Debug)]
pub(super) struct PartFile {
    path: PathBuf,
    kind: Kind,
    /// Start of every part, with a count of no rows.
    head: String,
    disk: Arc<dyn DiskPolicy>,
    /// The current part.
    file: Unfinished,
    n_rows: u64,
    /// How far it is on the disk.
    settled: Settled,
    number: u32,
    ended: Vec<(PathBuf, Settled)>,
    /// Bytes of rows before the current part, minus those of its head.
    bytes_before: u64,
    /// Whether the disk has not confirmed the data.
    is_unconfirmed: bool,
    n_lost: u64,
    refusals: Vec<Refusal>,
}

/// Whole rows of a part, and where they end.
#[derive(Debug, Clone, Copy)]
struct Settled {
    bytes: u64,
    n_rows: u64,
}

/// The result of a file.
#[derive(Debug, Default)]
pub(super) struct Ended {
    /// Bytes of whole rows from the beginning, over all parts, as counted by [`PartFile::taken`].
    pub(super) bytes: u64,
    /// Rows that the system accepted and lost.
    pub(super) n_lost: u64,
    pub(super) refusals: Vec<Refusal>,
    pub(super) failure: Option<WriteError>,
}

impl PartFile {
    /// Begins `path` with `head`; if it cannot be created, begins its second part.
    ///
    /// # Errors
    /// [`WriteError::Io`] if there is no room, and `disk` does not wait for any.
    pub(super) fn create(
        path: PathBuf,
        kind: Kind,
        head: String,
        disk: &Arc<dyn DiskPolicy>,
    ) -> Result<Self, WriteError> {
        let (number, file) =
            begin(&path, 1, disk, head.as_bytes()).map_err(|error| io_error(&path, error))?;
        Ok(Self {
            settled: Settled {
                bytes: head.len() as u64,
                n_rows: 0,
            },
            path,
            kind,
            head,
            disk: Arc::clone(disk),
            file,
            n_rows: 0,
            number,
            ended: Vec::new(),
            bytes_before: 0,
            is_unconfirmed: false,
            n_lost: 0,
            refusals: Vec::new(),
        })
    }

    /// The final name of the file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes written so far, over all parts.
    pub(super) fn taken(&self) -> u64 {
        self.bytes_before + self.file.taken()
    }

    /// How many of them the system has.
    pub(super) fn handed_over(&self) -> u64 {
        self.bytes_before + self.file.handed_over()
    }

    /// Adds a whole row.
    ///
    /// # Errors
    /// [`WriteError::Io`] if this part refuses it and no other can be begun.
    pub(super) fn add_row(&mut self, row: &[u8]) -> Result<(), WriteError> {
        let before = self.file.taken();
        if let Err(error) = self.file.write_all(row) {
            self.continue_in_new_part(before, row, error)?;
        }
        self.n_rows += 1;
        Ok(())
    }

    /// Closes the file for a while: [`Unfinished::rest`].
    ///
    /// # Errors
    /// As [`Self::add_row`].
    pub(super) fn rest(&mut self) -> Result<(), WriteError> {
        match self.file.rest() {
            Ok(()) => Ok(()),
            Err(error) => self.continue_in_new_part(self.file.taken(), &[], error),
        }
    }

    /// Waits until the disk has everything so far. If the disk does not confirm it, also not for a
    /// new part, this is reported once, and the file continues.
    ///
    /// # Errors
    /// As [`Self::add_row`].
    pub(super) fn sync(&mut self) -> Result<(), WriteError> {
        let mut synced = self.file.sync();
        let is_known = self.is_unconfirmed && self.is_written();
        if !is_known && let Err(error) = synced {
            self.continue_in_new_part(self.file.taken(), &[], error)?;
            synced = self.file.sync();
        }
        match synced {
            Ok(()) => self.is_unconfirmed = false,
            Err(error) if !self.is_written() => return Err(io_error(self.file.path(), error)),
            Err(error) => {
                if !self.is_unconfirmed {
                    self.note(Refusal {
                        file: name_of(self.file.path()),
                        failure: format!("the disk does not confirm the data: {error}"),
                        goes_on_in: None,
                    });
                }
                self.is_unconfirmed = true;
            }
        }
        self.settled = Settled {
            bytes: self.file.taken(),
            n_rows: self.n_rows,
        };
        Ok(())
    }

    fn is_written(&self) -> bool {
        self.file.handed_over() == self.file.taken()
    }

    fn note(&mut self, refusal: Refusal) {
        self.disk.refused(&refusal.to_string());
        self.refusals.push(refusal);
    }

    /// Continues in a new part with the unconfirmed bytes of the current one up to `until`, and
    /// `more`.
    fn continue_in_new_part(
        &mut self,
        until: u64,
        more: &[u8],
        refused: io::Error,
    ) -> Result<(), WriteError> {
        if is_full(&refused) || self.number >= MOST_PARTS {
            // The next part would find no room either.
            return Err(io_error(self.file.path(), refused));
        }
        let carried = match self.file.read_back(self.settled.bytes, until) {
            Ok(carried) => carried,
            // The buffered bytes, from the first whole row on.
            Err(_) => whole_rows_from(self.file.handed_over(), until, &self.file),
        };
        let content = [self.head.as_bytes(), &carried, more].concat();
        let begun = begin(&self.path, self.number + 1, &self.disk, &content);
        let Ok((number, file)) = begun else {
            return Err(io_error(self.file.path(), refused));
        };
        self.bytes_before += until - (self.head.len() + carried.len()) as u64;
        let ended = std::mem::replace(&mut self.file, file);
        let path = ended.path().to_owned();
        // If this fails, it is done again at the end.
        drop(cut_to(&ended.leave(), self.settled.bytes));
        self.ended.push((path.clone(), self.settled));
        self.number = number;
        let n_carried = carried.split(|&byte| byte == b'\n').skip(1).count() as u64;
        self.n_lost += (self.n_rows - self.settled.n_rows).saturating_sub(n_carried);
        self.n_rows = n_carried;
        self.settled = self.no_rows();
        let refusal = Refusal {
            file: name_of(&path),
            failure: refused.to_string(),
            goes_on_in: Some(name_of(self.file.path())),
        };
        self.note(refusal);
        Ok(())
    }

    /// Gives the file its name, with all its parts joined; if that fails, each part gets its own.
    pub(super) fn finish(mut self) -> Ended {
        let named = self.give_name();
        Ended {
            bytes: self.taken(),
            n_lost: self.n_lost,
            failure: named.err(),
            refusals: std::mem::take(&mut self.refusals),
        }
    }

    fn give_name(&mut self) -> Result<(), WriteError> {
        if self.ended.is_empty() && self.file.path() == self.path {
            let head = self.kind.with_rows(&self.head, self.n_rows);
            let head = head.filter(|head| !head.is_empty());
            let counted = head.map_or(Ok(()), |head| self.file.overwrite_head(head.as_bytes()));
            match counted.and_then(|()| self.file.give_name()) {
                Ok(()) => return Ok(()),
                Err(error) => self.continue_in_new_part(self.file.taken(), &[], error)?,
            }
        }
        self.sync()?;
        let present = self.file.leave_in_place();
        let present = present.map_err(|error| io_error(&self.path, error))?;
        let mut parts = std::mem::take(&mut self.ended);
        parts.push((present, self.settled));
        self.join(&parts)
    }

    /// Appends all parts to the first, or to a new file if the first one refuses. If that fails
    /// too, each part gets its own name.
    fn join(&self, parts: &[(PathBuf, Settled)]) -> Result<(), WriteError> {
        let Some(((first, settled), others)) = parts.split_first() else {
            return Ok(());
        };
        let new = temporary(&part_path(&self.path, self.number + 1));
        let joined = self.append(&temporary(first), *settled, others);
        let joined = joined.or_else(|_| {
            // Surplus bytes are cut off when it gets its name.
            File::create_new(&new)?.write_all(self.head.as_bytes())?;
            self.append(&new, self.no_rows(), parts)
        });
        let Err(error) = joined else {
            for (part, _) in parts {
                // Its rows are in the other file; the first part may be that file.
                drop(fs::remove_file(temporary(part)));
            }
            return Ok(());
        };
        // Complete parts are no loss.
        tracing::debug!(%error, file = %self.path.display(), "its parts are not joined");
        drop(fs::remove_file(new));
        self.name_each(parts)
    }

    /// Appends the rows of `parts` to the temporary file `into`, and gives it the final name.
    fn append(&self, into: &Path, of: Settled, parts: &[(PathBuf, Settled)]) -> io::Result<()> {
        #[cfg(test)]
        super::fixture::check(&self.path, super::fixture::Work::Join)?;
        cut_to(into, of.bytes)?;
        let (mut file, mut all) = (open_own(OpenOptions::new().append(true), into)?, of);
        for (part, settled) in parts {
            let mut from = open_own(OpenOptions::new().read(true), &temporary(part))?;
            from.seek(SeekFrom::Start(self.head.len() as u64))?;
            let n_bytes = settled.bytes - self.head.len() as u64;
            if io::copy(&mut from.take(n_bytes), &mut file)? < n_bytes {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            all.bytes += n_bytes;
            all.n_rows += settled.n_rows;
        }
        self.name(into, &self.path, all)
    }

    fn no_rows(&self) -> Settled {
        Settled {
            bytes: self.head.len() as u64,
            n_rows: 0,
        }
    }

    /// Gives all parts their own names; deletes those without rows.
    fn name_each(&self, parts: &[(PathBuf, Settled)]) -> Result<(), WriteError> {
        let mut failed = Ok(());
        for (part, settled) in parts {
            let named = match settled.n_rows {
                0 => fs::remove_file(temporary(part)),
                _ => self.name(&temporary(part), part, *settled),
            };
            failed = failed.and(named.map_err(|error| io_error(part, error)));
        }
        failed
    }

    fn name(&self, from: &Path, to: &Path, settled: Settled) -> io::Result<()> {
        let mut file = open_own(OpenOptions::new().write(true), from)?;
        file.set_len(settled.bytes)?;
        if let Some(head) = self.kind.with_rows(&self.head, settled.n_rows) {
            file.write_all(head.as_bytes())?;
        }
        file.sync_all()?;
        fs::rename(from, to)
    }

    /// Keeps the bytes that the system has, cut after the last whole row. Further errors are
    /// ignored: the cause is already reported, and a remaining file has a temporary name.
    pub(super) fn cut(mut self) -> Ended {
        // There may be a little room by now.
        drop(self.file.rest());
        let ended = std::mem::take(&mut self.ended);
        drop(self.name_each(&ended));
        let whole = make_whole(&self.file.leave(), self.kind).ok().flatten();
        Ended {
            bytes: self.bytes_before + whole.map_or(0, |whole| whole.bytes),
            n_lost: self.n_lost,
            refusals: self.refusals,
            failure: None,
        }
    }
}

/// Begins a part of `path`, with number `from` or higher, with `content`.
fn begin(
    path: &Path,
    from: u32,
    disk: &Arc<dyn DiskPolicy>,
    content: &[u8],
) -> io::Result<(u32, Unfinished)> {
    let mut tries = 0;
    loop {
        let number = from + tries % 2;
        let part = part_path(path, number);
        let begun = Unfinished::create_on(&part, Arc::clone(disk)).and_then(|mut file| {
            file.write_all(content)?;
            file.rest()?;
            Ok(file)
        });
        match begun {
            Ok(file) => return Ok((number, file)),
            Err(error) if is_full(&error) => return Err(error),
            Err(error) if tries > 0 && !disk.wait(&part, &error) => return Err(error),
            Err(_) => tries += 1,
        }
    }
}

/// `poses_2.trc` for the first part of `poses_2.trc`, `poses_2-2.trc` for the second.
fn part_path(path: &Path, number: u32) -> PathBuf {
    if number <= 1 {
        return path.to_owned();
    }
    let [stem, extension] = [path.file_stem(), path.extension()]
        .map(|it| it.unwrap_or_default().to_string_lossy().into_owned());
    path.with_file_name(format!("{stem}-{number}.{extension}"))
}

fn cut_to(file: &Path, n_bytes: u64) -> io::Result<()> {
    open_own(OpenOptions::new().write(true), file)?.set_len(n_bytes)
}

/// The bytes `from` to `until` without a leading partial row; empty if they cannot be read.
fn whole_rows_from(from: u64, until: u64, file: &Unfinished) -> Vec<u8> {
    let mut bytes = file.read_back(from, until).unwrap_or_default();
    let torn = bytes.iter().position(|&byte| byte == b'\n');
    bytes.drain(..torn.map_or(bytes.len(), |at| at + 1));
    bytes
}

fn name_of(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

pub(super) fn io_error(path: &Path, source: io::Error) -> WriteError {
    WriteError::Io {
        path: path.to_owned(),
        source,
    }
}
