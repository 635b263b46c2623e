//! The sets of files that this edge has received from fusion. A set that was replaced is not
//! accepted again without `--accept-older`. An old copy of fusion's folder, or an obsolete fusion,
//! would hand it out with a valid signature.
//!
//! The history is next to the venue file, one line per set in order of arrival. A set is identified
//! by the BLAKE3 hash of its list entries, so any change makes a new set.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_node::process::say;
use farfield_proto::message::handout::FileList;
use farfield_proto::toml_file::FileError;

/// The newest sets that are kept.
const MAX_SETS: usize = 1000;
const HOUR_S: i64 = 3600;
const DAY_S: i64 = 24 * HOUR_S;

/// The sets received by this edge.
#[derive(Debug)]
pub(super) struct HandoutHistory {
    path: PathBuf,
    /// Hash of each set and its arrival, Unix time in seconds; the current set is last.
    sets: Vec<(blake3::Hash, i64)>,
}

impl HandoutHistory {
    /// Reads the history of the edge with the venue file `venue`; empty without a file. Unreadable
    /// lines (after a power cut) are skipped; the damaged file is set aside and a warning is
    /// printed.
    ///
    /// # Errors
    /// If the file cannot be read; with its name.
    pub(super) fn read(venue: &Path) -> Result<Self, FileError> {
        let mut name = venue.file_name().unwrap_or_default().to_owned();
        name.push(".handouts");
        let path = venue.with_file_name(name);
        let text = match fs::read(&path) {
            Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => {
                let problem = format!("cannot read the history of fusion's files: {error}");
                return Err(FileError::new(path, problem));
            }
        };
        let read = |line: &str| {
            let (hash, at_s) = line.split_once(' ')?;
            Some((hash.parse().ok()?, at_s.parse().ok()?))
        };
        let sets: Vec<_> = text.lines().map(read).collect();
        let torn = sets.iter().position(Option::is_none);
        let sets = sets.into_iter().flatten().collect();
        let this = Self { path, sets };
        if let Some(index) = torn {
            this.set_aside(index + 1);
        }
        Ok(this)
    }

    /// Keeps the damaged file under another name, and its readable lines under the own name.
    fn set_aside(&self, line: usize) {
        let mut aside = self.path.clone().into_os_string();
        aside.push(".damaged");
        let kept = fs::rename(&self.path, &aside).map_err(anyhow::Error::from);
        let kept = kept.and_then(|()| self.write());
        let (path, n) = (self.path.display(), self.sets.len());
        let what = match kept {
            Ok(()) => format!("it is set aside as {}", Path::new(&aside).display()),
            Err(error) => format!("it cannot be set aside: {error:#}"),
        };
        say(format_args!(
            "{path}:{line}: expected the hash of a set of files and the time when it came; {what}; {n} earlier sets of fusion's files are known: older ones would not be detected"
        ));
    }

    /// Refuses a set that was replaced by a newer one; `now_s` is the Unix time in seconds.
    ///
    /// # Errors
    /// A message with the times of arrival and replacement, and the remedy.
    pub(super) fn check(&self, list: &FileList, now_s: i64) -> anyhow::Result<()> {
        let set = fingerprint(list);
        let before = match self.sets.split_last() {
            Some((newest, before)) if newest.0 != set => before,
            _ => return Ok(()),
        };
        let Some(place) = before.iter().rposition(|(known, _)| *known == set) else {
            return Ok(());
        };
        let (came_s, replaced_s) = (self.sets[place].1, self.sets[place + 1].1);
        anyhow::bail!(
            "fusion hands out older files than this edge has had: these came {} and were replaced {}; check that no old copy of fusion, or of its folder, runs. To accept them, use --accept-older, or change anything in fusion's venue file, even a comment (the history is in {})",
            ago(now_s - came_s),
            ago(now_s - replaced_s),
            self.path.display()
        )
    }

    /// Records that the set is current since `now_s`, Unix time in seconds.
    ///
    /// # Errors
    /// If the file cannot be written; with its name.
    pub(super) fn note(&mut self, list: &FileList, now_s: i64) -> anyhow::Result<()> {
        let set = fingerprint(list);
        if self.sets.last().is_some_and(|(newest, _)| *newest == set) {
            return Ok(());
        }
        self.sets.push((set, now_s));
        self.write()
            .with_context(|| format!("writing {}", self.path.display()))
    }

