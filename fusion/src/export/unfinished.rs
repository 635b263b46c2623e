//! Files that appear under their name only when they are whole, and are on the disk when they have it.

use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher as _, DefaultHasher, Hash as _, Hasher as _, RandomState};
use std::io::{self, BufWriter, ErrorKind, Read as _, Seek as _, SeekFrom, Write};
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::disk_policy::{DiskPolicy, GiveUp, is_full, patiently};

/// What a file is called until it is whole: its own name with this behind it.
pub(super) const SUFFIX: &str = ".tmp";
/// How often another name is tried where one is taken, which is by a chance that does not come twice.
const MOST_NAMES: u32 = 8;
/// A file of another container or machine that nobody has written to for so long is of nobody who still writes: whether its process
/// is alive cannot be seen from here.
const LEFT_FOR: Duration = Duration::from_hours(1);

/// A file being written. Dropped before [`Unfinished::finish`], it is taken away again.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    disk: Arc<dyn DiskPolicy>,
    /// `None` while it rests.
    writer: Option<BufWriter<PatientFile>>,
    /// Bytes that were written, buffered ones among them.
    taken: u64,
    /// Whether the system has bytes that may not be on the disk.
    unsynced: bool,
    /// Whether the temporary file is to stay, or is gone.
    settled: bool,
}

impl Unfinished {
    /// Starts the file that will be `path`.
    ///
    /// # Errors
    /// When the temporary file cannot be made, or is there: someone else writes it, or did so and was
    /// killed.
    pub fn create(path: impl Into<PathBuf>) -> io::Result<Self> {
        Self::create_on(path, Arc::new(GiveUp))
    }

    /// The same, where `disk` says what is done when there is no room.
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

    /// The name that the file will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Bytes that were written so far.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// How many of them the system has: a process that is killed loses the others.
    pub fn handed_over(&self) -> u64 {
        let buffered = self.writer.as_ref().map_or(0, |w| w.buffer().len());
        self.taken.saturating_sub(buffered as u64)
    }

    /// Writes out what is buffered and lets go of the file for a while, so that files which are
    /// seldom written to do not use up the system's handles. Writing takes it up again.
    ///
    /// # Errors
    /// When the buffered bytes cannot be written.
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

    /// Writes out what is buffered, and waits until the disk has it: a power cut loses only what comes
    /// after.
    ///
    /// # Errors
    /// When the buffered bytes cannot be written.
    pub fn sync(&mut self) -> io::Result<()> {
        if self.unsynced {
            self.awake()?.flush()?;
            self.unsynced = false;
        }
        Ok(())
    }

    /// Gives the file its name; what was there under it is replaced.
    ///
    /// # Errors
    /// When the last bytes cannot be written, or the file not be renamed.
    pub fn finish(mut self) -> io::Result<()> {
        self.give_name()?;
        sync_folder_of(&self.path)
    }

    /// The same without waiting for the folder: who finishes several files does so once.
    pub(super) fn give_name(&mut self) -> io::Result<()> {
        self.sync()?;
        self.rest()?;
        fs::rename(temporary(&self.path), &self.path)?;
        self.settled = true;
        Ok(())
    }

    /// Writes `head` over the first bytes, for formats whose header counts the rows. Takes no room.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn overwrite_head(&mut self, head: &[u8]) -> io::Result<()> {
        self.rest()?;
        self.unsynced = true;
        overwrite(&temporary(&self.path), head)
    }

    /// What was written from byte `from` to byte `until`, also what is still buffered.
    ///
    /// # Errors
    /// When the system does not give back what it has taken.
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

    /// Leaves the temporary file as the system has it, without what is buffered; returns its path.
    pub(super) fn leave(mut self) -> PathBuf {
        self.forget_buffered();
        self.settled = true;
        temporary(&self.path)
    }

    /// Leaves the temporary file with all that was written, for who names it; returns the name that it would have got.
    ///
    /// # Errors
    /// When the buffered bytes cannot be written.
    pub(super) fn leave_in_place(&mut self) -> io::Result<PathBuf> {
        self.rest()?;
        self.settled = true;
        Ok(self.path.clone())
    }

    /// Dropped, a buffer would try once more.
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
            // Nobody is left to tell: at worst a file stays that says by its name what it is.
            drop(fs::remove_file(temporary(&self.path)));
        }
    }
}

