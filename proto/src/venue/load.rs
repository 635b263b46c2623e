//! Reading a venue and its calibration from files: the only file access of this crate.

use std::fs;
use std::path::Path;

use super::{Venue, VenueFile};
use crate::calibration::Calibration;
use crate::toml_file::FileError;
use crate::transport::Identity;

impl Venue {
    /// Reads the venue file at `path` and the calibration that it names.
    ///
    /// # Errors
    /// [`FileError`] when a file cannot be read, and as [`VenueFile::parse`], [`VenueFile::venue`] and [`Calibration::parse`].
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let text = fs::read_to_string(path).map_err(|error| {
            FileError::new(path, format!("cannot read the venue file: {error}"))
        })?;
        let file = VenueFile::parse(&text, path)?;
        let calibration_path = file.calibration_path();
        let calibration_text = fs::read_to_string(&calibration_path).map_err(|error| {
            file.calibration_error(format!(
                "cannot read {}: {error}",
                calibration_path.display()
            ))
        })?;
        file.venue(Calibration::parse(&calibration_text, &calibration_path)?)
    }
}

/// The files in `folder` by which `node` proves who it is.
///
/// # Errors
/// [`FileError`] naming the first of them that cannot be read.
pub fn identity(folder: &Path, node: &str) -> Result<Identity, FileError> {
    let identity = Identity::in_folder(folder, node);
    let files = [
        (
            &identity.authority,
            "the certificate of the venue's authority",
        ),
        (&identity.certificate, "the certificate of this node"),
        (&identity.key, "the key of this node"),
    ];
    for (path, what) in files {
        fs::File::open(path).map_err(|error| {
            let problem = format!("cannot read {what}: {error}; `farfield certs` makes it");
            FileError::new(path, problem)
        })?;
    }
    Ok(identity)
}
