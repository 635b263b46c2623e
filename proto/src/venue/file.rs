//! From the texts of a venue file and of its calibration to a venue. Whoever reads files asks the first
//! text which file the second one is.

use std::path::{Path, PathBuf};

use super::raw::RawVenue;
use super::{Venue, VenueHash, check, layout};
use crate::calibration::Calibration;
use crate::toml_file::{FileError, Place, TomlFile};

/// The text of a venue file: its fields are known and of the right types, their values not yet checked.
pub struct VenueFile<'a> {
    file: TomlFile<'a>,
    raw: RawVenue,
}

impl<'a> VenueFile<'a> {
    /// Reads the text of a venue file. `path` gives the folder that its paths are relative to, and
    /// is named in errors.
    ///
    /// # Errors
    /// [`FileError`] naming line and field for broken syntax and for anything that is missing, unknown, of
    /// another type or at another place.
    pub fn parse(text: &'a str, path: &'a Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        layout::check(&file)?;
        let raw = file.read()?;
        Ok(Self { file, raw })
    }

    /// The calibration file that it names.
    pub fn calibration_path(&self) -> PathBuf {
        self.file.resolve(&self.raw.calibration)
    }

    /// A problem with the calibration file that it names, said of that field and its line.
    pub fn calibration_error(&self, problem: impl Into<String>) -> FileError {
        self.file.error(&Place::field("calibration"), problem)
    }

    /// The venue, with the calibration that stands at [`Self::calibration_path`].
    ///
    /// # Errors
    /// [`FileError`] naming line and field for anything that is out of its range or at odds with the
    /// calibration.
    pub fn venue(self, calibration: Calibration) -> Result<Venue, FileError> {
        let hashes = VenueHash {
            venue: self.file.fingerprint(),
            calibration: calibration.hash.clone(),
        };
        check::venue(&self.file, self.raw, calibration, hashes)
    }
}
