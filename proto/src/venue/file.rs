//! Converts the texts of a venue file and of its calibration to a venue. The first text names the
//! second file; the caller reads both.

use std::path::{Path, PathBuf};

use super::raw::RawVenue;
use super::{Venue, VenueHash, check, layout};
use crate::calibration::Calibration;
use crate::toml_file::{FileError, Place, TomlFile};

/// A parsed venue file: its fields and their types are valid, their values not yet checked.
pub struct VenueFile<'a> {
    file: TomlFile<'a>,
    raw: RawVenue,
}

impl<'a> VenueFile<'a> {
    /// Parses a venue file. Its paths are relative to the folder of `path`, which errors also name.
    ///
    /// # Errors
    /// [`FileError`] with line and field for broken syntax and for a missing, unknown, mistyped or
    /// misplaced field.
    pub fn parse(text: &'a str, path: &'a Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        layout::check(&file)?;
        let raw = file.read()?;
        Ok(Self { file, raw })
    }

    /// The path of its calibration file.
    pub fn calibration_path(&self) -> PathBuf {
        self.file.resolve(&self.raw.calibration)
    }

    /// An error about its calibration file, at that field and its line.
    pub fn calibration_error(&self, problem: impl Into<String>) -> FileError {
        self.file.error(&Place::field("calibration"), problem)
    }

    /// The venue with the calibration from [`Self::calibration_path`].
    ///
    /// # Errors
    /// [`FileError`] with line and field for a value out of range or inconsistent with the
    /// calibration.
    pub fn venue(self, calibration: Calibration) -> Result<Venue, FileError> {
        let hashes = VenueHash {
            venue: self.file.fingerprint(),
            calibration: calibration.hash.clone(),
        };
        check::venue(&self.file, self.raw, calibration, hashes)
    }
}
