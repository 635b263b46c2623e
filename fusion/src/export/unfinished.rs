//! Files that get their name only when they are complete and on the disk.

use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher as _, DefaultHasher, Hash as _, Hasher as _, RandomState};
use std::io::{self, BufWriter, ErrorKind, Read as _, Seek as _, SeekFrom, Write};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::disk_policy::{DiskPolicy, GiveUp, is_full, patiently};

/// Suffix of a file's temporary name.
pub(super) const SUFFIX: &str = ".tmp";
/// How often another name is tried if one exists; random names hardly ever collide twice.
const MOST_NAMES: u32 = 8;
/// Age after which a file of another container or machine counts as abandoned: whether its process
/// is alive cannot be seen from here.
const LEFT_FOR: Duration = Duration::from_hours(1);

/// A file being written. If it is dropped before [`Unfinished::finish`], it is deleted.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    disk: Arc<dyn DiskPolicy>,
    /// `None` while it is closed.
    writer: Option<BufWriter<PatientFile>>,
    /// Bytes written, including buffered ones.
    taken: u64,
    /// Whether the system has bytes that may not be on the disk.
    unsynced: bool,
    /// Whether the temporary file shall stay, or is gone.
    settled: bool,
}

impl Unfinished {
    /// Starts the file that will be `path`.
    ///
    /// # Errors
    /// If the temporary file cannot be created, or exists: another process writes it, or did so and
    /// was killed.
    pub fn create(path: impl Into<PathBuf>) -> io::Result<Self> {
        Self::create_on(path, Arc::new(GiveUp))
    }

    /// The same with a handler of disk errors, `disk`.
    ///
    /// # Errors
    /// As [`Self::create`].
    pub fn create_on(path: impl Into<PathBuf>, disk: Arc<dyn DiskPolicy>) -> io::Result<Self> {
        let path = path.into();
        let making = || File::create_new(temporary(&path));
        let file = patiently(&*disk, &path, is_full, making)?;
        let file = PatientFile::new(file, &path, Arc::clone(&disk));
        Ok(Self {
            path,
            disk,
            writer: Some(BufWriter::new(file)),
            taken: 0,
            unsynced: true,
            settled: false,
        })
    }

    /// The final name of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes written so far.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// How many of them the system has: a killed process loses the others.
    pub fn handed_over(&self) -> u64 {
        let buffered = self.writer.as_ref().map_or(0, |w| w.buffer().len());
        self.taken.saturating_sub(buffered as u64)
    }

    /// Writes the buffer and closes the file for a while, so that rarely written files do not use
    /// up the system's handles. Writing opens it again.
    ///
    /// # Errors
    /// If the buffered bytes cannot be written.
    pub fn rest(&mut self) -> io::Result<()> {
        let Some(writer) = self.writer.take() else {
            return Ok(());
        };
        writer.into_inner().map(drop).map_err(|refused| {
            let (error, writer) = refused.into_parts();
            self.writer = Some(writer);
            error
        })
    }

    /// Writes the buffer, and waits until it is on the disk: a power cut loses only later data.
    ///
    /// # Errors
    /// If the buffered bytes cannot be written.
    pub fn sync(&mut self) -> io::Result<()> {
        if self.unsynced {
            self.awake()?.flush()?;
            self.unsynced = false;
        }
        Ok(())
    }

    /// Gives the file its name; replaces an existing file.
    ///
    /// # Errors
    /// If the last bytes cannot be written, or the file cannot be renamed.
    pub fn finish(mut self) -> io::Result<()> {
        self.give_name()?;
        sync_folder_of(&self.path)
    }

    /// The same without waiting for the folder, for callers that finish several files.
    pub(super) fn give_name(&mut self) -> io::Result<()> {
        self.sync()?;
        self.rest()?;
        fs::rename(temporary(&self.path), &self.path)?;
        self.settled = true;
        Ok(())
    }

