//! Which calibration a venue file names: what a caller must read before the venue file can be checked.

use std::path::{Path, PathBuf};

use super::Venue;
use super::raw::RawVenue;
use crate::toml_file::{FileError, TomlFile};

impl Venue {
    /// Where the calibration lies that the venue file `text` names; `path` as for [`Venue::parse`].
    ///
    /// # Errors
    /// [`FileError`] naming line and field when the text is no venue file.
    pub fn named_calibration(text: &str, path: &Path) -> Result<PathBuf, FileError> {
        let file = TomlFile::parse(text, path)?;
        let raw: RawVenue = file.read()?;
        Ok(file.resolve(&raw.calibration))
    }
}
