//! Where a recording goes: a file that is not there yet, or a new one in a folder.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use farfield_node::clock;

use crate::export::EDITS;

/// Refuses a place that can take no recording. Makes nothing.
///
/// # Errors
/// Names the path: it is there and no folder, edits of a recording of that name are, or the folder above it is not there.
pub fn check_place(path: &Path) -> anyhow::Result<()> {
    if path.is_dir() {
        return Ok(());
    }
    let shown = path.display();
    ensure!(
        fs::symlink_metadata(path).is_err(),
        "recording {shown}: the file is there already; name another, or a folder"
    );
    let edits = path.with_extension(EDITS);
    ensure!(
        fs::symlink_metadata(&edits).is_err(),
        "recording {shown}: {} is there already, edits of another recording; remove it or name another",
        edits.display()
    );
    let parent = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    ensure!(
        parent.is_dir(),
        "recording {shown}: there is no folder {}",
        parent.display()
    );
    Ok(())
}

/// The file of a recording.
#[derive(Debug)]
pub(in crate::node) struct RecordingFile {
    /// Its path.
    pub(in crate::node) path: PathBuf,
    /// The file, new and empty.
    pub(in crate::node) file: File,
}

impl RecordingFile {
    /// Makes the file `asked`, or when that is a folder, one in it named after `venue` and the time
    /// (UTC): `hall-3_2026-03-01_18-30-05.mcap`.
    ///
    /// # Errors
    /// When the file is there already or cannot be made.
    pub(in crate::node) fn make(asked: &Path, venue: &str) -> anyhow::Result<Self> {
        if !asked.is_dir() {
            let file = File::create_new(asked);
            let file = file.with_context(|| format!("making the recording {}", asked.display()))?;
            return Ok(Self {
                path: asked.to_owned(),
                file,
            });
        }
        let name = format!("{venue}_{}", date(clock::unix_time().as_secs()));
        for n in 1..1000 {
            let path = asked.join(if n == 1 {
                format!("{name}.mcap")
            } else {
                format!("{name}_{n}.mcap")
            });
            match File::create_new(&path) {
                Ok(file) => return Ok(Self { path, file }),
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => {
                    let making = || format!("making the recording {}", path.display());
                    return Err(error).with_context(making);
                }
            }
        }
        Err(anyhow!("{} is full of recordings", asked.display()))
    }
}

/// `YYYY-MM-DD_hh-mm-ss` in UTC of a Unix time. (Howard Hinnant, "chrono-compatible low-level date
/// algorithms", `civil_from_days`, for years after 1970.)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        // `date -u -d @N`.
        assert_eq!(date(0), "1970-01-01_00-00-00");
        assert_eq!(date(951_827_696), "2000-02-29_12-34-56");
        assert_eq!(date(4_107_542_399), "2100-02-28_23-59-59");
        assert_eq!(date(4_107_542_400), "2100-03-01_00-00-00");
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
                .contains("there already")
        );
        assert!(RecordingFile::make(&path, "hall").is_err());
        assert!(check_place(&dir.path().join("none/a.mcap")).is_err());
    }

    #[test]
    fn a_recording_never_takes_over_the_edits_of_another() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("a.edits.jsonl"), "").unwrap();
        let refused = check_place(&dir.path().join("a.mcap")).unwrap_err();
        assert!(refused.to_string().contains("a.edits.jsonl"), "{refused}");
        check_place(&dir.path().join("b.mcap")).unwrap();
    }

    #[test]
    fn a_folder_gets_a_file_of_its_own_for_each_recording() {
        let dir = tempfile::tempdir().unwrap();
        check_place(dir.path()).unwrap();
        let [first, second] = [1, 2].map(|_| RecordingFile::make(dir.path(), "hall").unwrap().path);
        assert_ne!(first, second);
        for path in [first, second] {
            let name = path.file_name().unwrap().to_str().unwrap();
            assert!(name.starts_with("hall_20"), "{name}");
        }
    }
}
