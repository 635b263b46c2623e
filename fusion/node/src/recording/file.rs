//! The file of a recording: a new file, or a new one in a folder, and what is known of a recording without an end.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf, is_separator};

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_fusion::export::EDITS;
use farfield_node::clock;
use farfield_node::files::obstacle_of_folder;

use crate::output::claim::is_written_to;
use crate::output::made_folders::MadeFolders;

/// The name of a recording in the folder of its run.
pub const OWN_RECORDING: &str = "recording.mcap";

/// Whether a path is a folder for recordings, each a new file in it: an existing folder, or a path with a slash at its end, which
/// is created.
pub fn is_for_many(path: &Path) -> bool {
    let last = path.as_os_str().as_encoded_bytes().last();
    path.is_dir() || last.is_some_and(|&byte| is_separator(char::from(byte)))
}

/// Refuses a place where no recording can be created. Creates nothing.
///
/// # Errors
/// Names the path and its fault: an existing file, existing edits of a recording of that name, a missing parent folder, or a file
/// in place of a folder.
pub fn check_place(path: &Path) -> anyhow::Result<()> {
    let shown = path.display();
    if is_for_many(path) {
        if let Some(file) = obstacle_of_folder(path) {
            bail!(
                "recordings in {shown}: {} is a file, expected a folder",
                file.display()
            );
        }
        return Ok(());
    }
    ensure!(
        fs::symlink_metadata(path).is_err(),
        "recording {shown}: the file exists already; name another, or a folder"
    );
    let edits = path.with_extension(EDITS);
    ensure!(
        fs::symlink_metadata(&edits).is_err(),
        "recording {shown}: {} exists already, edits of another recording; remove it or name another",
        edits.display()
    );
    let parent = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    ensure!(
        parent.is_dir(),
        "recording {shown}: there is no folder {}; create it, or name a folder for recordings with a slash at its end, which is created",
        parent.display()
    );
    Ok(())
}

/// The place of a run's recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum RecordingPlace {
    /// In the folder of the results.
    Results,
    /// In this file, or in a new one in this folder.
    At(PathBuf),
}

impl RecordingPlace {
    /// The place that the operator gave; by default the folder of the results.
    pub(crate) fn from_option(path: Option<PathBuf>) -> Self {
        path.map_or(Self::Results, Self::At)
    }

    /// The file, or the folder for recordings, of a run with its results in `results`.
    pub(crate) fn path(&self, results: &Path) -> PathBuf {
        match self {
            Self::Results => results.join(OWN_RECORDING),
            Self::At(path) => path.clone(),
        }
    }
}

/// The file of a recording.
#[derive(Debug)]
pub(crate) struct RecordingFile {
    /// Its path.
    pub(crate) path: PathBuf,
    /// The file, new and empty.
    pub(crate) file: File,
    /// The folders created for it.
    pub(crate) made: MadeFolders,
}

impl RecordingFile {
    /// Creates the file `requested`. If that is a folder ([`is_for_many`]), creates it if it is missing, and in it a file named after
    /// `venue` and the time (UTC): `hall-3_2026-03-01_18-30-05.mcap`.
    ///
    /// # Errors
    /// The file exists, or it or its folder cannot be created; nothing is left then.
    pub(crate) fn make(requested: &Path, venue: &str) -> anyhow::Result<Self> {
        if !is_for_many(requested) {
            let file = File::create_new(requested);
            let file =
                file.with_context(|| format!("making the recording {}", requested.display()))?;
            return Ok(Self {
                path: requested.to_owned(),
                file,
                made: MadeFolders::default(),
            });
        }
        let made = MadeFolders::with_parents(requested)?;
        let name = format!("{venue}_{}", date(clock::unix_time().as_secs()));
        for n in 1..1000 {
            let path = requested.join(if n == 1 {
                format!("{name}.mcap")
            } else {
                format!("{name}_{n}.mcap")
            });
            match File::create_new(&path) {
                Ok(file) => return Ok(Self { path, file, made }),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => {
                    let making = || format!("making the recording {}", path.display());
                    return Err(error).with_context(making);
                }
            }
        }
        Err(anyhow!("{} is full of recordings", requested.display()))
    }
}

