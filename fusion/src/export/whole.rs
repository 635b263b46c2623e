//! Completes a file whose writer was killed, or whose disk refused more.
//!
//! It is cut after its last whole line, its head gets the number of rows, and it gets its name. A
//! file without rows is deleted.

use std::fs::{self, OpenOptions};
use std::io::{self, BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};

use serde::de::IgnoredAny;

use super::unfinished::{SUFFIX, open_own, overwrite};
use super::{mot, trc};

/// Limit of a line, bytes, far above any that a run writes: a longer one is invalid.
const LONGEST_LINE: u64 = 16 << 20;

/// Limit of a head, bytes, far above any that a run writes.
const LONGEST_HEAD: usize = 1 << 20;

/// The kind of a run's file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// `poses.jsonl`: independent lines.
    Lines,
    /// Points, below a head of five lines.
    Trc,
    /// Angles, below a head with an end mark.
    Mot,
    /// `summary.json`: one value.
    Summary,
}

impl Kind {
    pub(super) fn from_name(name: &str) -> Option<Self> {
        match name.split_once('.')? {
            (stem, "jsonl") if stem == "poses" || stem.starts_with("poses-") => Some(Self::Lines),
            ("summary", "json") => Some(Self::Summary),
            (stem, "trc") if stem.starts_with("poses_") => Some(Self::Trc),
            (stem, "mot") if stem.starts_with("angles_") => Some(Self::Mot),
            _ => None,
        }
    }

    /// Whether a file that begins with this line is one of ours: an older farfield wrote the head
    /// last.
    fn begins_with(self, line: &[u8]) -> bool {
        match self {
            Self::Lines | Self::Summary => true,
            Self::Trc => line.starts_with(trc::FIRST_WORD.as_bytes()),
            Self::Mot => line.starts_with(mot::FIRST_WORD.as_bytes()),
        }
    }

    /// Whether these lines are a whole head.
    fn is_head(self, lines: &[u8], n_lines: usize) -> bool {
        match self {
            Self::Lines | Self::Summary => true,
            Self::Trc => n_lines == trc::HEAD_LINES,
            Self::Mot => {
                let mut back = lines.split(|&byte| byte == b'\n').rev();
                // The last line ends in a line break, and has the names.
                back.nth(2) == Some(mot::END_OF_HEAD.as_bytes())
            }
        }
    }

    pub(super) fn with_rows(self, head: &str, n_rows: u64) -> Option<String> {
        match self {
            Self::Lines | Self::Summary => Some(head.to_owned()),
            Self::Trc => trc::with_rows(head, n_rows),
            Self::Mot => mot::with_rows(head, n_rows),
        }
    }
}

/// A completed file.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Whole {
    /// Its final name.
    pub(super) path: PathBuf,
    pub(super) bytes: u64,
}

/// Completes the temporary file `path`, and renames it. `None` if it was empty and is deleted.
pub(super) fn make_whole(path: &Path, kind: Kind) -> io::Result<Option<Whole>> {
    let Some(name) = path.to_str().and_then(|path| path.strip_suffix(SUFFIX)) else {
        return Err(io::Error::other("it has no temporary name"));
    };
    let (head, bytes) = if kind == Kind::Summary {
        (String::new(), summary_bytes(path)?)
    } else {
        let lines = WholeLines::read(
            BufReader::new(open_own(OpenOptions::new().read(true), path)?),
            kind,
        )?;
        match kind.with_rows(&lines.head, lines.n_rows) {
            _ if lines.is_foreign => return Ok(None),
            Some(head) if lines.n_rows > 0 => (head, lines.bytes),
            None if lines.n_rows > 0 => return Ok(None),
            _ => (String::new(), 0),
        }
    };
    if bytes == 0 {
        fs::remove_file(path)?;
        return Ok(None);
    }
    let file = open_own(OpenOptions::new().write(true), path)?;
    file.set_len(bytes)?;
    overwrite(path, head.as_bytes())?;
    file.sync_all()?;
    let path = PathBuf::from(name);
    fs::rename(format!("{name}{SUFFIX}"), &path)?;
    Ok(Some(Whole { path, bytes }))
}

/// Bytes of the summary at the beginning of `path`, which has reserved room behind it; 0 without
/// one.
fn summary_bytes(path: &Path) -> io::Result<u64> {
    let mut text = Vec::new();
    open_own(OpenOptions::new().read(true), path)?
        .take(LONGEST_LINE)
        .read_to_end(&mut text)?;
    let end = text.trim_ascii_end().len();
    let value = serde_json::from_slice::<IgnoredAny>(&text[..end]);
    // Including its line break.
    Ok(value.map_or(0, |_| (end + 1).min(text.len()) as u64))
}

/// The readable part of a file.
#[derive(Debug, Default)]
pub(super) struct WholeLines {
    pub(super) head: String,
    pub(super) n_rows: u64,
    /// Head and rows.
    bytes: u64,
    /// Whether its beginning does not fit its kind.
    is_foreign: bool,
}

impl WholeLines {
    /// Reads up to the first line that is torn, or that never reached the disk: after a power cut
    /// there may be zeros.
    pub(super) fn read(mut file: impl io::BufRead, kind: Kind) -> io::Result<Self> {
        let mut this = Self::default();
        let (mut line, mut head, mut n_head) = (Vec::new(), Vec::new(), 0);
        let mut in_head = !kind.is_head(&head, 0);
        loop {
            line.clear();
            (&mut file)
                .take(LONGEST_LINE)
                .read_until(b'\n', &mut line)?;
            if line.last() != Some(&b'\n') || line.contains(&0) {
                break;
            }
            if this.bytes == 0 && !kind.begins_with(&line) {
                this.is_foreign = true;
                break;
            }
            this.bytes += line.len() as u64;
            if in_head {
                head.extend_from_slice(&line);
                if head.len() > LONGEST_HEAD {
                    this.is_foreign = true;
                    break;
                }
                n_head += 1;
                in_head = !kind.is_head(&head, n_head);
            } else {
                this.n_rows += 1;
            }
        }
        // A head that is not text lost bytes on the disk: overwriting it would damage rows.
        match String::from_utf8(head) {
            Ok(head) => this.head = head,
            Err(_) => this.is_foreign = true,
        }
        Ok(this)
    }
}
