//! Errors of written files.

use std::fmt;
use std::io;
use std::path::PathBuf;

use farfield_proto::tick::Tick;
use serde::{Deserialize, Serialize};

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The system refused.
    #[error("writing {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// Ticks came out of order.
    #[error("tick {tick} came after tick {last}")]
    OutOfOrder {
        /// The current tick.
        tick: Tick,
        /// The last one written.
        last: Tick,
    },
}

/// A file that the system refused.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Refusal {
    /// Its name.
    pub file: String,
    /// The system's error.
    pub failure: String,
    /// The part in which it continues; at the end of the run it is joined if the disk allows it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub goes_on_in: Option<String>,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.failure)?;
        match &self.goes_on_in {
            Some(part) => write!(f, "; it goes on in {part}"),
            None => Ok(()),
        }
    }
}
