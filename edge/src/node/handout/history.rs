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
use farfield_node::process::say;
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
    /// That of the edge whose venue file is at `venue`; empty where nothing was handed out yet. Lines that cannot be read, as a
    /// power cut may leave them, are left out: the file as it was is set aside, which is reported.
    ///
    /// # Errors
    /// When the file cannot be read: names it.
    pub(super) fn read(venue: &Path) -> Result<Self, FileError> {
        let mut name = venue.file_name().unwrap_or_default().to_owned();
        name.push(".handouts");
        let path = venue.with_file_name(name);
        let text = match fs::read(&path) {
            Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
            Err(error) if error.kind() == ErrorKind::NotFound => String::new(),
            Err(error) => {
                let problem = format!("cannot read what fusion has handed out so far: {error}");
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

    /// Keeps the damaged file under another name, and what can be read of it under its own.
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
            "{path}:{line}: expected the hash of a set of files and when it came; {what}; of what fusion has handed out so far {n} sets are known: older files than these would not be noticed"
        ));
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
        // Edges may fetch into one folder.
        new.push(format!(".{}.part", std::process::id()));
        let mut file = File::create(&new)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&new, &self.path)?;
        Ok(())
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
    fn what_is_remembered_has_a_bound() {
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
    fn a_torn_file_is_set_aside_and_what_can_be_read_of_it_counts() {
        // Symptom: after a power cut the unit did not start any more.
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