    /// Overwrites the first bytes with `head`, for formats whose header has the number of rows.
    /// Takes no room.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(super) fn overwrite_head(&mut self, head: &[u8]) -> io::Result<()> {
        self.rest()?;
        self.unsynced = true;
        overwrite(&temporary(&self.path), head)
    }

    /// Reads the bytes from `from` to `until`, also buffered ones.
    ///
    /// # Errors
    /// If the system does not return bytes that it accepted.
    pub(super) fn read_back(&self, from: u64, until: u64) -> io::Result<Vec<u8>> {
        let handed_over = self.handed_over();
        let mut bytes = Vec::new();
        if from < handed_over {
            let mut file = open_own(OpenOptions::new().read(true), &temporary(&self.path))?;
            file.seek(SeekFrom::Start(from))?;
            file.take(until.min(handed_over) - from)
                .read_to_end(&mut bytes)?;
        }
        if let Some(writer) = &self.writer {
            let buffered = writer.buffer();
            let from = from.saturating_sub(handed_over) as usize;
            let until = until.saturating_sub(handed_over) as usize;
            bytes.extend_from_slice(buffered.get(from..until).unwrap_or_default());
        }
        if bytes.len() as u64 == until.saturating_sub(from) {
            Ok(bytes)
        } else {
            Err(ErrorKind::UnexpectedEof.into())
        }
    }

    /// Leaves the temporary file as the system has it, without the buffer; returns its path.
    pub(super) fn leave(mut self) -> PathBuf {
        self.forget_buffered();
        self.settled = true;
        temporary(&self.path)
    }

    /// Leaves the complete temporary file for the caller to rename; returns its final name.
    ///
    /// # Errors
    /// If the buffered bytes cannot be written.
    pub(super) fn leave_in_place(&mut self) -> io::Result<PathBuf> {
        self.rest()?;
        self.settled = true;
        Ok(self.path.clone())
    }

    /// A dropped buffer would try to write again.
    fn forget_buffered(&mut self) {
        if let Some(writer) = self.writer.take() {
            drop(writer.into_parts());
        }
    }

    fn awake(&mut self) -> io::Result<&mut BufWriter<PatientFile>> {
        let writer = if let Some(writer) = self.writer.take() {
            writer
        } else {
            let file = open_own(OpenOptions::new().append(true), &temporary(&self.path))?;
            let disk = Arc::clone(&self.disk);
            BufWriter::new(PatientFile::new(file, &self.path, disk))
        };
        Ok(self.writer.insert(writer))
    }
}

impl Write for Unfinished {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.unsynced = true;
        let n = self.awake()?.write(bytes)?;
        self.taken += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.rest()
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        self.forget_buffered();
        if !self.settled {
            // There is no caller to report to: at worst a file with a temporary name remains.
            drop(fs::remove_file(temporary(&self.path)));
        }
    }
}

/// A file whose writes are retried while its disk policy allows it. After a flush, the data is on
/// the disk.
#[derive(Debug)]
pub struct PatientFile {
    file: File,
    /// Its name in reports.
    path: PathBuf,
    disk: Arc<dyn DiskPolicy>,
}

impl PatientFile {
    /// Writes to `file`, which is or will be `path`.
    pub fn new(file: File, path: impl Into<PathBuf>, disk: Arc<dyn DiskPolicy>) -> Self {
        let path = path.into();
        Self { file, path, disk }
    }
}

impl Write for PatientFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Self { file, path, disk } = self;
        // Buffers handle interrupts themselves.
        let may_pass = |error: &io::Error| error.kind() != ErrorKind::Interrupted;
        patiently(&**disk, path, may_pass, || {
            #[cfg(test)]
            super::fixture::check(path, super::fixture::Work::Write)?;
            file.write(bytes)
        })
    }

    fn flush(&mut self) -> io::Result<()> {
        let Self { file, path, disk } = self;
        // A second sync would succeed: the system reports lost writes only once.
        patiently(&**disk, path, is_full, || {
            #[cfg(test)]
            super::fixture::check(path, super::fixture::Work::Sync)?;
            sync(file)
        })
    }
}

/// A file that is not on a disk (a pipe, `/dev/full`) needs no sync.
fn sync(file: &File) -> io::Result<()> {
    match file.sync_data() {
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::InvalidInput | ErrorKind::Unsupported
            ) =>
        {
            Ok(())
        }
        synced => synced,
    }
}

/// Overwrites the first bytes of `file` with `head`.
pub(super) fn overwrite(file: &Path, head: &[u8]) -> io::Result<()> {
    let mut file = open_own(OpenOptions::new().write(true), file)?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(head)
}

/// Opens a file of a run to read or change it; does not follow symbolic links.
///
/// # Errors
/// If it is not a file, or cannot be opened.
pub fn open_own(options: &OpenOptions, path: &Path) -> io::Result<File> {
    let found = fs::symlink_metadata(path)?;
    if !found.is_file() {
        let what = if found.is_symlink() {
            "a symbolic link"
        } else {
            "no file"
        };
        let words = format!("found {what}, expected a file: it is left as it is; remove it");
        return Err(io::Error::new(ErrorKind::InvalidInput, words));
    }
    let file = options.open(path)?;
    let opened = file.metadata()?;
    // A link that replaced it between the two calls leads to another file.
    if (opened.dev(), opened.ino()) != (found.dev(), found.ino()) {
        return Err(io::Error::other("it was replaced while it was opened"));
    }
    Ok(file)
}

