//! Why an export failed.

use std::io;
use std::path::{Path, PathBuf};

use farfield_proto::toml_file::FileError;

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The run's files are not as they should be.
    #[error("{0}")]
    Run(Box<FileError>),
    /// The system refused.
    #[error("{what} {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was done.
        what: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// A file is there already.
    #[error("{} is there already", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The options do not fit the run or the format.
    #[error("{0}")]
    Options(String),
}

impl ExportError {
    pub(crate) fn io(path: &Path, what: &'static str, source: io::Error) -> Self {
        Self::Io {
            path: path.to_owned(),
            what,
            source,
        }
    }
}

impl From<FileError> for ExportError {
    fn from(error: FileError) -> Self {
        Self::Run(Box::new(error))
    }
}
