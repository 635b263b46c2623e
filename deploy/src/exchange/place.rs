//! What is meant by a word that names a run, its poses, or a recording.

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail, ensure};
use farfield_export::edits::EditList;
use farfield_export::{EditsFile, ExportError};
use farfield_fusion::export::salvage::SMOOTH;
use farfield_node::process::say;

/// What a run calls its poses, and what it says of itself.
pub(crate) const POSES: &str = "poses.jsonl";
pub(super) const SUMMARY: &str = "summary.json";
/// Where exports go, in the folder of a run; of a recording `hall.mcap` beside it, `hall-export`.
const FOLDER: &str = "export";

/// Where poses are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Place {
    /// In a run's folder.
    Run {
        /// Its poses.
        poses: PathBuf,
        /// What it says of itself.
        summary: PathBuf,
        /// The folder of the poses.
        folder: PathBuf,
    },
    /// In a recording.
    Recording(PathBuf),
}

impl Place {
    /// What `word` names: the folder of a run, a file of poses, or a recording.
    ///
    /// # Errors
    /// When nothing of the kind is there.
    pub(super) fn of(word: &Path) -> anyhow::Result<Self> {
        if !word.is_dir() && word.extension().is_some_and(|it| it == "mcap") {
            ensure!(
                word.is_file(),
                "{}: there is no such recording",
                word.display()
            );
            return Ok(Self::Recording(word.to_owned()));
        }
        let (poses, folder) = poses_of(word)?;
        ensure!(
            poses.extension().is_some_and(|it| it == "jsonl"),
            "{}: this is no file of poses: expected the folder of a run, its {POSES}, or a recording (.mcap)",
            word.display()
        );
        let summary = summary_of(&folder)?;
        Ok(Self::Run {
            poses,
            summary,
            folder,
        })
    }

    /// Names and edits of its people. Smoothed poses have those of their run.
    pub(super) fn edits(&self) -> EditsFile {
        match self {
            Self::Run { summary, .. } => {
                EditsFile::of_run(summary.parent().unwrap_or(Path::new(".")))
            }
            Self::Recording(path) => EditsFile::of_recording(path),
        }
    }

    /// Reads [`Self::edits`], and says when half a line of them is left out.
    ///
    /// # Errors
    /// As [`EditsFile::read`].
    pub(super) fn read_edits(&self) -> Result<EditList, ExportError> {
        let edits = self.edits();
        let list = edits.read()?;
        if list.has_torn_line() {
            say(format_args!(
                "{}: its last line was not written to its end, and is left out; the next edit takes its place",
                edits.path().display()
            ));
        }
        Ok(list)
    }

    /// Where exports go if nobody says otherwise.
    pub(super) fn export_folder(&self) -> PathBuf {
        match self {
            Self::Run { folder, .. } => folder.join(FOLDER),
            Self::Recording(path) => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                path.with_file_name(format!("{stem}-{FOLDER}"))
            }
        }
    }
}

/// The poses, and the folder in which they are.
fn poses_of(run: &Path) -> anyhow::Result<(PathBuf, PathBuf)> {
    if run.is_dir() {
        let poses = run.join(POSES);
        ensure!(
            poses.is_file(),
            "{}: there is no {POSES} in it: expected the folder of a run, or a recording",
            run.display()
        );
        return Ok((poses, run.to_owned()));
    }
    if !run.is_file() {
        bail!(
            "{}: there is nothing of this name: expected the folder of a run, or a recording",
            run.display()
        );
    }
    let folder = run.parent().filter(|it| !it.as_os_str().is_empty());
    Ok((run.to_owned(), folder.unwrap_or(Path::new(".")).to_owned()))
}

/// What the run says of itself: beside the poses, or above those that were smoothed.
fn summary_of(folder: &Path) -> anyhow::Result<PathBuf> {
    let above = folder.file_name().is_some_and(|name| name == SMOOTH);
    let above = above.then(|| folder.parent().unwrap_or(Path::new(".")).join(SUMMARY));
    let places = [Some(folder.join(SUMMARY)), above];
    let found = places.into_iter().flatten().find(|path| path.is_file());
    found.ok_or_else(|| {
        anyhow!(
            "{}: there is no {SUMMARY} beside the poses: it says at which rate they are",
            folder.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn smoothed_poses_and_recordings_have_edits_of_their_own_place() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir(at(SMOOTH)).unwrap();
        for name in [POSES, SUMMARY, "smooth/poses.jsonl", "hall.mcap"] {
            fs::write(at(name), "").unwrap();
        }
        for run in [
            folder.path().to_owned(),
            at(POSES),
            at("smooth/poses.jsonl"),
        ] {
            let place = Place::of(&run).unwrap();
            assert_eq!(place.edits().path(), at("edits.jsonl"), "{}", run.display());
        }
        let place = Place::of(&at("hall.mcap")).unwrap();
        assert_eq!(place.edits().path(), at("hall.edits.jsonl"));
        assert_eq!(place.export_folder(), at("hall-export"));
    }

    #[test]
    fn what_is_no_run_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = Place::of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("there is no poses.jsonl"), "{error}");
        fs::write(folder.path().join(POSES), "").unwrap();
        let error = Place::of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("there is no summary.json"), "{error}");
        let error = Place::of(Path::new("hall.mcap")).unwrap_err().to_string();
        assert!(error.contains("no such recording"), "{error}");
    }
}
