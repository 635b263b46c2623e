//! Why nothing was imported.

use std::io;
use std::path::{Path, PathBuf};

use farfield_proto::toml_file::FileError;

/// Why nothing was imported; nothing is left behind then.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file is not as it should be.
    #[error("{0}")]
    File(FileError),
    /// Something else of what was given is not as it should be.
    #[error("{0}")]
    Refused(String),
    /// What was named or found cannot be read.
    #[error("{doing} {}", path.display())]
    Read {
        /// What was tried.
        doing: &'static str,
        /// With which file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// What was made cannot be written.
    #[error("{doing} {}", path.display())]
    Write {
        /// What was tried.
        doing: &'static str,
        /// With which file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
}

impl ImportError {
    pub(crate) fn refused(text: impl Into<String>) -> Self {
        Self::Refused(text.into())
    }

    pub(crate) fn read(doing: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Read {
            doing,
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn write(doing: &'static str, path: &Path, source: io::Error) -> Self {
        Self::Write {
            doing,
            path: path.to_owned(),
            source,
        }
    }
}

impl From<FileError> for ImportError {
    fn from(error: FileError) -> Self {
        Self::File(error)
    }
}
