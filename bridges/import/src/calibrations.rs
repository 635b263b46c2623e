//! Finds calibrations among files by content, and chooses one.

use std::path::{Path, PathBuf};

use farfield_calibration::formats::{
    Candidate, Format, Imported, candidates, difference, may_be_calibration,
};

use crate::files;

/// Bytes read to decide whether a file may be a calibration.
const BEGINNING: u64 = 1 << 14;

/// Formats to prefer among equal calibrations: Caliscope's names match its keypoints, and ours is
/// kept bit for bit.
const PREFERRED: [Format; 2] = [Format::Caliscope, Format::Farfield];

/// The calibrations among some files.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Calibrations {
    /// Those that can be read.
    pub whole: Vec<FoundCalibration>,
    /// Those that cannot be used, each with the reason.
    pub unusable: Vec<String>,
}

/// A calibration that was found and read.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCalibration {
    /// Its files with their texts.
    pub candidate: Candidate,
    /// The parsed content.
    pub imported: Imported,
}

/// Result of choosing among calibrations.
#[derive(Debug, Clone, PartialEq)]
pub enum Choice {
    /// The chosen one, and one sentence for each that was not used.
    One(Box<FoundCalibration>, Vec<String>),
    /// Several different ones, listed with their differences.
    Several(String),
    /// None; with the files that look like calibrations but cannot be used.
    None(Vec<String>),
}

/// Finds the calibrations among `paths`. Files that are not readable as text are skipped.
pub fn among(paths: &[PathBuf]) -> Calibrations {
    let mut texts = Vec::new();
    for path in paths.iter().filter(|path| files::is_file(path)) {
        let may_be = files::head(path, BEGINNING).is_ok_and(|head| is_promising(&head));
        if may_be && let Ok(text) = files::read_calibration(path) {
            texts.push(text);
        }
    }
    let mut found = Calibrations::default();
    for candidate in candidates(texts) {
        match candidate.read.clone() {
            Ok(imported) => found.whole.push(FoundCalibration {
                candidate,
                imported,
            }),
            Err(error) => found.unusable.push(error.to_string()),
        }
    }
    found
}

fn is_promising(head: &[u8]) -> bool {
    // UTF-16 has a byte order mark, and contains zeros like a binary file.
    let is_wide = head.starts_with(&[0xff, 0xfe]) || head.starts_with(&[0xfe, 0xff]);
    is_wide || !head.contains(&0) && may_be_calibration(&String::from_utf8_lossy(head))
}

impl Calibrations {
    /// Chooses the only calibration, or one of several equal ones.
    pub fn choice(self) -> Choice {
        let rank = |it: &FoundCalibration| {
            let place = PREFERRED
                .iter()
                .position(|format| *format == it.imported.format);
            place.unwrap_or(PREFERRED.len())
        };
        let Some(first) = self.whole.iter().min_by_key(|it| rank(it)) else {
            return Choice::None(self.unusable);
        };
        let others = || self.whole.iter().filter(|it| *it != first);
        if others().any(|it| it.difference_from(&first.imported).is_some()) {
            let all = std::iter::once(first.shown())
                .chain(others().map(|it| it.compared_with(&first.imported)));
            return Choice::Several(all.chain(self.unusable).collect::<Vec<_>>().join("; "));
        }
        let others = others().map(|it| it.compared_with(&first.imported));
        let not_taken = others.chain(self.unusable.iter().cloned()).collect();
        Choice::One(Box::new(first.clone()), not_taken)
    }
}

impl FoundCalibration {
    /// Paths of the files.
    pub fn paths(&self) -> Vec<PathBuf> {
        self.candidate
            .files
            .iter()
            .map(|it| it.path.clone())
            .collect()
    }

    /// File names, date and content in one line.
    pub fn shown(&self) -> String {
        let paths = self.paths();
        let date = paths.iter().filter_map(|path| files::date(path)).max();
        let date = date.map_or_else(String::new, |date| format!("{date}, "));
        let cameras = self.imported.cameras.len();
        format!(
            "{} ({date}{cameras} cameras, {})",
            listed(&paths),
            self.imported.format
        )
    }

    /// Description of the difference from `taken`; `None` if both are equal.
    fn difference_from(&self, taken: &Imported) -> Option<String> {
        difference(&taken.cameras, &self.imported.cameras)
    }

    /// [`Self::shown`], followed by the difference from `taken`.
    pub(crate) fn compared_with(&self, taken: &Imported) -> String {
        let differs = self.difference_from(taken);
        let differs = differs.unwrap_or_else(|| "it has the same content".to_owned());
        format!("{}: {differs}", self.shown())
    }
}

/// Joins file names.
fn listed(paths: &[PathBuf]) -> String {
    let shown: Vec<String> = paths
        .iter()
        .map(|path: &PathBuf| Path::display(path).to_string())
        .collect();
    shown.join(" + ")
}
