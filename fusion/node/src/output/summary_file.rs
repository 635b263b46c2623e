//! `summary.json`: its room is reserved at the start, so that a disk that is full at the end can still hold it.

use std::fs::{self, File};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_node::process::say;

use farfield_fusion::export::summary::{RecordingSummary, Summary};
use farfield_fusion::export::unfinished::{sync_folder_of, temporary};

/// Reserved room, bytes: enough for hundreds of people and dozens of viewpoints.
const ROOM: usize = 64 << 10;

/// The summary of a run in progress. Dropping it unfinished removes its file.
#[derive(Debug)]
pub(crate) struct SummaryFile {
    path: PathBuf,
    file: Option<File>,
    /// Bytes that can be written without new room on the disk.
    room: usize,
    /// End of the last written text.
    end: u64,
    summary: Option<Summary>,
}

impl SummaryFile {
    /// The summary in `folder`. Creates no file.
    pub(crate) fn in_folder(folder: &Path) -> Self {
        Self {
            path: folder.join("summary.json"),
            file: None,
            room: 0,
            end: 0,
            summary: None,
        }
    }

    /// Reserves the room. Without room the run still begins: there may be some at its end.
    ///
    /// # Errors
    /// The temporary file exists already, or cannot be created.
    pub(crate) fn reserve(&mut self) -> anyhow::Result<()> {
        let making = || format!("making {}", self.path.display());
        let mut file = File::create_new(temporary(&self.path)).with_context(making)?;
        let reserved = file.write_all(&vec![b' '; ROOM]);
        match reserved.and_then(|()| file.sync_data()) {
            Ok(()) => self.room = ROOM,
            Err(error) => say(format_args!(
                "no room is reserved for {}: {error}",
                self.path.display()
            )),
        }
        self.file = Some(file);
        Ok(())
    }

    /// Writes the summary. The file gets its name in [`Self::finish`].
    ///
    /// # Errors
    /// The file cannot be written.
    pub(crate) fn put(&mut self, summary: Summary) -> anyhow::Result<()> {
        if self.file.is_none() {
            self.reserve()?;
        }
        let mut text = summary.to_json();
        if text.len() > self.room {
            text = summary.to_short_json();
        }
        let writing = || format!("writing {}", self.path.display());
        if let Some(file) = &mut self.file {
            file.seek(SeekFrom::Start(0)).with_context(writing)?;
            let mut bytes = text.into_bytes();
            self.end = bytes.len() as u64;
            // The reserved room is kept until the end: the next text may be longer.
            bytes.resize(bytes.len().max(self.room), b' ');
            file.write_all(&bytes).with_context(writing)?;
            file.sync_data().with_context(writing)?;
        }
        self.summary = Some(summary);
        Ok(())
    }

    /// Adds the final result of the recording, including later failures, and gives the file its name. A run without a summary
    /// leaves no file.
    ///
    /// # Errors
    /// The file cannot be written or renamed.
    pub(crate) fn finish(mut self, recording: Option<&RecordingSummary>) -> anyhow::Result<()> {
        let Some(mut summary) = self.summary.take() else {
            return Ok(());
        };
        if recording.is_some() && summary.timing.recording.as_ref() != recording {
            summary.timing.recording = recording.cloned();
            self.put(summary)?;
        }
        let naming = || format!("writing {}", self.path.display());
        if let Some(file) = self.file.take() {
            file.set_len(self.end).with_context(naming)?;
            file.sync_all().with_context(naming)?;
            fs::rename(temporary(&self.path), &self.path).with_context(naming)?;
            sync_folder_of(&self.path).with_context(naming)?;
        }
        Ok(())
    }
}

impl Drop for SummaryFile {
    fn drop(&mut self) {
        if self.file.take().is_some() {
            // An error cannot be reported any more. At worst a file stays whose name shows that it is temporary.
            drop(fs::remove_file(temporary(&self.path)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(folder: &Path, name: &str) -> String {
        fs::read_to_string(folder.join(name)).unwrap()
    }

    #[test]
    fn room_is_reserved_at_the_start_and_released_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = SummaryFile::in_folder(folder.path());
        file.reserve().unwrap();
        assert_eq!(text(folder.path(), "summary.json.tmp").len(), ROOM);
        let mut summary = Summary {
            venue: "a rather long name".to_owned(),
            ..Summary::default()
        };
        file.put(summary.clone()).unwrap();
        summary.venue = "short".to_owned();
        file.put(summary.clone()).unwrap();
        assert_eq!(text(folder.path(), "summary.json.tmp").len(), ROOM);
        let recording = RecordingSummary {
            file: "hall.mcap".into(),
            lost: 3,
            filled: 0,
            holes: 0,
            failure: None,
        };
        file.finish(Some(&recording)).unwrap();
        summary.timing.recording = Some(recording);
        assert_eq!(text(folder.path(), "summary.json"), summary.to_json());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_run_without_a_summary_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = SummaryFile::in_folder(folder.path());
        file.reserve().unwrap();
        file.finish(None).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
