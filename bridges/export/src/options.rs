//! What an export is asked for.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::str::FromStr;

use farfield_proto::camera::CameraModel;

use crate::axes::Preset;
use crate::skeleton::{BoneNames, RestPose};
use crate::timeline::Gaps;

/// A format of other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// BVH, one file a person.
    Bvh,
    /// glTF 2.0 in one binary file, all people.
    Glb,
    /// glTF 2.0 as JSON with its data inside, all people.
    Gltf,
    /// C3D, one file a person.
    C3d,
    /// CSV with a column per number, one file a person.
    Csv,
    /// CSV with a row per point or angle, all people.
    CsvTidy,
    /// Parquet with a column per number, all people.
    Parquet,
    /// MCAP of Foxglove's messages, all people.
    Mcap,
    /// A scaled `OpenSim` model per person.
    Osim,
    /// TRC, one file a person: the markers of the model, as a run writes them.
    Trc,
    /// MOT, one file a person: the coordinates of the model, as a run writes them.
    Mot,
}

impl Format {
    /// Every format with its name on the command line.
    pub const ALL: [(&'static str, Self); 11] = [
        ("bvh", Self::Bvh),
        ("glb", Self::Glb),
        ("gltf", Self::Gltf),
        ("c3d", Self::C3d),
        ("csv", Self::Csv),
        ("csv-tidy", Self::CsvTidy),
        ("parquet", Self::Parquet),
        ("mcap", Self::Mcap),
        ("osim", Self::Osim),
        ("trc", Self::Trc),
        ("mot", Self::Mot),
    ];

    /// What files of everybody have where those of one person have the person's word, in small letters.
    pub(crate) const TAKEN_WORDS: [&'static str; 1] = ["tidy"];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        let found = Self::ALL.iter().find(|(_, format)| *format == self);
        found.map_or("", |(name, _)| *name)
    }

    /// What a file is called: of one person, who is called `who`, or (`None`) of all.
    pub(crate) fn file_name(self, who: &str) -> String {
        match self {
            Self::Bvh => format!("poses_{who}.bvh"),
            Self::Glb => "poses.glb".to_owned(),
            Self::Gltf => "poses.gltf".to_owned(),
            Self::C3d => format!("poses_{who}.c3d"),
            Self::Csv => format!("poses_{who}.csv"),
            Self::CsvTidy => "poses_tidy.csv".to_owned(),
            Self::Parquet => "poses.parquet".to_owned(),
            Self::Mcap => "poses.mcap".to_owned(),
            Self::Trc => format!("poses_{who}.trc"),
            Self::Mot => format!("angles_{who}.mot"),
            Self::Osim => format!("model_{who}.osim"),
        }
    }

    /// Whether one file holds all people.
    pub const fn holds_all(self) -> bool {
        matches!(
            self,
            Self::Glb | Self::Gltf | Self::CsvTidy | Self::Parquet | Self::Mcap
        )
    }

    /// Whether it has a place for marks of what was filled.
    const fn has_marks(self) -> bool {
        !matches!(self, Self::Bvh | Self::Trc | Self::Mot)
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        // Who has Foxglove looks for its name.
        let name = if name == "foxglove" { "mcap" } else { name };
        crate::choice::named(name, &Self::ALL)
    }
}

/// How long the bones of an animated skeleton are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lengths {
    /// Constant: what the run settled on. What retargeting expects.
    #[default]
    Settled,
    /// As they were at each tick: bones have moving offsets, and joints are those of `poses.jsonl` while a run still
    /// learns a body.
    Measured,
}

impl Lengths {
    /// Every choice with its name on the command line.
    pub const ALL: [(&'static str, Self); 2] =
        [("settled", Self::Settled), ("measured", Self::Measured)];
}

impl FromStr for Lengths {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        crate::choice::named(name, &Self::ALL)
    }
}

/// What to do with files that are there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Existing {
    /// Nothing is written.
    #[default]
    Refuse,
    /// They are replaced, when the new ones are whole.
    Replace,
}

/// How poses are written.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Who, by the ids that edits give; empty: everybody.
    pub people: Vec<u32>,
    /// What people are called in files and their names, whatever edits say; others are called as edits say, or by their id.
    pub called: BTreeMap<u32, String>,
    /// Which ticks, the end not among them; `None`: the whole run.
    pub ticks: Option<Range<i64>>,
    /// Frames per second; `None`: the run's.
    pub rate_hz: Option<f64>,
    /// What becomes of ticks without a pose.
    pub gaps: Gaps,
    /// Longest gap that is filled, from pose to pose, seconds.
    pub longest_gap_s: f64,
    /// How long bones are.
    pub lengths: Lengths,
    /// How the skeleton rests.
    pub rest: RestPose,
    /// What its bones are called.
    pub names: BoneNames,
    /// Whose units and axes; `None`: those of the format.
    pub preset: Option<Preset>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            people: Vec::new(),
            called: BTreeMap::new(),
            ticks: None,
            rate_hz: None,
            gaps: Gaps::default(),
            longest_gap_s: 1.0,
            lengths: Lengths::default(),
            rest: RestPose::default(),
            names: BoneNames::default(),
            preset: None,
        }
    }
}

impl Options {
    /// Why `format` cannot be written so.
    pub(crate) fn refusal(&self, format: Format) -> Option<String> {
        let marked = self.gaps == Gaps::Mark && !format.has_marks();
        marked.then(|| {
            format!(
                "{} has no place for marks: gaps can be kept or filled",
                format.name()
            )
        })
    }
}

/// An export of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportRequest {
    /// The poses: a run's `poses.jsonl`, or the smoothed ones.
    pub poses: PathBuf,
    /// The run's `summary.json`.
    pub summary: PathBuf,
    /// Names and edits of the people; a file that is not there has none. `None`: poses as they are.
    pub edits: Option<PathBuf>,
    /// Profiles of people: whoever is called as one says has its lengths.
    pub subjects: Vec<PathBuf>,
    /// The cameras of the venue, where they are known, for formats that show them.
    pub cameras: Vec<CameraModel>,
    /// Folder of the files; it is made where it is not there.
    pub out: PathBuf,
    /// What is written.
    pub formats: Vec<Format>,
    /// How.
    pub options: Options,
    /// What to do with files that are there already.
    pub existing: Existing,
}
