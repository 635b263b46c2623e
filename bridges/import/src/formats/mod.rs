//! 2D keypoints as other programs write them. [`parse`] takes one file; a recording of a file per frame is read by one
//! [`Reading`].
//!
//! Whose file it is is told by its content. What a file does not say (scores) is taken and said.

mod caliscope;
mod coco;
mod deeplabcut;
mod freemocap;
mod json;
mod mmpose;
mod npy;
mod openpose;
mod sleap;
mod table;

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use farfield_proto::toml_file::FileError;

use crate::keypoints::{Keypoints, Mapping, Model};
use crate::person::Detections;

/// Longest table or array that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Longest JSON that is read, bytes: what it says takes several times as much while it is read.
const MAX_JSON_BYTES: u64 = 1 << 29;

/// Longest file of this name that is read, bytes.
pub(crate) fn max_bytes(path: &Path) -> u64 {
    let ending = path.extension().unwrap_or_default();
    if ending.eq_ignore_ascii_case("json") {
        MAX_JSON_BYTES
    } else {
        MAX_FILE_BYTES
    }
}

/// Whose file it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// `OpenPose`'s and Pose2Sim's: a JSON file per frame, in a folder per camera.
    OpenPose,
    /// `AlphaPose`'s `alphapose-results.json`.
    AlphaPose,
    /// COCO's results of keypoints.
    CocoResults,
    /// COCO's annotations of keypoints.
    CocoAnnotations,
    /// `MMPose`'s predictions.
    MmPose,
    /// `DeepLabCut`'s CSV.
    DeepLabCut,
    /// SLEAP's analysis as CSV.
    Sleap,
    /// Caliscope's `xy_*.csv`: all cameras in one.
    Caliscope,
    /// `FreeMoCap`'s `*2dData*.npy`: all cameras in one.
    FreeMoCap,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::OpenPose,
        Self::AlphaPose,
        Self::CocoResults,
        Self::CocoAnnotations,
        Self::MmPose,
        Self::DeepLabCut,
        Self::Sleap,
        Self::Caliscope,
        Self::FreeMoCap,
    ];

    /// As the command line has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::OpenPose => "openpose",
            Self::AlphaPose => "alphapose",
            Self::CocoResults => "coco-results",
            Self::CocoAnnotations => "coco",
            Self::MmPose => "mmpose",
            Self::DeepLabCut => "deeplabcut",
            Self::Sleap => "sleap",
            Self::Caliscope => "caliscope",
            Self::FreeMoCap => "freemocap",
        }
    }

    /// The format of this name; `pose2sim` is `OpenPose`'s.
    pub fn from_name(name: &str) -> Option<Self> {
        if name == "pose2sim" {
            return Some(Self::OpenPose);
        }
        Self::ALL.into_iter().find(|format| format.name() == name)
    }
}

