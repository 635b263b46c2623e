//! What a finished look at a recording left, and whether it is what a look would find now.
//!
//! The last line of a file of sightings is a comment that says of what it was made. A file is taken up only where that is
//! the same now, byte for byte of the recording, and where nobody changed its lines.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_calibration::ball::{BallSighting, FINDER_REVISION, sightings_text};
use serde::{Deserialize, Serialize};

use crate::calibrate::read;
use crate::init::recordings::{Recording, RecordingKind, entries};

/// How the line begins that says of what a file was made.
const MARK: &str = "# farfield calibrate ball: ";
/// Hexadecimal digits of a fingerprint.
const DIGITS: usize = 32;
/// Bytes that are read at once.
const BLOCK: usize = 1 << 20;

/// What is said of a file of sightings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Kept {
    /// Pictures that were looked at.
    pub(super) frames: u64,
    /// Pictures in which it was seen.
    pub(super) sightings: usize,
    /// Its diameter at the median, pixels, to a hundredth.
    pub(super) diameter_px: f64,
    /// Fingerprint of recording, lens, options and program.
    made_of: String,
    /// Fingerprint of the lines above.
    lines: String,
}

impl Kept {
    /// What was found, and the text of its file.
    pub(super) fn of(frames: u64, found: &[BallSighting], made_of: &str) -> (Self, String) {
        let mut diameters_px: Vec<f64> = found.iter().map(|it| it.diameter_px).collect();
        diameters_px.sort_by(f64::total_cmp);
        let middle_px = diameters_px.get(diameters_px.len() / 2).copied();
        let lines = sightings_text(found);
        let kept = Self {
            frames,
            sightings: found.len(),
            diameter_px: (100.0 * middle_px.unwrap_or_default()).round() / 100.0,
            made_of: made_of.to_owned(),
            lines: digits(&blake3::hash(lines.as_bytes())),
        };
        let said = serde_json::to_string(&kept).unwrap_or_default();
        let text = format!("{lines}{MARK}{said}\n");
        (kept, text)
    }

    /// What the file at `path` says of itself, where it is whole, untouched, and made of the same.
    pub(super) fn find(path: &Path, made_of: &str) -> Option<Self> {
        Self::parse(&read(path).ok()?.text, made_of)
    }

    fn parse(text: &str, made_of: &str) -> Option<Self> {
        let (lines, said) = text.rsplit_once(MARK)?;
        let kept: Self = serde_json::from_str(said).ok()?;
        let is_same =
            kept.made_of == made_of && kept.lines == digits(&blake3::hash(lines.as_bytes()));
        is_same.then_some(kept)
    }
}

fn digits(hash: &blake3::Hash) -> String {
    hash.to_hex().chars().take(DIGITS).collect()
}

/// A fingerprint of every byte of a recording, of `options`, and of the program.
///
/// # Errors
/// When the recording cannot be read.
pub(super) fn fingerprint(recording: &Recording, options: &str) -> anyhow::Result<String> {
    let mut hasher = blake3::Hasher::new();
    let mut put = |word: &str| {
        // With its length, so that no two lists of words are alike.
        hasher.update(&(word.len() as u64).to_le_bytes());
        hasher.update(word.as_bytes());
    };
    put(env!("CARGO_PKG_VERSION"));
    put(&FINDER_REVISION.to_string());
    put(options);
    put(recording.kind_name());
    let files: Vec<PathBuf> = if recording.kind == RecordingKind::Images {
        let folder = recording.path.parent().unwrap_or(Path::new("."));
        let files = entries(folder)?.into_iter();
        files.filter(|path| path.is_file()).collect()
    } else {
        vec![recording.path.clone()]
    };
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let hash = hash_of(&path).with_context(|| path.display().to_string())?;
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

    fn sightings() -> Vec<BallSighting> {
        let each = (0..30).map(|i| BallSighting {
            frame: i,
            px: [i as f64, 7.5],
            diameter_px: 11.117,
            sigma_px: 0.02,
            score: 1.0,
        });
        each.collect()
    }

    #[test]
    fn a_file_is_taken_up_only_untouched_and_of_the_same() {
        let (kept, text) = Kept::of(40, &sightings(), "abc");
        assert_eq!((kept.frames, kept.sightings), (40, 30));
        assert_eq!(Kept::parse(&text, "abc"), Some(kept));
        assert_eq!(Kept::parse(&text, "abd"), None);
        assert_eq!(
            Kept::parse(&text.replace("29 29.0", "29 28.0"), "abc"),
            None
        );
        for cut in 0..text.len() - 1 {
            assert_eq!(Kept::parse(&text[..cut], "abc"), None, "{cut}");
        }
        // Whoever reads sightings passes over what the file says of itself.
        let read = farfield_calibration::points::parse(&text, Path::new("a.txt"));
        assert_eq!(read.map(|it| it.len()), Ok(30));
    }

    #[test]
    fn other_bytes_options_and_kinds_have_other_fingerprints() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mp4");
        let of = |kind, options: &str| {
            let recording = Recording {
                kind,
                path: path.clone(),
                name: "a".to_owned(),
            };
            fingerprint(&recording, options).unwrap()
        };
        std::fs::write(&path, vec![7; 3 << 20]).unwrap();
        let first = of(RecordingKind::Video, "x");
        assert_eq!(first.len(), DIGITS);
        assert_eq!(first, of(RecordingKind::Video, "x"));
        assert_ne!(first, of(RecordingKind::Video, "y"));
        assert_ne!(first, of(RecordingKind::Images, "x"));
        let mut bytes = vec![7; 3 << 20];
        bytes[2_500_000] = 8;
        std::fs::write(&path, bytes).unwrap();
        assert_ne!(first, of(RecordingKind::Video, "x"));
    }
}
