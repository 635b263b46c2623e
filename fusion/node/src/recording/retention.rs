//! Retention of recordings: recordings of a venue that are older than its file allows are deleted.

use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use farfield_node::clock;
use tracing::{debug, warn};

use farfield_fusion::export::EDITS;
use farfield_fusion::recording::venue_of;

/// Bytes at the start of a file that contain its venue: header and metadata, with the longest names of the most viewpoints.
const HEAD_BYTES: usize = 64 * 1024;

/// Deletes the recordings of `venue` in the folder of `current` that were last written more than `days` ago; 0: none. Keeps
/// `current`, files of other programs, and recordings of other venues, which have their own retention. The edits of a recording
/// are deleted with it.
pub(super) fn delete_old(current: &Path, venue: &str, days: f64) -> Vec<PathBuf> {
    let Ok(keep) = Duration::try_from_secs_f64(days * 86_400.0) else {
        return Vec::new();
    };
    if keep.is_zero() {
        return Vec::new();
    }
    let folder = match current.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let entries = match folder.read_dir() {
        Ok(entries) => entries,
        Err(error) => {
            warn!(folder = %folder.display(), %error, "cannot search for old recordings");
            return Vec::new();
        }
    };
    let own_name = current.file_name();
    let mut deleted = Vec::new();
    for entry in entries.flatten() {
        let path = entry.path();
        if path.file_name() == own_name || !is_old(&path, keep) || !is_of(&path, venue) {
            continue;
        }
        match fs::remove_file(&path) {
            Ok(()) => {
                // Names of people are kept no longer than their poses. Most recordings have no edits.
                drop(fs::remove_file(path.with_extension(EDITS)));
                deleted.push(path);
            }
            Err(error) => {
                warn!(path = %path.display(), %error, "an old recording cannot be deleted");
            }
        }
    }
    if !deleted.is_empty() {
        debug!(?deleted, "old recordings deleted");
    }
    deleted
}

/// Whether `path` is a file last written longer than `keep` ago.
fn is_old(path: &Path, keep: Duration) -> bool {
    let Ok(metadata) = fs::symlink_metadata(path) else {
        return false;
    };
    let modified = metadata.modified().ok();
    let modified = modified.and_then(|time| time.duration_since(std::time::UNIX_EPOCH).ok());
    metadata.is_file() && modified.is_some_and(|at| clock::unix_time().saturating_sub(at) > keep)
}

/// Whether `path` has the extension of a recording, and is one of `venue`.
fn is_of(path: &Path, venue: &str) -> bool {
    if path.extension().is_none_or(|extension| extension != "mcap") {
        return false;
    }
    let mut head = Vec::new();
    let read =
        File::open(path).and_then(|file| file.take(HEAD_BYTES as u64).read_to_end(&mut head));
    read.is_ok() && venue_of(&head).is_some_and(|name| name == venue)
}

#[cfg(test)]
mod tests {
    use std::time::SystemTime;

    use super::*;
    use farfield_fusion::recording::{FACTS, PROFILE};

    fn file(path: &Path, content: &[u8], days: u64) {
        fs::write(path, content).unwrap();
        let file = File::options().write(true).open(path).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(86_400 * days))
            .unwrap();
    }

    /// The first bytes of an MCAP file with this profile and venue.
    fn head(profile: &str, venue: &str) -> Vec<u8> {
        let mut writer = mcap::WriteOptions::new()
            .profile(profile)
            .disable_seeking(true);
        writer = writer.compression(None);
        let mut sink = Vec::new();
        let mut writer = writer.create(mcap::write::NoSeek::new(&mut sink)).unwrap();
        let facts = mcap::records::Metadata {
            name: FACTS.to_owned(),
            metadata: [("venue".to_owned(), venue.to_owned())].into(),
        };
        writer.write_metadata(&facts).unwrap();
        let _sink = writer.into_inner();
        sink
    }

    #[test]
    fn only_old_recordings_of_the_venue_are_deleted() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str| dir.path().join(name);
        let ours = head(PROFILE, "hall");
        for (name, content, days) in [
            ("old.mcap", &ours[..], 9),
            ("current.mcap", &ours, 9),
            ("new.mcap", &ours, 2),
            ("old.txt", &ours, 9),
            ("robot.mcap", &head("ros2", "hall"), 9),
            ("court.mcap", &head(PROFILE, "court"), 9),
            ("text.mcap", b"not even MCAP", 9),
            ("old.edits.jsonl", b"", 1),
            ("new.edits.jsonl", b"", 9),
        ] {
            file(&at(name), content, days);
        }
        assert!(delete_old(&at("current.mcap"), "hall", 0.0).is_empty());
        let deleted = delete_old(&at("current.mcap"), "hall", 7.0);
        assert_eq!(deleted, [at("old.mcap")]);
        assert!(at("new.edits.jsonl").exists() && !at("old.edits.jsonl").exists());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 7);
    }
}
