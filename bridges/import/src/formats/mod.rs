//! Readers of 2D keypoint formats. [`parse`] reads one file; [`Reading`] reads a recording with one
//! file per frame.
//!
//! Formats are recognised by content. Missing scores are replaced by assumptions, which are
//! reported.

mod animals;
mod caliscope;
mod coco;
mod freemocap;
mod json;
mod mmpose;
mod npy;
mod openpose;
mod table;

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use farfield_proto::toml_file::FileError;

use crate::keypoints::{Keypoints, Mapping, Model};
use crate::person::Detections;

/// Maximum size of a table or array, bytes.
const MAX_FILE_BYTES: u64 = 1 << 30;
/// Maximum size of a JSON file, bytes; parsing takes several times as much memory.
const MAX_JSON_BYTES: u64 = 1 << 29;

/// Maximum size of a file with this name, bytes.
pub(crate) fn max_bytes(path: &Path) -> u64 {
    let ending = path.extension().unwrap_or_default();
    if ending.eq_ignore_ascii_case("json") {
        MAX_JSON_BYTES
    } else {
        MAX_FILE_BYTES
    }
}

/// File format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// `OpenPose` and Pose2Sim: one JSON file per frame, in one folder per camera.
    OpenPose,
    /// `AlphaPose`'s `alphapose-results.json`.
    AlphaPose,
    /// COCO keypoint results.
    CocoResults,
    /// COCO keypoint annotations.
    CocoAnnotations,
    /// `MMPose` predictions.
    MmPose,
    /// `DeepLabCut` CSV.
    DeepLabCut,
    /// SLEAP analysis CSV.
    Sleap,
    /// Caliscope's `xy_*.csv`: all cameras in one file.
    Caliscope,
    /// `FreeMoCap`'s `*2dData*.npy`: all cameras in one file.
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

    /// Name on the command line.
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

    /// The format of this name; `pose2sim` is the same as `openpose`.
    pub fn from_name(name: &str) -> Option<Self> {
        if name == "pose2sim" {
            return Some(Self::OpenPose);
        }
        Self::ALL.into_iter().find(|format| format.name() == name)
    }
}

impl Format {
    /// File extension.
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

/// What the caller knows about the files. The default relies on their content.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ParseOptions {
    /// Format; `None` to recognise it by content.
    pub format: Option<Format>,
    /// Keypoint model; `None` to recognise it by keypoint names or count.
    pub model: Option<Model>,
    /// Model in settings next to the files; decides between models of equal count.
    pub model_hint: Option<Model>,
}

/// Parsed content of one source.
#[derive(Debug, Clone, PartialEq)]
pub struct Parsed {
    /// Format of the files.
    pub format: Format,
    /// The people of every camera.
    pub detections: Detections,
    /// Keypoint mapping; `None` if there were no people.
    pub mapping: Option<Mapping>,
    /// Sentences about assumptions and dropped data.
    pub notes: BTreeSet<String>,
    /// Sentences about suspect data.
    pub warnings: BTreeSet<String>,
}

/// Reads one file.
///
/// # Errors
/// [`FileError`] with file, line or field: unknown format, invalid syntax, a keypoint count of no
/// model, or coordinates that are not pixels.
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

/// What the format readers fill.
#[derive(Debug, Default)]
struct Content {
    detections: Detections,
    keypoints: Keypoints,
    notes: BTreeSet<String>,
    warnings: BTreeSet<String>,
}

impl Content {
    fn note(&mut self, text: &str) {
        if !self.notes.contains(text) {
            self.notes.insert(text.to_owned());
        }
    }
}

impl Reading {
    /// A reader that has read nothing yet.
    pub fn new(options: ParseOptions) -> Self {
        Self::after(options, 0)
    }

    /// A reader for a further source; `n_people` were read from other sources of the import, which
    /// counts towards its limit.
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

    /// Reads one more file; the first file decides the format.
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
            Format::DeepLabCut => animals::read_deeplabcut(text(bytes, path)?, path, content),
            Format::Sleap => animals::read_sleap(text(bytes, path)?, path, content),
            Format::Caliscope => caliscope::read(text(bytes, path)?, path, content),
        }
    }

    /// The content; `None` if no file was read.
    pub fn finish(self) -> Option<Parsed> {
        Some(Parsed {
            format: self.format?,
            detections: self.content.detections,
            mapping: self.content.keypoints.settled().cloned(),
            notes: self.content.notes,
            warnings: self.content.warnings,
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

/// Recognises a format by content; `None` if unknown.
///
/// # Errors
/// [`FileError`] if its syntax is invalid.
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

/// Decodes UTF-8 without the byte order mark that some editors write.
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
mod tests;
#[cfg(test)]
pub(crate) mod writers;
