//! Which sets of files this edge has had from fusion: one that was replaced by another is not taken back without a word, as
//! an old copy of fusion's folder, or a fusion that should not run any more, would hand it out, signed like any other.
//!
//! Kept beside the venue file, a line per set in the order in which they came. A set is known by the BLAKE3 hash of what
//! its list says of every file; so any change at all makes it a new one.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_proto::message::handout::FileList;
use farfield_proto::toml_file::FileError;

/// Sets that are remembered, the newest.
const MAX_SETS: usize = 1000;
const HOUR_S: i64 = 3600;
const DAY_S: i64 = 24 * HOUR_S;

/// The sets that were handed out to this edge.
#[derive(Debug)]
pub(super) struct HandoutHistory {
    path: PathBuf,
    /// Hash of the set and when it came, Unix time in seconds; the one in force last.
    sets: Vec<(blake3::Hash, i64)>,
}

impl HandoutHistory {
    /// That of the edge whose venue file is at `venue`; empty where nothing was handed out yet.
    ///
    /// # Errors
    /// When the file cannot be read: names it, and the line that is none of ours.
    pub(super) fn read(venue: &Path) -> Result<Self, FileError> {
        let mut name = venue.file_name().unwrap_or_default().to_owned();
        name.push(".handouts");
        let path = venue.with_file_name(name);
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => {
                let problem = format!("cannot read what fusion has handed out so far: {error}");
                return Err(FileError::new(path, problem));
            }
        };
        let mut sets = Vec::new();
        for (i, line) in text.lines().enumerate() {
            let set = line
                .split_once(' ')
                .and_then(|(hash, at_s)| Some((hash.parse().ok()?, at_s.parse().ok()?)));
            sets.push(set.ok_or_else(|| {
                let problem = "expected the hash of a set of files and when it came; delete the file to forget what fusion has handed out so far";
                FileError::new(&path, problem).at_line(i + 1)
            })?);
        }
        Ok(Self { path, sets })
    }

    /// Refuses a set that was here before the one in force; `now_s`: Unix time in seconds.
    ///
    /// # Errors
    /// Says when it came, when it was replaced, and what to do.
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
            "fusion hands out older files than this edge has had: these came {} and were replaced {}; does an old copy of fusion, or of its folder, run? If they are meant, say --accept-older, or change anything in fusion's venue file, even a comment ({} keeps account)",
            ago(now_s - came_s),
            ago(now_s - replaced_s),
            self.path.display()
        )
    }

    /// Notes that the set is in force since `now_s`, Unix time in seconds.
    ///
    /// # Errors
    /// When it cannot be written: names the file.
    pub(super) fn note(&mut self, list: &FileList, now_s: i64) -> anyhow::Result<()> {
        let set = fingerprint(list);
        if self.sets.last().is_some_and(|(newest, _)| *newest == set) {
            return Ok(());
        }
        self.sets.push((set, now_s));
        let from = self.sets.len().saturating_sub(MAX_SETS);
        let mut text = String::new();
        for (hash, at_s) in &self.sets[from..] {
            // Writing to a String cannot fail.
            let _infallible = writeln!(text, "{} {at_s}", hash.to_hex());
        }
        let mut new = self.path.clone().into_os_string();
        // Edges may fetch into one folder.
        new.push(format!(".{}.part", std::process::id()));
        let write = || {
            let mut file = File::create(&new)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()?;
            fs::rename(&new, &self.path)
        };
        write().with_context(|| format!("writing {}", self.path.display()))
    }
}

/// What stands for a set.
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
    fn files_that_were_replaced_are_not_taken_back_without_a_word() {
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
        // Once it is accepted it is the newest, and the other is older.
        read().note(&list(2), NOW_S).unwrap();
        read().check(&list(2), NOW_S).unwrap();
        read().check(&list(3), NOW_S).unwrap_err();
    }

    #[test]
    fn what_is_remembered_has_a_bound_and_what_is_damaged_is_named_by_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let venue = folder.path().join("venue.toml");
        let mut history = HandoutHistory::read(&venue).unwrap();
        let old = |i: i64| (blake3::hash(&i.to_le_bytes()), i);
        history.sets = (0..).take(MAX_SETS).map(old).collect();
        history.note(&list(2), NOW_S).unwrap();
        let history = HandoutHistory::read(&venue).unwrap();
        assert_eq!(history.sets.len(), MAX_SETS);
        fs::write(&history.path, "hello\n").unwrap();
        let refused = HandoutHistory::read(&venue).unwrap_err().to_string();
        assert!(refused.contains("venue.toml.handouts:1"), "{refused}");
    }
}
