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
    /// One of the options does not fit the run or the format.
    #[error("{problem}")]
    Option {
        /// Which.
        field: OptionField,
        /// What was found and what was expected.
        problem: String,
    },
    /// What is asked for does not fit the run, whichever option that is.
    #[error("{0}")]
    Options(String),
}

/// What of an [`ExportRequest`](crate::ExportRequest) an error is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionField {
    /// Who is exported.
    People,
    /// What people are called.
    Called,
    /// Which ticks.
    Ticks,
    /// Frames per second.
    Rate,
    /// What becomes of ticks without a pose.
    Gaps,
    /// The longest gap that is filled.
    LongestGap,
    /// Profiles of people.
    Subjects,
}

impl ExportError {
    pub(crate) fn option(field: OptionField, problem: String) -> Self {
        Self::Option { field, problem }
    }

    /// Of the option where it was given: nobody has to look for one that was not.
    pub(crate) fn of(given: Option<OptionField>, problem: String) -> Self {
        match given {
            Some(field) => Self::option(field, problem),
            None => Self::Options(problem),
        }
    }

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