/// Creates `folder` and its parents; `disk` handles disk errors.
///
/// # Errors
/// If it cannot be created.
pub fn create_folder_on(folder: &Path, disk: &dyn DiskPolicy) -> io::Result<()> {
    patiently(disk, folder, is_full, || fs::create_dir_all(folder))
}

/// Waits until the names in the folder of `path` are on the disk.
///
/// # Errors
/// If the folder cannot be opened or synced.
pub fn sync_folder_of(path: &Path) -> io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    sync(&File::open(folder)?)
}

/// The temporary name of the file that will be `path`.
pub fn temporary(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(SUFFIX);
    PathBuf::from(name)
}

/// Writes a whole file, first under its temporary name.
///
/// # Errors
/// If the file cannot be created, written or renamed.
pub fn write_whole(path: impl Into<PathBuf>, content: &[u8]) -> io::Result<()> {
    let mut file = Unfinished::create(path)?;
    file.write_all(content)?;
    file.finish()
}

/// The same for a small file that is rewritten often, also by several processes. Each process has
/// its own temporary name, and the last to finish wins. Temporary files of dead processes are
/// deleted; if it is unknown whether a process is alive, after an hour.
///
/// # Errors
/// If the file cannot be created, written or renamed.
pub fn write_whole_again(path: &Path, content: &[u8]) -> io::Result<()> {
    let (mut file, own) = create_own(path)?;
    remove_abandoned(path, &file);
    let written = file
        .write_all(content)
        .and_then(|()| sync(&file))
        .and_then(|()| fs::rename(&own, path));
    if written.is_err() {
        drop(fs::remove_file(&own));
    }
    written?;
    sync_folder_of(path)
}

/// Distinguishes process numbers of this system from those in another container, on another
/// machine, and before the last boot; `None` if the system does not provide it.
fn place() -> Option<u64> {
    let boot = fs::read("/proc/sys/kernel/random/boot_id").ok()?;
    let namespace = fs::read_link("/proc/self/ns/pid").ok()?;
    let mut hash = DefaultHasher::new();
    (boot, namespace).hash(&mut hash);
    Some(hash.finish())
}

/// A unique temporary file next to `path`. Its name has the number of this process, where that
/// number is valid, and a random number.
fn create_own(path: &Path) -> io::Result<(File, PathBuf)> {
    let (process, place) = (std::process::id(), place().unwrap_or_default());
    let mut last = None;
    for _ in 0..MOST_NAMES {
        // Each hash state of the standard library has random keys.
        let number = RandomState::new().build_hasher().finish();
        let mut name = path.as_os_str().to_owned();
        name.push(format!(".{process}-{place}-{number}{SUFFIX}"));
        let own = PathBuf::from(name);
        match File::create_new(&own) {
            Ok(file) => return Ok((file, own)),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => last = Some(error),
            Err(error) => return Err(error),
        }
    }
    Err(last.unwrap_or_else(|| ErrorKind::AlreadyExists.into()))
}

/// Deletes the files of [`create_own`] of dead processes, and old ones from elsewhere; `made_now`
/// has the current time of the disk's clock. Errors are ignored.
fn remove_abandoned(path: &Path, made_now: &File) {
    let Ok(now) = made_now.metadata().and_then(|it| it.modified()) else {
        return;
    };
    let here = place();
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
    let entries = fs::read_dir(folder.unwrap_or(Path::new(".")));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    for entry in entries.into_iter().flatten().flatten() {
        let found = entry.file_name();
        let Some((process, place)) = found.to_str().and_then(|it| writer_of(it, &name)) else {
            continue;
        };
        let is_left = if here == Some(place) {
            !Path::new("/proc").join(process.to_string()).exists()
        } else {
            let written = entry.metadata().and_then(|it| it.modified()).ok();
            let age = written.and_then(|written| now.duration_since(written).ok());
            age.is_some_and(|age| age > LEFT_FOR)
        };
        if is_left {
            drop(fs::remove_file(entry.path()));
        }
    }
}

/// Number and place of the process that [`create_own`] wrote in the name `found` of a file next to
/// `name`.
fn writer_of(found: &str, name: &str) -> Option<(u32, u64)> {
    let rest = found.strip_prefix(name)?.strip_prefix('.')?;
    let mut parts = rest.strip_suffix(SUFFIX)?.split('-');
    let (process, place) = (parts.next()?.parse().ok()?, parts.next()?.parse().ok()?);
    let _number: u64 = parts.next()?.parse().ok()?;
    parts.next().is_none().then_some((process, place))
}

#[cfg(test)]
#[path = "unfinished_tests.rs"]
mod tests;
