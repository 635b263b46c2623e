//! Finds the run, the poses, or the recording that an argument names.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Take};
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail, ensure};
use farfield_export::edits::EditList;
use farfield_export::{EditsFile, ExportError};
use farfield_fusion::export::salvage::SMOOTH;
use farfield_fusion::export::unfinished::temporary;
use farfield_fusion_node::{is_written_to, was_killed};
use farfield_node::process::say;

/// File names of the poses and the summary of a run.
pub(crate) const POSES: &str = "poses.jsonl";
pub(super) const SUMMARY: &str = "summary.json";
/// Folder for exports inside a run; for a recording `hall.mcap` it is `hall-export` next to it.
const FOLDER: &str = "export";

/// Location of poses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Place {
    /// In the folder of a run.
    Run {
        poses: PathBuf,
        summary: PathBuf,
        /// The folder of the poses.
        folder: PathBuf,
    },
    /// In the folder of a run in progress.
    InProgress {
        /// Its poses; the last line may be incomplete.
        poses: PathBuf,
        /// The folder of the run, above that of smoothed poses.
        run: PathBuf,
    },
    /// In a recording.
    Recording(PathBuf),
}

impl Place {
    /// Finds the folder of a run, also of one in progress, a file of poses, or a recording.
    ///
    /// # Errors
    /// When there is none of these.
    pub(super) fn find(word: &Path) -> anyhow::Result<Self> {
        if !word.is_dir() && word.extension().is_some_and(|it| it == "mcap") {
            ensure!(
                word.is_file(),
                "{}: the recording does not exist",
                word.display()
            );
            return Ok(Self::Recording(word.to_owned()));
        }
        if let Some(place) = Self::in_progress(word) {
            return Ok(place);
        }
        let (poses, folder) = poses_of(word)?;
        ensure!(
            poses.extension().is_some_and(|it| it == "jsonl"),
            "{}: found another kind of file, expected the folder of a run, its {POSES}, or a recording (.mcap)",
            word.display()
        );
        let summary = summary_of(&folder)?;
        Ok(Self::Run {
            poses,
            summary,
            folder,
        })
    }

    /// The run in progress that `word` names, if it has poses; its files still have temporary names.
    fn in_progress(word: &Path) -> Option<Self> {
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
        Some(Self::InProgress { poses, run })
    }

    /// Whether its poses have moved: at its end a run renames its files.
    pub(super) fn has_moved(&self) -> bool {
        matches!(self, Self::InProgress { poses, .. } if !poses.is_file())
    }

    /// The folder of the run in progress next to a recording: pages and streams use the edits of the run, not those of
    /// the recording.
    pub(super) fn run_in_progress(&self) -> Option<&Path> {
        match self {
            Self::Recording(path) => Some(folder_of(path)).filter(|folder| is_written_to(folder)),
            Self::Run { .. } | Self::InProgress { .. } => None,
        }
    }

    /// Names and edits of its people. Smoothed poses use those of their run.
    pub(super) fn edits(&self) -> EditsFile {
        match self {
            Self::InProgress { run, .. } => EditsFile::of_run(run),
            Self::Run { summary, .. } => EditsFile::of_run(folder_of(summary)),
            Self::Recording(path) => EditsFile::of_recording(path),
        }
    }

    /// Reads [`Self::edits`], and reports an incomplete last line.
    ///
    /// # Errors
    /// As [`EditsFile::read`].
    pub(super) fn read_edits(&self) -> Result<EditList, ExportError> {
        let edits = self.edits();
        let list = edits.read()?;
        if list.has_torn_line() {
            say(format_args!(
                "{}: its last line is incomplete and ignored; the next edit replaces it",
                edits.path().display()
            ));
        }
        Ok(list)
    }

    /// The default folder for exports.
    pub(super) fn export_folder(&self) -> PathBuf {
        match self {
            Self::Run { folder, .. } => folder.join(FOLDER),
            Self::InProgress { poses, .. } => folder_of(poses).join(FOLDER),
            Self::Recording(path) => {
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                path.with_file_name(format!("{stem}-{FOLDER}"))
            }
        }
    }
}

