//! `summary.json`: its room is kept from the start, so that a disk which is full by the end can still hold it.

use std::fs::{self, File};
use std::io::{Seek as _, SeekFrom, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_node::process::say;

use crate::export::summary::{RecordingSummary, Summary};
use crate::export::unfinished::{sync_folder_of, temporary};

/// Room that is kept, bytes: hundreds of people and dozens of viewpoints.
const ROOM: usize = 64 << 10;

/// The summary of a run under way. Dropped before it is finished, it leaves nothing.
#[derive(Debug)]
pub(in crate::node) struct SummaryFile {
    path: PathBuf,
    file: Option<File>,
    /// How much room there is without asking the disk for more.
    room: usize,
    /// Where what was put ends.
    end: u64,
    summary: Option<Summary>,
}

impl SummaryFile {
    /// The summary that will be in `folder`. Makes nothing.
    pub(in crate::node) fn in_folder(folder: &Path) -> Self {
        Self {
            path: folder.join("summary.json"),
            file: None,
            room: 0,
            end: 0,
            summary: None,
        }
    }

    /// Keeps room for it. Without any the run begins all the same: there may be some by its end.
    ///
    /// # Errors
    /// When the temporary file is there already, or cannot be made.
    pub(in crate::node) fn reserve(&mut self) -> anyhow::Result<()> {
        let making = || format!("making {}", self.path.display());
        let mut file = File::create_new(temporary(&self.path)).with_context(making)?;
        let kept = file.write_all(&vec![b' '; ROOM]);
        match kept.and_then(|()| file.sync_data()) {
            Ok(()) => self.room = ROOM,
            Err(error) => say(format_args!(
                "no room is kept for {}: {error}",
                self.path.display()
            )),
        }
        self.file = Some(file);
        Ok(())
    }

    /// Writes what the run has come to. It has its name when it is finished.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(in crate::node) fn put(&mut self, summary: Summary) -> anyhow::Result<()> {
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
            // Its room stays until it is finished: the next one may be longer.
            bytes.resize(bytes.len().max(self.room), b' ');
            file.write_all(&bytes).with_context(writing)?;
            file.sync_data().with_context(writing)?;
        }
        self.summary = Some(summary);
        Ok(())
    }

    /// Says what the recording has come to in the end, what failed after the summary was put together, too,
    /// and gives the file its name. A run without a summary leaves none.
    ///
    /// # Errors
    /// When it cannot be written or renamed.
    pub(in crate::node) fn finish(
        mut self,
        recording: Option<&RecordingSummary>,
    ) -> anyhow::Result<()> {
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
            // Nobody is left to tell: at worst a file stays that says by its name what it is.
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
    fn room_is_kept_from_the_start_and_given_back_at_the_end() {
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
    fn a_run_that_has_nothing_to_sum_up_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = SummaryFile::in_folder(folder.path());
        file.reserve().unwrap();
        file.finish(None).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
