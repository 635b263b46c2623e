//! Location of a fetched file: inside the folder of the venue file, under a temporary name until it
//! is complete.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, bail};
use farfield_proto::message::handout::{FileKind, SharedFile};

/// Most temporary files per name, in progress or left by killed processes.
const MAX_PARTS: u32 = 1000;
/// Bytes per read.
const BUFFER_BYTES: usize = 64 * 1024;

/// The path to write `file` to, for a venue file at `venue`; `None` if the file is already there.
///
/// # Errors
/// If the path is outside the folder of the venue file and the file is not already there.
pub(super) fn target(venue: &Path, file: &SharedFile) -> anyhow::Result<Option<PathBuf>> {
    let place = Path::new(&file.path);
    let target = whole(venue, file);
    if is_there(&target, file) {
        return Ok(None);
    }
    let inside = !file.path.is_empty()
        && place
            .components()
            .all(|component| matches!(component, Component::Normal(_)));
    if file.kind != FileKind::Venue && !inside {
        bail!(
            "fusion's {} lies at `{}`, outside the folder of its venue file, and differs from the one here: move it inside there, or copy it by hand",
            file.kind.name(),
            file.path
        );
    }
    Ok(Some(target))
}

/// The final path of `file`, for a venue file at `venue`.
pub(super) fn whole(venue: &Path, file: &SharedFile) -> PathBuf {
    let folder = venue.parent().unwrap_or(Path::new(""));
    match file.kind {
        FileKind::Venue => venue.to_owned(),
        _ => folder.join(&file.path),
    }
}

fn is_there(path: &Path, file: &SharedFile) -> bool {
    // The list may name a device that never ends.
    let fits = |there: fs::Metadata| there.is_file() && there.len() == file.bytes;
    fs::metadata(path).is_ok_and(fits) && hash(path).is_ok_and(|there| there == file.blake3)
}

fn hash(path: &Path) -> io::Result<[u8; 32]> {
    let (mut hasher, mut file) = (blake3::Hasher::new(), File::open(path)?);
    let mut buffer = vec![0; BUFFER_BYTES];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(*hasher.finalize().as_bytes()),
            n => hasher.update(&buffer[..n]),
        };
    }
}

/// A file in progress. It is removed unless finished.
pub(super) struct Part {
    target: PathBuf,
    path: PathBuf,
    file: Option<File>,
    hasher: blake3::Hasher,
    expected: [u8; 32],
}

impl Part {
    /// Starts `file`, with the final path `target`.
    pub(super) fn create(target: &Path, file: &SharedFile) -> anyhow::Result<Self> {
        if let Some(folder) = target.parent() {
            fs::create_dir_all(folder)
                .with_context(|| format!("making the folder {}", folder.display()))?;
        }
        let (path, open) =
            create_part(target).with_context(|| format!("writing {}", target.display()))?;
        Ok(Self {
            target: target.to_owned(),
            path,
            file: Some(open),
            hasher: blake3::Hasher::new(),
            expected: file.blake3,
        })
    }

    /// Appends bytes.
    pub(super) fn write(&mut self, bytes: &[u8]) -> anyhow::Result<()> {
        self.hasher.update(bytes);
        let Some(file) = &mut self.file else {
            return Ok(());
        };
        file.write_all(bytes)
            .with_context(|| format!("writing {}", self.path.display()))
    }

    /// Checks the hash of the complete file.
    pub(super) fn check(&self) -> anyhow::Result<()> {
        anyhow::ensure!(
            *self.hasher.finalize().as_bytes() == self.expected,
            "{} has changed on fusion's machine since fusion started: start fusion again",
            self.target.display()
        );
        Ok(())
    }

    /// The path of the temporary file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Moves the file to its final path.
    pub(super) fn finish(mut self) -> anyhow::Result<PathBuf> {
        let place = || format!("writing {}", self.target.display());
        if let Some(file) = self.file.take() {
            file.sync_all().with_context(place)?;
        }
        fs::rename(&self.path, &self.target).with_context(place)?;
        Ok(self.target.clone())
    }
}

/// Creates a temporary file next to `target` for this process only, because several edges may fetch
/// into one folder.
fn create_part(target: &Path) -> io::Result<(PathBuf, File)> {
    let name = target.file_name().unwrap_or_default();
    for n in 0..MAX_PARTS {
        let mut name = name.to_owned();
        name.push(format!(".{}-{n}.part", std::process::id()));
        let path = target.with_file_name(name);
        match File::create_new(&path) {
            Ok(file) => return Ok((path, file)),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(ErrorKind::AlreadyExists.into())
}

impl Drop for Part {
    fn drop(&mut self) {
        // After `finish` this name no longer exists.
        drop(fs::remove_file(&self.path));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shared(kind: FileKind, path: &str, text: &str) -> SharedFile {
        SharedFile {
            kind,
            path: path.to_owned(),
            bytes: text.len() as u64,
            blake3: *blake3::hash(text.as_bytes()).as_bytes(),
        }
    }

    #[test]
    fn nothing_is_written_outside_the_folder_of_the_venue_file() {
        let folder = tempfile::tempdir().unwrap();
        let venue = folder.path().join("hall/venue.toml");
        for outside in ["../c.toml", "/etc/passwd", "", "a/../../b", "/dev/zero"] {
            let file = shared(FileKind::Calibration, outside, "x");
            assert!(target(&venue, &file).is_err(), "{outside}");
        }
        let inside = shared(FileKind::Calibration, "sub/c.toml", "x");
        assert_eq!(
            target(&venue, &inside).unwrap(),
            Some(folder.path().join("hall/sub/c.toml"))
        );
    }

    #[test]
    fn an_existing_equal_file_is_left_alone_anywhere() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("hall")).unwrap();
        let venue = folder.path().join("hall/venue.toml");
        std::fs::write(folder.path().join("c.toml"), "same").unwrap();
        let file = shared(FileKind::Calibration, "../c.toml", "same");
        assert_eq!(target(&venue, &file).unwrap(), None);
    }

    #[test]
    fn a_file_appears_only_when_complete_and_correct() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("venue.toml");
        std::fs::write(&path, "old").unwrap();
        let file = shared(FileKind::Venue, "", "new");
        let mut part = Part::create(&path, &file).unwrap();
        part.write(b"nex").unwrap();
        assert!(part.check().is_err());
        drop(part);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");

        let mut part = Part::create(&path, &file).unwrap();
        part.write(b"ne").unwrap();
        part.write(b"w").unwrap();
        part.check().unwrap();
        part.finish().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
        assert_eq!(folder.path().read_dir().unwrap().count(), 1);
    }

    #[test]
    fn two_processes_in_one_folder_use_separate_files() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("venue.toml");
        let file = shared(FileKind::Venue, "", "new");
        let mut parts = [(); 2].map(|()| Part::create(&path, &file).unwrap());
        assert_ne!(parts[0].path(), parts[1].path());
        for part in &mut parts {
            part.write(b"new").unwrap();
        }
        for part in parts {
            part.check().unwrap();
            part.finish().unwrap();
        }
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "new");
    }
}