/// The folder of a file.
pub(super) fn folder_of(file: &Path) -> &Path {
    let folder = file.parent().filter(|it| !it.as_os_str().is_empty());
    folder.unwrap_or(Path::new("."))
}

/// The folder of the run whose poses are in `folder`; smoothed ones have a subfolder.
fn run_of(folder: &Path) -> &Path {
    if folder.file_name().is_some_and(|name| name == SMOOTH) {
        folder_of(folder)
    } else {
        folder
    }
}

/// The poses, and their folder.
fn poses_of(run: &Path) -> anyhow::Result<(PathBuf, PathBuf)> {
    if run.is_dir() {
        let poses = run.join(POSES);
        if !poses.is_file() {
            let why = why_without_poses(run);
            bail!("{}: found no {POSES} in it: {why}", run.display());
        }
        return Ok((poses, run.to_owned()));
    }
    if !run.is_file() {
        bail!(
            "{}: it does not exist: expected the folder of a run, or a recording",
            run.display()
        );
    }
    Ok((run.to_owned(), folder_of(run).to_owned()))
}

fn why_without_poses(folder: &Path) -> String {
    let run = run_of(folder);
    if is_written_to(run) {
        "the run has just begun: try again when a person is tracked".to_owned()
    } else if was_killed(run) && temporary(&folder.join(POSES)).is_file() {
        format!(
            "the run was killed: `farfield run VENUE --out {}` completes its files, and writes no others there",
            run.display()
        )
    } else {
        "expected the folder of a run, or a recording".to_owned()
    }
}

/// The summary of the run: next to the poses, or above the folder of smoothed ones.
fn summary_of(folder: &Path) -> anyhow::Result<PathBuf> {
    let places = [folder, run_of(folder)].map(|folder| folder.join(SUMMARY));
    let found = places.into_iter().find(|path| path.is_file());
    found.ok_or_else(|| {
        anyhow!(
            "{}: found no {SUMMARY} next to the poses: it contains their rate",
            folder.display()
        )
    })
}

/// Bytes searched at once, from the end: a few poses.
const BLOCK: usize = 16 << 10;

/// Opens the poses at `path` in their current state, up to the last whole line.
///
/// # Errors
/// When they cannot be opened or read.
pub(super) fn whole_lines(path: &Path) -> io::Result<Take<File>> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let end = end_of_lines(&mut file, length)?;
    file.seek(SeekFrom::Start(0))?;
    Ok(file.take(end))
}

