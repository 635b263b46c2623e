//! Files that appear under their name only when they are whole.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// What a file is called until it is whole: its own name with this behind it.
const SUFFIX: &str = ".tmp";

/// A file being written. Dropped before [`Unfinished::finish`], it is taken away again.
#[derive(Debug)]
pub struct Unfinished {
    path: PathBuf,
    writer: Option<BufWriter<File>>,
    finished: bool,
}

impl Unfinished {
    /// Starts the file that will be `path`.
    ///
    /// # Errors
    /// When the temporary file cannot be made, or is there: someone else writes it, or did so and was
    /// killed.
    pub fn create(path: impl Into<PathBuf>) -> io::Result<Self> {
        let path = path.into();
        let file = File::create_new(temporary(&path))?;
        Ok(Self {
            path,
            writer: Some(BufWriter::new(file)),
            finished: false,
        })
    }

    /// The name that the file will have.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes out what is buffered and lets go of the file for a while, so that files which are
    /// seldom written to do not use up the system's handles. Writing takes it up again.
    ///
    /// # Errors
    /// When the buffered bytes cannot be written.
    pub fn rest(&mut self) -> io::Result<()> {
        match self.writer.take() {
            Some(mut writer) => writer.flush(),
            None => Ok(()),
        }
    }

    /// Gives the file its name; what was there under it is replaced.
    ///
    /// # Errors
    /// When the last bytes cannot be written, or the file not be renamed.
    pub fn finish(mut self) -> io::Result<()> {
        self.rest()?;
        fs::rename(temporary(&self.path), &self.path)?;
        self.finished = true;
        Ok(())
    }

    /// Finishes with `head` in front of what was written: for formats whose header counts the rows.
    ///
    /// # Errors
    /// As [`Self::finish`], or when there is no room for both copies.
    pub fn finish_with_head(mut self, head: &str) -> io::Result<()> {
        self.rest()?;
        let mut body = File::open(temporary(&self.path))?;
        let mut whole_name = self.path.clone().into_os_string();
        whole_name.push(".head");
        let mut whole = Self::create(PathBuf::from(whole_name))?;
        whole.write_all(head.as_bytes())?;
        io::copy(&mut body, &mut whole)?;
        whole.rest()?;
        fs::rename(temporary(&whole.path), &self.path)?;
        whole.finished = true;
        Ok(())
    }
}

impl Write for Unfinished {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.writer.is_none() {
            let file = OpenOptions::new()
                .append(true)
                .open(temporary(&self.path))?;
            self.writer = Some(BufWriter::new(file));
        }
        match &mut self.writer {
            Some(writer) => writer.write(bytes),
            None => Err(io::Error::other("the file was just opened")),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.as_mut().map_or(Ok(()), Write::flush)
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if !self.finished {
            // Nobody is left to tell: at worst a file stays that says by its name what it is.
            drop(fs::remove_file(temporary(&self.path)));
        }
    }
}

fn temporary(path: &Path) -> PathBuf {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_has_its_name_only_when_it_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
        file.write_all(b"one ").unwrap();
        assert_eq!(names(folder.path()), ["a.txt.tmp"]);
        file.rest().unwrap();
        file.write_all(b"two").unwrap();
        file.finish().unwrap();
        assert_eq!(names(folder.path()), ["a.txt"]);
        assert_eq!(
            fs::read_to_string(folder.path().join("a.txt")).unwrap(),
            "one two"
        );
    }

    #[test]
    fn a_head_can_come_last_and_stand_first() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
        file.write_all(b"rows").unwrap();
        file.finish_with_head("head ").unwrap();
        assert_eq!(names(folder.path()), ["a.txt"]);
        assert_eq!(
            fs::read_to_string(folder.path().join("a.txt")).unwrap(),
            "head rows"
        );
    }

    #[test]
    fn a_file_that_someone_else_has_begun_is_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let mut first = Unfinished::create(&path).unwrap();
        first.write_all(b"first").unwrap();
        let refused = Unfinished::create(&path).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::AlreadyExists);
        first.finish().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "first");
    }

    #[test]
    fn a_file_that_was_given_up_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = Unfinished::create(folder.path().join("a.txt")).unwrap();
        file.write_all(b"half").unwrap();
        drop(file);
        assert!(names(folder.path()).is_empty());
    }
}
