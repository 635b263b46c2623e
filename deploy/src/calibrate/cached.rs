//! Cached results of a finished stage, and whether they are still valid.
//!
//! The last line of a file is a comment on what it was made of. A file is reused only if that is still the same,
//! including every byte of the recording, and if its lines were not changed.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::read;

/// Hexadecimal digits of a fingerprint.
const DIGITS: usize = 32;
/// Bytes that are read at once.
const BLOCK: usize = 1 << 20;

/// A cache entry: facts on the file, and what it was made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Cached<T> {
    /// Facts that its stage stores.
    #[serde(flatten)]
    pub(super) facts: T,
    /// Fingerprint of recording, options and program.
    made_of: String,
    /// Fingerprint of the lines above.
    lines: String,
}

impl<T: Serialize + DeserializeOwned> Cached<T> {
    fn new(lines: &str, facts: T, made_of: &str) -> Self {
        Self {
            facts,
            made_of: made_of.to_owned(),
            lines: digits(&blake3::hash(lines.as_bytes())),
        }
    }

    /// The text of a file: `lines`, and a cache entry that begins with `mark`.
    pub(super) fn text(mark: &str, lines: &str, facts: T, made_of: &str) -> String {
        let entry = Self::new(lines, facts, made_of);
        let entry = serde_json::to_string(&entry).unwrap_or_default();
        format!("{lines}{mark}{entry}\n")
    }

    /// A cache entry in a separate file, for formats without comments.
    pub(super) fn separate_text(text: &str, facts: T, made_of: &str) -> String {
        let entry = Self::new(text, facts, made_of);
        serde_json::to_string(&entry).unwrap_or_default() + "\n"
    }

    /// The facts on the file at `path` from its separate `entry` file, if the file is unchanged and made of the same.
    pub(super) fn find_separate(entry: &Path, path: &Path, made_of: &str) -> Option<T> {
        let entry: Self = serde_json::from_str(&read(entry).ok()?.text).ok()?;
        let is_same = entry.made_of == made_of && entry.lines == digits(&hash_of(path).ok()?);
        is_same.then_some(entry.facts)
    }

    /// The facts in the file at `path`, if it is unchanged and made of the same.
    pub(super) fn find(mark: &str, path: &Path, made_of: &str) -> Option<T> {
        Self::parse(mark, &read(path).ok()?.text, made_of)
    }

    fn parse(mark: &str, text: &str, made_of: &str) -> Option<T> {
        let (lines, entry) = text.rsplit_once(mark)?;
        let entry: Self = serde_json::from_str(entry).ok()?;
        let is_same =
            entry.made_of == made_of && entry.lines == digits(&blake3::hash(lines.as_bytes()));
        is_same.then_some(entry.facts)
    }
}

fn digits(hash: &blake3::Hash) -> String {
    hash.to_hex().chars().take(DIGITS).collect()
}

/// A fingerprint of the program, of `words`, and of every byte of `files` and their names.
///
/// # Errors
/// When a file cannot be read.
pub(super) fn fingerprint(words: &[&str], files: &[PathBuf]) -> anyhow::Result<String> {
    let mut hasher = blake3::Hasher::new();
    for word in [env!("CARGO_PKG_VERSION")].iter().chain(words) {
        // With its length, so that different lists of words never look the same.
        hasher.update(&(word.len() as u64).to_le_bytes());
        hasher.update(word.as_bytes());
    }
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let hash = hash_of(path).with_context(|| path.display().to_string())?;
        hasher.update(blake3::hash(name.as_bytes()).as_bytes());
        hasher.update(hash.as_bytes());
    }
    Ok(digits(&hasher.finalize()))
}

fn hash_of(path: &Path) -> std::io::Result<blake3::Hash> {
    let mut file = File::open(path)?;
    let mut hasher = blake3::Hasher::new();
    let mut block = vec![0; BLOCK];
    loop {
        match file.read(&mut block)? {
            0 => return Ok(hasher.finalize()),
            bytes => hasher.update(block.get(..bytes).unwrap_or_default()),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MARK: &str = "# kept: ";

    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    struct Facts {
        frames: u64,
    }

    #[test]
    fn a_file_is_reused_only_if_unchanged_and_made_of_the_same() {
        let facts = Facts { frames: 40 };
        let text = Cached::text(MARK, "frame x y\n29 29.0 7.5\n", facts.clone(), "abc");
        let parsed = |text: &str, made_of| Cached::<Facts>::parse(MARK, text, made_of);
        assert_eq!(parsed(&text, "abc"), Some(facts));
        assert_eq!(parsed(&text, "abd"), None);
        assert_eq!(parsed(&text.replace("29 29.0", "29 28.0"), "abc"), None);
        for cut in 0..text.len() - 1 {
            assert_eq!(parsed(&text[..cut], "abc"), None, "{cut}");
        }
        // Readers of sightings skip the cache entry.
        let read = farfield_calibration::points::parse(&text, Path::new("a.txt"));
        assert_eq!(read.map(|it| it.len()), Ok(1));
    }

    #[test]
    fn a_separate_entry_belongs_to_one_file() {
        let folder = tempfile::tempdir().unwrap();
        let [path, entry] = ["a.jsonl", "a.kept.json"].map(|it| folder.path().join(it));
        let find = || Cached::<Facts>::find_separate(&entry, &path, "abc");
        let text = Cached::separate_text("{}\n", Facts { frames: 1 }, "abc");
        std::fs::write(&entry, text).unwrap();
        assert_eq!(find(), None, "the file does not exist yet");
        std::fs::write(&path, "{}\n").unwrap();
        assert_eq!(find(), Some(Facts { frames: 1 }));
        assert_eq!(Cached::<Facts>::find_separate(&entry, &path, "abd"), None);
        std::fs::write(&path, "{ }\n").unwrap();
        assert_eq!(find(), None);
    }

    #[test]
    fn other_bytes_names_and_words_have_other_fingerprints() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let hashed = |words: &[&str]| fingerprint(words, std::slice::from_ref(&path)).unwrap();
        std::fs::write(&path, vec![7; 3 << 20]).unwrap();
        let first = hashed(&["x", "video"]);
        assert_eq!(first.len(), DIGITS);
        assert_eq!(first, hashed(&["x", "video"]));
        for other in [&["y", "video"], &["xv", "ideo"]] {
            assert_ne!(first, hashed(other));
        }
        let renamed = folder.path().join("b.mp4");
        std::fs::copy(&path, &renamed).unwrap();
        assert_ne!(first, fingerprint(&["x", "video"], &[renamed]).unwrap());
        let mut bytes = vec![7; 3 << 20];
        bytes[2_500_000] = 8;
        std::fs::write(&path, bytes).unwrap();
        assert_ne!(first, hashed(&["x", "video"]));
    }
}