    fn write(&self) -> anyhow::Result<()> {
        let from = self.sets.len().saturating_sub(MAX_SETS);
        let mut text = String::new();
        for (hash, at_s) in &self.sets[from..] {
            writeln!(text, "{} {at_s}", hash.to_hex())?;
        }
        let mut new = self.path.clone().into_os_string();
        // Several edges may fetch into one folder.
        new.push(format!(".{}.part", std::process::id()));
        let mut file = File::create(&new)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&new, &self.path)?;
        Ok(())
    }
}

/// The hash that identifies a set.
fn fingerprint(list: &FileList) -> blake3::Hash {
    let mut hasher = blake3::Hasher::new();
    for file in &list.files {
        let kind = file.kind.name();
        for part in [kind.as_bytes(), file.path.as_bytes(), &file.blake3] {
            hasher.update(&(part.len() as u64).to_le_bytes());
            hasher.update(part);
        }
    }
    hasher.finalize()
}

fn ago(s: i64) -> String {
    match s {
        ..0 => "in the future, by this machine's clock".to_owned(),
        0..HOUR_S => format!("{} min ago", s / 60),
        HOUR_S..DAY_S => format!("{} h ago", s / HOUR_S),
        _ => format!("{} days ago", s / DAY_S),
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::handout::{FileKind, SharedFile};

    use super::*;

    const NOW_S: i64 = 1_790_000_000;

    fn list(calibration: u8) -> FileList {
        let file = |kind, path: &str, hash| SharedFile {
            kind,
            path: path.to_owned(),
            bytes: 7,
            blake3: [hash; 32],
        };
        FileList {
            venue: "hall".to_owned(),
            files: vec![
                file(FileKind::Venue, "", 1),
                file(FileKind::Calibration, "c.toml", calibration),
            ],
        }
    }

    #[test]
    fn replaced_files_are_refused_unless_accepted() {
        let folder = tempfile::tempdir().unwrap();
        let venue = folder.path().join("venue.toml");
        let read = || HandoutHistory::read(&venue).unwrap();
        for (calibration, days) in [(2, 9), (2, 8), (3, 5)] {
            let at_s = NOW_S - days * DAY_S;
            read().check(&list(calibration), at_s).unwrap();
            read().note(&list(calibration), at_s).unwrap();
        }
        read().check(&list(3), NOW_S).unwrap();
        read().check(&list(4), NOW_S).unwrap();
        let refused = read().check(&list(2), NOW_S).unwrap_err().to_string();
        for word in [
            "came 9 days ago",
            "replaced 5 days ago",
            "--accept-older",
            "venue.toml.handouts",
        ] {
            assert!(refused.contains(word), "{word}: {refused}");
        }
        // An accepted set is the newest, and the other one is then older.
        read().note(&list(2), NOW_S).unwrap();
        read().check(&list(2), NOW_S).unwrap();
        read().check(&list(3), NOW_S).unwrap_err();
    }

    #[test]
    fn the_history_has_a_bound() {
        let folder = tempfile::tempdir().unwrap();
        let venue = folder.path().join("venue.toml");
        let mut history = HandoutHistory::read(&venue).unwrap();
        let old = |i: i64| (blake3::hash(&i.to_le_bytes()), i);
        history.sets = (0..).take(MAX_SETS).map(old).collect();
        history.note(&list(2), NOW_S).unwrap();
        let history = HandoutHistory::read(&venue).unwrap();
        assert_eq!(history.sets.len(), MAX_SETS);
    }

    #[test]
    fn a_torn_file_is_set_aside_and_its_readable_lines_count() {
        // Symptom to prevent: after a power cut the unit did not start again.
        let folder = tempfile::tempdir().unwrap();
        let venue = folder.path().join("venue.toml");
        for calibration in [2, 3] {
            let mut history = HandoutHistory::read(&venue).unwrap();
            history.note(&list(calibration), NOW_S).unwrap();
        }
        let path = folder.path().join("venue.toml.handouts");
        let whole = fs::read(&path).unwrap();
        for torn in [&b"0a1b2c"[..], &[0; 40], b"\xff\xfe 7\n"] {
            let torn = [&whole, torn].concat();
            fs::write(&path, &torn).unwrap();
            let history = HandoutHistory::read(&venue).unwrap();
            let refused = history.check(&list(2), NOW_S).unwrap_err().to_string();
            assert!(refused.contains("older files"), "{refused}");
            assert_eq!(fs::read(&path).unwrap(), whole);
            let aside = folder.path().join("venue.toml.handouts.damaged");
            assert_eq!(fs::read(aside).unwrap(), torn);
        }
    }
}
