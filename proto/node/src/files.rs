//! The files that describe a venue, read for the pure code that understands them.

use std::fs;
use std::path::Path;

use farfield_proto::calibration::Calibration;
use farfield_proto::toml_file::FileError;
use farfield_proto::transport::Identity;
use farfield_proto::venue::{Venue, VenueFile};

/// Reads the venue file at `path` and the calibration that it names.
///
/// # Errors
/// [`FileError`] when a file cannot be read, and as [`VenueFile::parse`],
/// [`VenueFile::venue`] and [`Calibration::parse`].
pub fn load_venue(path: &Path) -> Result<Venue, FileError> {
    let text = fs::read_to_string(path)
        .map_err(|error| FileError::new(path, format!("cannot read the venue file: {error}")))?;
    parse_venue(&text, path)
}

/// Understands `text` as the venue file at `path`, and reads the calibration that it names.
///
/// # Errors
/// As [`load_venue`].
pub fn parse_venue(text: &str, path: &Path) -> Result<Venue, FileError> {
    let file = VenueFile::parse(text, path)?;
    let calibration_path = file.calibration_path();
    let calibration_text = fs::read_to_string(&calibration_path).map_err(|error| {
        file.calibration_error(format!(
            "cannot read {}: {error}",
            calibration_path.display()
        ))
    })?;
    file.venue(Calibration::parse(&calibration_text, &calibration_path)?)
}

/// The files in `folder` by which `node` proves who it is.
///
/// # Errors
/// [`FileError`] naming the first of them that cannot be read.
pub fn load_identity(folder: &Path, node: &str) -> Result<Identity, FileError> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_cannot_be_read_is_named() {
        let refused = load_venue(Path::new("no/such/venue.toml"))
            .unwrap_err()
            .to_string();
        assert!(
            refused.starts_with("no/such/venue.toml: cannot read the venue file"),
            "{refused}"
        );
    }
}
