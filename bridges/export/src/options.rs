//! Options of an export.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::str::FromStr;

use farfield_proto::camera::CameraModel;

use crate::axes::Preset;
use crate::skeleton::{BoneNames, RestPose};
use crate::timeline::Gaps;

/// An export format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// BVH, one file per person.
    Bvh,
    /// glTF 2.0 as one binary file with all people.
    Glb,
    /// glTF 2.0 as JSON with embedded data, all people.
    Gltf,
    /// C3D, one file per person.
    C3d,
    /// CSV with one column per number, one file per person.
    Csv,
    /// CSV with one row per point or angle, all people.
    CsvTidy,
    /// Parquet with one column per number, all people.
    Parquet,
    /// MCAP with Foxglove messages, all people.
    Mcap,
    /// A scaled `OpenSim` model per person.
    Osim,
    /// TRC, one file per person: the markers of the model, as written by a run.
    Trc,
    /// MOT, one file per person: the coordinates of the model, as written by a run.
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

    /// Words in names of shared files at the place of the person's name, in lower case.
    pub(crate) const TAKEN_WORDS: [&'static str; 1] = ["tidy"];

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        let found = Self::ALL.iter().find(|(_, format)| *format == self);
        found.map_or("", |(name, _)| *name)
    }

    /// Name of a file: of one person (`word` is the name or id), or shared by all people.
    pub(crate) fn file_name(self, word: &str) -> String {
        match self {
            Self::Bvh => format!("poses_{word}.bvh"),
            Self::Glb => "poses.glb".to_owned(),
            Self::Gltf => "poses.gltf".to_owned(),
            Self::C3d => format!("poses_{word}.c3d"),
            Self::Csv => format!("poses_{word}.csv"),
            Self::CsvTidy => "poses_tidy.csv".to_owned(),
            Self::Parquet => "poses.parquet".to_owned(),
            Self::Mcap => "poses.mcap".to_owned(),
            Self::Trc => format!("poses_{word}.trc"),
            Self::Mot => format!("angles_{word}.mot"),
            Self::Osim => format!("model_{word}.osim"),
        }
    }

    /// Whether one file holds all people.
    pub const fn holds_all(self) -> bool {
        matches!(
            self,
            Self::Glb | Self::Gltf | Self::CsvTidy | Self::Parquet | Self::Mcap
        )
    }

    /// Whether it can mark filled frames.
    const fn has_marks(self) -> bool {
        !matches!(self, Self::Bvh | Self::Trc | Self::Mot)
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        // Users of Foxglove search for its name.
        let name = if name == "foxglove" { "mcap" } else { name };
        named(name, &Self::ALL)
    }
}

/// Bone lengths of an animated skeleton.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Lengths {
    /// Constant: the final lengths of the run, as retargeting requires.
    #[default]
    Settled,
    /// As at each tick: bone offsets move, and joints equal those of `poses.jsonl`, even while a
    /// run still learns a body.
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
        named(name, &Self::ALL)
    }
}

/// What to do with existing files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Existing {
    /// Write nothing.
    #[default]
    Refuse,
    /// Replace them when the new files are complete.
    Replace,
}

/// How poses are written.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Selected people, by edited ids; empty for all.
    pub people: Vec<u32>,
    /// Names of people in files and file names, which override edits; others are named by edits or
    /// by their id.
    pub called: BTreeMap<u32, String>,
    /// Selected ticks, end exclusive; `None` for the whole run.
    pub ticks: Option<Range<i64>>,
    /// Frames per second; `None` for the run's rate.
    pub rate_hz: Option<f64>,
    /// Treatment of ticks without a pose.
    pub gaps: Gaps,
    /// Longest gap that is filled, from pose to pose, seconds.
    pub longest_gap_s: f64,
    /// Bone lengths.
    pub lengths: Lengths,
    /// Rest pose of the skeleton.
    pub rest: RestPose,
    /// Names of the bones.
    pub names: BoneNames,
    /// Units and axes of a program; `None` for those of the format.
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
    /// Why `format` cannot be written with these options.
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

/// Request to export one run.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportRequest {
    /// The poses: a run's `poses.jsonl`, or the smoothed ones.
    pub poses: PathBuf,
    /// The run's `summary.json`.
    pub summary: PathBuf,
    /// Names and edits of the people; the file need not exist. `None` for unedited poses.
    pub edits: Option<PathBuf>,
    /// Profiles of people, applied by name.
    pub subjects: Vec<PathBuf>,
    /// The cameras of the venue, if known, for formats that show them.
    pub cameras: Vec<CameraModel>,
    /// Output folder; created if it does not exist.
    pub out: PathBuf,
    /// The formats.
    pub formats: Vec<Format>,
    /// Options.
    pub options: Options,
    /// What to do with existing files.
    pub existing: Existing,
}

/// Finds the value with a name.
///
/// # Errors
/// The list of valid names.
pub(crate) fn named<T: Copy>(name: &str, all: &[(&'static str, T)]) -> Result<T, String> {
    let found = all.iter().find(|(known, _)| *known == name);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|(known, _)| *known).collect();
        format!("`{name}` is not one of {}", known.join(", "))
    })
}