/// A file of which every write is tried for as long as its disk says; flushed, it is on the disk.
#[derive(Debug)]
pub struct PatientFile {
    file: File,
    /// What it is called when it finds no room.
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
        // Buffers do that themselves.
        let may_pass = |error: &io::Error| error.kind() != ErrorKind::Interrupted;
        patiently(&**disk, path, may_pass, || {
            #[cfg(test)]
            super::failing_disk::check(path, super::failing_disk::Work::Write)?;
            file.write(bytes)
        })
    }

    fn flush(&mut self) -> io::Result<()> {
        let Self { file, path, disk } = self;
        // A second sync would say that all is well: the system reports once what it could not write.
        patiently(&**disk, path, is_full, || {
            #[cfg(test)]
            super::failing_disk::check(path, super::failing_disk::Work::Sync)?;
            sync(file)
        })
    }
}

/// What is no file on a disk (a pipe, `/dev/full`) has nothing to wait for.
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

/// Writes `head` over the first bytes of `file`.
pub(super) fn overwrite(file: &Path, head: &[u8]) -> io::Result<()> {
    let mut file = open_own(OpenOptions::new().write(true), file)?;
    file.seek(SeekFrom::Start(0))?;
    file.write_all(head)
}

/// Opens a file that a run has made, to read or to change it: a symbolic link, or anything else in its place, is left alone.
///
/// # Errors
/// When it is no file, or cannot be opened.
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
    // A link that takes its place between the two calls leads to another file.
    if (opened.dev(), opened.ino()) != (found.dev(), found.ino()) {
        return Err(io::Error::other("it was replaced while it was opened"));
    }
    Ok(file)
}

/// Makes `folder` and those above it, where `disk` says what is done when there is no room.
///
/// # Errors
/// When it cannot be made.
pub fn create_folder_on(folder: &Path, disk: &dyn DiskPolicy) -> io::Result<()> {
    patiently(disk, folder, is_full, || fs::create_dir_all(folder))
}

/// Waits until the names in the folder of `path` are on the disk.
///
/// # Errors
/// When the folder cannot be opened or synced.
pub fn sync_folder_of(path: &Path) -> io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    sync(&File::open(folder)?)
}

/// What the file that will be `path` is called until then.
pub fn temporary(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(SUFFIX);
    PathBuf::from(name)
}

/// Writes a whole file at once, under its temporary name first.
///
/// # Errors
/// When the file cannot be made, written or renamed.
pub fn write_whole(path: impl Into<PathBuf>, content: &[u8]) -> io::Result<()> {
    let mut file = Unfinished::create(path)?;
    file.write_all(content)?;
    file.finish()
}

/// The same for a small file that is written again and again, by several processes even: each has a temporary name of its own, and
/// the last to finish counts. What processes that are gone have left under theirs is taken away; where it cannot be seen whether they
/// are, after an hour.
///
/// # Errors
/// When the file cannot be made, written or renamed.
pub fn write_whole_again(path: &Path, content: &[u8]) -> io::Result<()> {
    let (mut file, own) = create_own(path)?;
    remove_of_the_dead(path, &file);
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

/// What tells the numbers of processes here from those in another container, on another machine, and before its last start; `None`
/// where the system does not say.
fn place() -> Option<u64> {
    let boot = fs::read("/proc/sys/kernel/random/boot_id").ok()?;
    let namespace = fs::read_link("/proc/self/ns/pid").ok()?;
    let mut hash = DefaultHasher::new();
    (boot, namespace).hash(&mut hash);
    Some(hash.finish())
}

/// A temporary file that nobody else has, beside `path`: its name, the number of this process, where that counts, and one by chance.
fn create_own(path: &Path) -> io::Result<(File, PathBuf)> {
    let (process, place) = (std::process::id(), place().unwrap_or_default());
    let mut last = None;
    for _ in 0..MOST_NAMES {
        // Each state of the standard library's hash has keys of its own, by chance.
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

/// Takes away what [`create_own`] has made in processes that are gone, or elsewhere and much longer ago than `made_now` by the clock of
/// the disk; what cannot be is left.
fn remove_of_the_dead(path: &Path, made_now: &File) {
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

/// Number and place of the process that [`create_own`] gave the name `found` beside the file `name`.
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
