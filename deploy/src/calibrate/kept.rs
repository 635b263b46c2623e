//! What a finished stage left of a recording, and whether it is what that stage would leave now.
//!
//! The last line of a file is a comment that says of what it was made. A file is taken up only where that is the same now, byte
//! for byte of the recording, and where nobody changed its lines.

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

/// What a file says of itself: `said`, and of what it was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Kept<T> {
    /// What its stage says of it.
    #[serde(flatten)]
    pub(super) said: T,
    /// Fingerprint of recording, options and program.
    made_of: String,
    /// Fingerprint of the lines above.
    lines: String,
}

impl<T: Serialize + DeserializeOwned> Kept<T> {
    fn of(lines: &str, said: T, made_of: &str) -> Self {
        Self {
            said,
            made_of: made_of.to_owned(),
            lines: digits(&blake3::hash(lines.as_bytes())),
        }
    }

    /// The text of a file with `lines`, and under them what is said of them. The line begins with `mark`.
    pub(super) fn text(mark: &str, lines: &str, said: T, made_of: &str) -> String {
        let kept = Self::of(lines, said, made_of);
        let kept = serde_json::to_string(&kept).unwrap_or_default();
        format!("{lines}{mark}{kept}\n")
    }

    /// What is said of a file with `text`, beside it: of one whose format has no comments.
    pub(super) fn beside(text: &str, said: T, made_of: &str) -> String {
        let kept = Self::of(text, said, made_of);
        serde_json::to_string(&kept).unwrap_or_default() + "\n"
    }

    /// What the file `beside` says of the one at `path`, where that is whole, untouched, and made of the same.
    pub(super) fn find_beside(beside: &Path, path: &Path, made_of: &str) -> Option<T> {
        let kept: Self = serde_json::from_str(&read(beside).ok()?.text).ok()?;
        let is_same = kept.made_of == made_of && kept.lines == digits(&hash_of(path).ok()?);
        is_same.then_some(kept.said)
    }

    /// What the file at `path` says of itself, where it is whole, untouched, and made of the same.
    pub(super) fn find(mark: &str, path: &Path, made_of: &str) -> Option<T> {
        Self::parse(mark, &read(path).ok()?.text, made_of)
    }

    fn parse(mark: &str, text: &str, made_of: &str) -> Option<T> {
        let (lines, said) = text.rsplit_once(mark)?;
        let kept: Self = serde_json::from_str(said).ok()?;
        let is_same =
            kept.made_of == made_of && kept.lines == digits(&blake3::hash(lines.as_bytes()));
        is_same.then_some(kept.said)
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
        // With its length, so that no two lists of words are alike.
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
    struct Said {
        frames: u64,
    }

    #[test]
    fn a_file_is_taken_up_only_untouched_and_of_the_same() {
        let said = Said { frames: 40 };
        let text = Kept::text(MARK, "frame x y\n29 29.0 7.5\n", said.clone(), "abc");
        let parsed = |text: &str, made_of| Kept::<Said>::parse(MARK, text, made_of);
        assert_eq!(parsed(&text, "abc"), Some(said));
        assert_eq!(parsed(&text, "abd"), None);
        assert_eq!(parsed(&text.replace("29 29.0", "29 28.0"), "abc"), None);
        for cut in 0..text.len() - 1 {
            assert_eq!(parsed(&text[..cut], "abc"), None, "{cut}");
        }
        // Whoever reads sightings passes over what the file says of itself.
        let read = farfield_calibration::points::parse(&text, Path::new("a.txt"));
        assert_eq!(read.map(|it| it.len()), Ok(1));
    }

    #[test]
    fn what_is_said_beside_a_file_is_of_that_file_alone() {
        let folder = tempfile::tempdir().unwrap();
        let [path, beside] = ["a.jsonl", "a.kept.json"].map(|it| folder.path().join(it));
        let find = || Kept::<Said>::find_beside(&beside, &path, "abc");
        std::fs::write(&beside, Kept::beside("{}\n", Said { frames: 1 }, "abc")).unwrap();
        assert_eq!(find(), None, "the file is not there yet");
        std::fs::write(&path, "{}\n").unwrap();
        assert_eq!(find(), Some(Said { frames: 1 }));
        assert_eq!(Kept::<Said>::find_beside(&beside, &path, "abd"), None);
        std::fs::write(&path, "{ }\n").unwrap();
        assert_eq!(find(), None);
    }

    #[test]
    fn other_bytes_names_and_words_have_other_fingerprints() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let of = |words: &[&str]| fingerprint(words, std::slice::from_ref(&path)).unwrap();
        std::fs::write(&path, vec![7; 3 << 20]).unwrap();
        let first = of(&["x", "video"]);
        assert_eq!(first.len(), DIGITS);
        assert_eq!(first, of(&["x", "video"]));
        for other in [&["y", "video"], &["xv", "ideo"]] {
            assert_ne!(first, of(other));
        }
        let renamed = folder.path().join("b.mp4");
        std::fs::copy(&path, &renamed).unwrap();
        assert_ne!(first, fingerprint(&["x", "video"], &[renamed]).unwrap());
        let mut bytes = vec![7; 3 << 20];
        bytes[2_500_000] = 8;
        std::fs::write(&path, bytes).unwrap();
        assert_ne!(first, of(&["x", "video"]));
    }
}