/// `YYYY-MM-DD_hh-mm-ss` in UTC of a Unix time (Howard Hinnant, "chrono-compatible low-level date algorithms",
/// `civil_from_days`, for years after 1970).
fn date(unix_s: u64) -> String {
    let (days, second) = (unix_s / 86_400 + 719_468, unix_s % 86_400);
    let (era, of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (of_era - of_era / 1_460 + of_era / 36_524 - of_era / 146_096) / 365;
    let day_of_year = of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let shifted_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * shifted_month + 2) / 5 + 1;
    let month = (shifted_month + 2) % 12 + 1;
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    let (h, m, s) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}-{month:02}-{day:02}_{h:02}-{m:02}-{s:02}")
}

/// Describes a recording at `path` without an end, of which `read` of `all` bytes can be read. Outside of the folder of a run it
/// is unknown whether the recording is still being written.
pub fn without_end(path: &Path, [read, all]: [u64; 2]) -> String {
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
    if is_written_to(folder.unwrap_or(Path::new("."))) {
        format!("its run is still recording: its first {read} bytes are read")
    } else if read < all {
        format!("the recording was cut off: {read} of its {all} bytes can be read")
    } else {
        format!(
            "the recording has no end: it is still being written, or its writer was killed; all of its {all} bytes can be read"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::output::claim::FolderClaim;

    #[test]
    fn dates_match_the_calendar() {
        // `date -u -d @N`.
        assert_eq!(date(0), "1970-01-01_00-00-00");
        assert_eq!(date(951_827_696), "2000-02-29_12-34-56");
        assert_eq!(date(4_107_542_399), "2100-02-28_23-59-59");
        assert_eq!(date(4_107_542_400), "2100-03-01_00-00-00");
    }

    #[test]
    fn the_default_place_is_the_folder_of_the_results() {
        let path = |place: Option<&str>| {
            let place = RecordingPlace::from_option(place.map(PathBuf::from));
            place.path(Path::new("out"))
        };
        assert_eq!(path(None), Path::new("out/recording.mcap"));
        assert_eq!(path(Some("recordings/")), Path::new("recordings/"));
    }

    #[test]
    fn a_recording_never_replaces_a_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.mcap");
        check_place(&path).unwrap();
        drop(RecordingFile::make(&path, "hall").unwrap());
        assert!(
            check_place(&path)
                .unwrap_err()
                .to_string()
                .contains("exists already")
        );
        assert!(RecordingFile::make(&path, "hall").is_err());
        assert!(check_place(&dir.path().join("none/a.mcap")).is_err());
    }

    #[test]
    fn a_slash_at_the_end_creates_a_folder_for_recordings() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("new/recordings/");
        assert!(is_for_many(&folder) && !is_for_many(&dir.path().join("new/recordings")));
        check_place(&folder).unwrap();
        assert!(!folder.exists(), "the check creates nothing");
        let RecordingFile { path, made, .. } = RecordingFile::make(&folder, "hall").unwrap();
        assert_eq!(path.parent().unwrap(), folder);
        fs::remove_file(path).unwrap();
        drop(made);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_file_with_a_slash_appended_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("a.mcap"), "mine").unwrap();
        for name in ["a.mcap/", "a.mcap/deeper/"] {
            let refused = check_place(&dir.path().join(name)).unwrap_err().to_string();
            assert!(refused.contains("a.mcap is a file"), "{refused}");
        }
    }

    #[test]
    fn existing_edits_of_another_recording_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("a.edits.jsonl"), "").unwrap();
        let refused = check_place(&dir.path().join("a.mcap")).unwrap_err();
        assert!(refused.to_string().contains("a.edits.jsonl"), "{refused}");
        check_place(&dir.path().join("b.mcap")).unwrap();
    }

    #[test]
    fn each_recording_gets_its_own_file_in_a_folder() {
        let dir = tempfile::tempdir().unwrap();
        check_place(dir.path()).unwrap();
        let [first, second] = [1, 2].map(|_| RecordingFile::make(dir.path(), "hall").unwrap().path);
        assert_ne!(first, second);
        for path in [first, second] {
            let name = path.file_name().unwrap().to_str().unwrap();
            assert!(name.starts_with("hall_20"), "{name}");
        }
    }

    #[test]
    fn only_a_recording_that_cannot_be_read_completely_is_cut_off() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("out/hall.mcap");
        let text = |read| without_end(&recording, [read, 900]);
        assert_eq!(
            text(640),
            "the recording was cut off: 640 of its 900 bytes can be read"
        );
        assert!(text(900).contains("all of its 900 bytes"));
        let claim = FolderClaim::take(recording.parent(), "hall").unwrap();
        for read in [640, 900] {
            let text = text(read);
            assert!(text.contains(&format!("first {read} bytes")), "{text}");
        }
        drop(claim);
    }
}