impl Format {
    /// The ending that its files have.
    pub(crate) fn ending(self) -> &'static str {
        match self {
            Self::OpenPose
            | Self::AlphaPose
            | Self::CocoResults
            | Self::CocoAnnotations
            | Self::MmPose => "json",
            Self::DeepLabCut | Self::Sleap | Self::Caliscope => "csv",
            Self::FreeMoCap => "npy",
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What the caller knows better than the files. The default is to believe them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ParseOptions {
    /// Whose files they are; `None`: told by their content.
    pub format: Option<Format>,
    /// Which keypoints they have; `None`: told by their names or their number.
    pub model: Option<Model>,
    /// What settings beside the files say of that: it decides between models of one number.
    pub model_hint: Option<Model>,
}

/// What the files of one source said.
#[derive(Debug, Clone, PartialEq)]
pub struct Parsed {
    /// Whose files they are.
    pub format: Format,
    /// The people of every camera.
    pub detections: Detections,
    /// Which keypoints were taken; `None` where there was nobody.
    pub mapping: Option<Mapping>,
    /// What was taken that the files do not say, and what of them was left out; sentences.
    pub notes: BTreeSet<String>,
    /// What may be wrong; sentences.
    pub doubts: BTreeSet<String>,
}

/// Reads one file.
///
/// # Errors
/// [`FileError`] with file, line or field: no known format, broken syntax, a number of keypoints that no model has, what is
/// no pixel.
pub fn parse(bytes: &[u8], path: &Path, options: ParseOptions) -> Result<Parsed, FileError> {
    let mut reading = Reading::new(options);
    reading.read(bytes, path)?;
    reading
        .finish()
        .ok_or_else(|| FileError::new(path, "found nothing in it"))
}

/// Reads the files of one source, one by one.
#[derive(Debug)]
pub struct Reading {
    options: ParseOptions,
    format: Option<Format>,
    content: Content,
}

/// What the readers of formats fill.
#[derive(Debug, Default)]
struct Content {
    detections: Detections,
    keypoints: Keypoints,
    notes: BTreeSet<String>,
    doubts: BTreeSet<String>,
}

impl Content {
    fn note(&mut self, text: &str) {
        if !self.notes.contains(text) {
            self.notes.insert(text.to_owned());
        }
    }
}

impl Reading {
    /// Nothing read yet.
    pub fn new(options: ParseOptions) -> Self {
        Self::after(options, 0)
    }

    /// Nothing read yet of this source, and `n_people` of the import's other sources: an import may have so many only.
    pub(crate) fn after(options: ParseOptions, n_people: usize) -> Self {
        Self {
            options,
            format: None,
            content: Content {
                detections: Detections::after(n_people),
                keypoints: Keypoints::new(options.model, options.model_hint),
                ..Content::default()
            },
        }
    }

    /// Reads one more file; its format is that of the first.
    ///
    /// # Errors
    /// As [`parse`].
    pub fn read(&mut self, bytes: &[u8], path: &Path) -> Result<(), FileError> {
        let limit = max_bytes(path);
        if bytes.len() as u64 > limit {
            let problem = format!("found {} bytes, expected at most {limit}", bytes.len());
            return Err(FileError::new(path, problem));
        }
        let format = match self.options.format.or(self.format) {
            Some(format) => format,
            None => recognised(bytes, path)?.ok_or_else(|| unknown(path))?,
        };
        self.format = Some(format);
        let content = &mut self.content;
        match format {
            Format::FreeMoCap => freemocap::read(bytes, path, content),
            Format::OpenPose => openpose::read(text(bytes, path)?, path, content),
            Format::AlphaPose | Format::CocoResults => {
                coco::read_results(text(bytes, path)?, path, content)
            }
            Format::CocoAnnotations => coco::read_annotations(text(bytes, path)?, path, content),
            Format::MmPose => mmpose::read(text(bytes, path)?, path, content),
            Format::DeepLabCut => deeplabcut::read(text(bytes, path)?, path, content),
            Format::Sleap => sleap::read(text(bytes, path)?, path, content),
            Format::Caliscope => caliscope::read(text(bytes, path)?, path, content),
        }
    }

    /// What was read; `None` where no file was.
    pub fn finish(self) -> Option<Parsed> {
        Some(Parsed {
            format: self.format?,
            detections: self.content.detections,
            mapping: self.content.keypoints.settled().cloned(),
            notes: self.content.notes,
            doubts: self.content.doubts,
        })
    }
}

fn unknown(path: &Path) -> FileError {
    let names: Vec<&str> = Format::ALL.iter().map(|format| format.name()).collect();
    FileError::new(
        path,
        format!(
            "its content is of no known format of 2D keypoints, expected one of {}",
            names.join(", ")
        ),
    )
}

/// Whose file it is, by its content; `None` where it is nobody's.
///
/// # Errors
/// [`FileError`] where its syntax is broken.
pub(crate) fn recognised(bytes: &[u8], path: &Path) -> Result<Option<Format>, FileError> {
    if npy::is_npy(bytes) {
        return Ok(Some(Format::FreeMoCap));
    }
    // The head of a table may end inside a character.
    let text = bytes.utf8_chunks().next().map_or("", |it| it.valid());
    let text = text.trim_start_matches('\u{feff}');
    match text.trim_start().chars().next() {
        Some('{' | '[') => json::recognised(text, path),
        Some(_) => Ok(table::recognised(text)),
        None => Ok(None),
    }
}

/// The text of a file, without the mark that some editors begin it with.
fn text<'a>(bytes: &'a [u8], path: &Path) -> Result<&'a str, FileError> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Ok(text.trim_start_matches('\u{feff}')),
        Err(error) => {
            let before = bytes.get(..error.valid_up_to()).unwrap_or_default();
            let line = before.split(|byte| *byte == b'\n').count();
            Err(FileError::new(path, "found bytes that are no UTF-8 text").at_line(line))
        }
    }
}

#[cfg(test)]
mod round_trips;
#[cfg(test)]
mod traps;
#[cfg(test)]
pub(crate) mod writers;
