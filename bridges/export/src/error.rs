//! Why an export failed.

use std::io;
use std::path::{Path, PathBuf};

use farfield_proto::toml_file::FileError;

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The run's files are invalid.
    #[error("{0}")]
    Run(Box<FileError>),
    /// An operation of the system failed.
    #[error("{what} {}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The operation.
        what: &'static str,
        /// The error of the operating system.
        source: io::Error,
    },
    /// A file already exists.
    #[error("{} is there already", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// An option does not fit the run or the format.
    #[error("{problem}")]
    Option {
        /// The option.
        field: OptionField,
        /// What was found and what was expected.
        problem: String,
    },
    /// The request does not fit the run; no single option is the cause.
    #[error("{0}")]
    Options(String),
}

/// The part of an [`ExportRequest`](crate::ExportRequest) that an error is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OptionField {
    /// Selection of people.
    People,
    /// Names of people.
    Called,
    /// Selection of ticks.
    Ticks,
    /// Frames per second.
    Rate,
    /// Treatment of ticks without a pose.
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

    /// Attributes the problem to the option only if it was given.
    pub(crate) fn with_option(given: Option<OptionField>, problem: String) -> Self {
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