/// The end of the last whole line among the first `length` bytes; 0 without one.
fn end_of_lines(file: &mut (impl Read + Seek), length: u64) -> io::Result<u64> {
    let mut block = [0; BLOCK];
    let mut end = length;
    while end > 0 {
        let start = end.saturating_sub(BLOCK as u64);
        let part = &mut block[..(end - start) as usize];
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(part)?;
        if let Some(at) = part.iter().rposition(|&byte| byte == b'\n') {
            return Ok(start + at as u64 + 1);
        }
        end = start;
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use farfield_fusion_node::FolderClaim;

    use super::*;

    #[test]
    fn smoothed_poses_use_edits_of_the_run_and_recordings_their_own() {
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
            let place = Place::find(&run).unwrap();
            assert_eq!(place.edits().path(), at("edits.jsonl"), "{}", run.display());
        }
        let place = Place::find(&at("hall.mcap")).unwrap();
        assert_eq!(place.edits().path(), at("hall.edits.jsonl"));
        assert_eq!(place.export_folder(), at("hall-export"));
    }

    #[test]
    fn a_run_in_progress_has_poses_and_edits() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("out");
        let claim = FolderClaim::take(Some(&run), "hall").unwrap();
        let error = Place::find(&run).unwrap_err().to_string();
        assert!(error.contains("has just begun"), "{error}");
        let smooth = run.join(SMOOTH);
        fs::create_dir(&smooth).unwrap();
        for folder in [&run, &smooth] {
            fs::write(folder.join("poses.jsonl.tmp"), "").unwrap();
        }
        fs::write(run.join("summary.json.tmp"), " ").unwrap();
        for (word, of) in [(&run, &run), (&run.join(POSES), &run), (&smooth, &smooth)] {
            let place = Place::find(word).unwrap();
            let poses = of.join("poses.jsonl.tmp");
            let expected = Place::InProgress {
                poses,
                run: run.clone(),
            };
            assert_eq!(place, expected, "{}", word.display());
            assert_eq!(place.edits().path(), run.join("edits.jsonl"));
        }
        // At the end of the run files are renamed one by one.
        let place = Place::find(&run).unwrap();
        fs::rename(run.join("poses.jsonl.tmp"), run.join(POSES)).unwrap();
        let (before, place) = (place, Place::find(&run).unwrap());
        assert!(before.has_moved() && !place.has_moved());
        assert!(matches!(place, Place::InProgress { poses, .. } if poses == run.join(POSES)));
        fs::rename(run.join("summary.json.tmp"), run.join(SUMMARY)).unwrap();
        assert!(matches!(Place::find(&run).unwrap(), Place::Run { .. }));
        drop(claim);
    }

    #[test]
    fn files_of_a_killed_run_are_no_run_in_progress() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["run.lock", "poses.jsonl.tmp", "summary.json.tmp"] {
            fs::write(folder.path().join(name), "").unwrap();
        }
        let error = Place::find(folder.path()).unwrap_err().to_string();
        let remedy = format!("--out {}`", folder.path().display());
        assert!(
            error.contains("killed") && error.contains(&remedy),
            "{error}"
        );
        fs::remove_file(folder.path().join("run.lock")).unwrap();
        let error = Place::find(folder.path()).unwrap_err().to_string();
        assert!(!error.contains("killed"), "{error}");
    }

    #[test]
    fn a_recording_finds_its_run_in_progress() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("out");
        let claim = FolderClaim::take(Some(&run), "hall").unwrap();
        fs::write(run.join("hall.mcap"), "").unwrap();
        let place = Place::find(&run.join("hall.mcap")).unwrap();
        assert_eq!(place.run_in_progress(), Some(&*run));
        drop(claim);
        assert_eq!(place.run_in_progress(), None);
    }

    #[test]
    fn other_files_and_folders_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = Place::find(folder.path()).unwrap_err().to_string();
        assert!(error.contains("poses.jsonl"), "{error}");
        fs::write(folder.path().join(POSES), "").unwrap();
        let error = Place::find(folder.path()).unwrap_err().to_string();
        assert!(error.contains("summary.json"), "{error}");
        let error = Place::find(Path::new("hall.mcap")).unwrap_err();
        assert!(error.to_string().contains("hall.mcap"), "{error}");
    }

    fn read(content: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.jsonl.tmp");
        std::fs::write(&path, content).unwrap();
        let mut lines = String::new();
        let mut file = whole_lines(&path).unwrap();
        file.read_to_string(&mut lines).unwrap();
        lines
    }

    #[test]
    fn an_incomplete_last_line_is_not_read() {
        for (content, lines) in [
            ("", ""),
            ("{\"ti", ""),
            ("{}\n", "{}\n"),
            ("{}\n{}\n{\"tick\":", "{}\n{}\n"),
        ] {
            assert_eq!(read(content), lines, "{content:?}");
        }
    }

    #[test]
    fn an_incomplete_line_may_be_longer_than_a_block() {
        let long = "x".repeat(3 * BLOCK);
        assert_eq!(read(&long), "");
        let whole = format!("{long}\n{}\n", &long[..BLOCK - 1]);
        assert_eq!(read(&format!("{whole}{long}")), whole);
        assert_eq!(read(&whole), whole);
    }
}
