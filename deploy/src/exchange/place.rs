//! What is meant by a word that names a run, its poses, or a recording.

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail, ensure};
use farfield_export::edits::EditList;
use farfield_export::{EditsFile, ExportError};
use farfield_fusion::export::salvage::SMOOTH;
use farfield_fusion::export::unfinished::temporary;
use farfield_fusion::node::{is_written_to, was_killed};
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
    /// In the folder of a run that goes on, as far as it has come.
    GoingOn {
        /// Its poses, whose last line may be half.
        poses: PathBuf,
        /// The folder of the run, above that of smoothed poses.
        run: PathBuf,
    },
    /// In a recording.
    Recording(PathBuf),
}

impl Place {
    /// What `word` names: the folder of a run, also of one that goes on, a file of poses, or a recording.
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
        if let Some(place) = Self::going_on(word) {
            return Ok(place);
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

    /// What `word` names, where that is of a run that goes on and has poses: its files have no names of their own yet.
    fn going_on(word: &Path) -> Option<Self> {
        let folder = if word.is_dir() { word } else { folder_of(word) };
        let poses = folder.join(POSES);
        let run = run_of(folder);
        let is_named = word.is_dir() || word.file_name() == poses.file_name();
        if !is_named || run.join(SUMMARY).is_file() || !is_written_to(run) {
            return None;
        }
        let places = [temporary(&poses), poses];
        let poses = places.into_iter().find(|path| path.is_file())?;
        let run = run.to_owned();
        Some(Self::GoingOn { poses, run })
    }

    /// Whether its poses are no more where they were: at its end a run gives its files their names.
    pub(super) fn has_moved(&self) -> bool {
        matches!(self, Self::GoingOn { poses, .. } if !poses.is_file())
    }

    /// The folder of the run that goes on beside a recording: what is shown live follows the edits of the run, not those of
    /// the recording.
    pub(super) fn run_beside(&self) -> Option<&Path> {
        match self {
            Self::Recording(path) => Some(folder_of(path)).filter(|folder| is_written_to(folder)),
            Self::Run { .. } | Self::GoingOn { .. } => None,
        }
    }

    /// Names and edits of its people. Smoothed poses have those of their run.
    pub(super) fn edits(&self) -> EditsFile {
        match self {
            Self::GoingOn { run, .. } => EditsFile::of_run(run),
            Self::Run { summary, .. } => EditsFile::of_run(folder_of(summary)),
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
            Self::GoingOn { poses, .. } => folder_of(poses).join(FOLDER),
            Self::Recording(path) => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                path.with_file_name(format!("{stem}-{FOLDER}"))
            }
        }
    }
}

/// The folder in which a file is.
pub(super) fn folder_of(file: &Path) -> &Path {
    let folder = file.parent().filter(|it| !it.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// The folder of the run whose poses are in `folder`: smoothed ones have a folder of their own in it.
fn run_of(folder: &Path) -> &Path {
    if folder.file_name().is_some_and(|name| name == SMOOTH) {
        folder_of(folder)
    } else {
        folder
    }
}

/// The poses, and the folder in which they are.
fn poses_of(run: &Path) -> anyhow::Result<(PathBuf, PathBuf)> {
    if run.is_dir() {
        let poses = run.join(POSES);
        if !poses.is_file() {
            let why = why_without_poses(run);
            bail!("{}: there is no {POSES} in it: {why}", run.display());
        }
        return Ok((poses, run.to_owned()));
    }
    if !run.is_file() {
        bail!(
            "{}: there is nothing of this name: expected the folder of a run, or a recording",
            run.display()
        );
    }
    Ok((run.to_owned(), folder_of(run).to_owned()))
}

fn why_without_poses(folder: &Path) -> String {
    let run = run_of(folder);
    if is_written_to(run) {
        "its run has just begun: try again when somebody is seen".to_owned()
    } else if was_killed(run) && temporary(&folder.join(POSES)).is_file() {
        format!(
            "its run was killed: `farfield run VENUE --out {}` makes its files whole, and writes no others there",
            run.display()
        )
    } else {
        "expected the folder of a run, or a recording".to_owned()
    }
}

/// What the run says of itself: beside the poses, or above those that were smoothed.
fn summary_of(folder: &Path) -> anyhow::Result<PathBuf> {
    let places = [folder, run_of(folder)].map(|folder| folder.join(SUMMARY));
    let found = places.into_iter().find(|path| path.is_file());
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

    use farfield_fusion::node::FolderClaim;

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
    fn a_run_that_goes_on_has_the_poses_so_far_and_its_own_edits() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("out");
        let claim = FolderClaim::take(Some(&run), "hall").unwrap();
        let error = Place::of(&run).unwrap_err().to_string();
        assert!(error.contains("its run has just begun"), "{error}");
        let smooth = run.join(SMOOTH);
        fs::create_dir(&smooth).unwrap();
        for folder in [&run, &smooth] {
            fs::write(folder.join("poses.jsonl.tmp"), "").unwrap();
        }
        fs::write(run.join("summary.json.tmp"), " ").unwrap();
        for (word, of) in [(&run, &run), (&run.join(POSES), &run), (&smooth, &smooth)] {
            let place = Place::of(word).unwrap();
            let poses = of.join("poses.jsonl.tmp");
            let expected = Place::GoingOn {
                poses,
                run: run.clone(),
            };
            assert_eq!(place, expected, "{}", word.display());
            assert_eq!(place.edits().path(), run.join("edits.jsonl"));
        }
        // At its end files get their names one by one.
        let place = Place::of(&run).unwrap();
        fs::rename(run.join("poses.jsonl.tmp"), run.join(POSES)).unwrap();
        let (before, place) = (place, Place::of(&run).unwrap());
        assert!(before.has_moved() && !place.has_moved());
        assert!(matches!(place, Place::GoingOn { poses, .. } if poses == run.join(POSES)));
        fs::rename(run.join("summary.json.tmp"), run.join(SUMMARY)).unwrap();
        assert!(matches!(Place::of(&run).unwrap(), Place::Run { .. }));
        drop(claim);
    }

    #[test]
    fn what_a_killed_run_has_left_is_no_run_that_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["run.lock", "poses.jsonl.tmp", "summary.json.tmp"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let error = Place::of(folder.path()).unwrap_err().to_string();
        let remedy = format!("--out {}` makes its files whole", folder.path().display());
        assert!(
            error.contains("its run was killed") && error.contains(&remedy),
            "{error}"
        );
        fs::remove_file(folder.path().join("run.lock")).unwrap();
        let error = Place::of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("expected the folder of a run"), "{error}");
    }

    #[test]
    fn a_recording_knows_of_the_run_that_goes_on_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("out");
        let claim = FolderClaim::take(Some(&run), "hall").unwrap();
        fs::write(run.join("hall.mcap"), "").unwrap();
        let place = Place::of(&run.join("hall.mcap")).unwrap();
        assert_eq!(place.run_beside(), Some(&*run));
        drop(claim);
        assert_eq!(place.run_beside(), None);
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
