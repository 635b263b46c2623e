//! Why an import failed.

use std::io;
use std::path::{Path, PathBuf};

use farfield_proto::toml_file::FileError;

/// Why an import failed. A failed import leaves no files behind.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A file is invalid.
    #[error("{0}")]
    File(FileError),
    /// Something else in the request or the folder is invalid.
    #[error("{0}")]
    Refused(String),
    /// A file or folder cannot be read.
    #[error("{doing} {}", path.display())]
    Read {
        /// The operation that failed.
        doing: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A file or folder cannot be written.
    #[error("{doing} {}", path.display())]
    Write {
        /// The operation that failed.
        doing: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The error of the operating system.
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
