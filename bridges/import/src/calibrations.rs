//! The calibrations among files, by their content, and which of several is the one.

use std::path::{Path, PathBuf};

use farfield_calibration::formats::{
    Candidate, Format, Imported, candidates, difference, may_be_calibration,
};

use crate::files;

/// So much of a file says whether it may be a calibration, bytes.
const BEGINNING: u64 = 1 << 14;

/// Formats of the same content, the first is taken: Caliscope's names fit its keypoints, ours is kept to the last bit.
const PREFERRED: [Format; 2] = [Format::Caliscope, Format::Farfield];

/// What of some files is calibrations.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Calibrations {
    /// Those that can be read, each with what it says.
    pub whole: Vec<FoundCalibration>,
    /// Those that cannot be used, each with the reason.
    pub unusable: Vec<String>,
}

/// One calibration that was found and read.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCalibration {
    /// Its files with their texts.
    pub candidate: Candidate,
    /// What they say.
    pub imported: Imported,
}

/// Which calibration of several it is.
#[derive(Debug, Clone, PartialEq)]
pub enum Choice {
    /// This one, and what was found and not taken, a sentence each.
    One(Box<FoundCalibration>, Vec<String>),
    /// Several that differ: all of them, and by how much.
    Several(String),
    /// None, and what looks like one and cannot be used.
    None(Vec<String>),
}

/// The calibrations among `paths`. What cannot be read as text is none.
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
    // UTF-16 has a mark, and zeros like a binary file.
    let is_wide = head.starts_with(&[0xff, 0xfe]) || head.starts_with(&[0xfe, 0xff]);
    is_wide || !head.contains(&0) && may_be_calibration(&String::from_utf8_lossy(head))
}

impl Calibrations {
    /// The only one, or one of several that say the same.
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
    /// The files.
    pub fn paths(&self) -> Vec<PathBuf> {
        self.candidate
            .files
            .iter()
            .map(|it| it.path.clone())
            .collect()
    }

    /// Its files, their date, and what is in them.
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

    /// By how much it differs from what was taken; `None` where both say the same.
    fn difference_from(&self, taken: &Imported) -> Option<String> {
        difference(&taken.cameras, &self.imported.cameras)
    }

    /// [`Self::shown`], and what it says otherwise than what was taken.
    pub(crate) fn compared_with(&self, taken: &Imported) -> String {
        let differs = self.difference_from(taken);
        let differs = differs.unwrap_or_else(|| "it says the same".to_owned());
        format!("{}: {differs}", self.shown())
    }
}

/// Names of files behind each other.
fn listed(paths: &[PathBuf]) -> String {
    let shown: Vec<String> = paths
        .iter()
        .map(|path: &PathBuf| Path::display(path).to_string())
        .collect();
    shown.join(" + ")
}
