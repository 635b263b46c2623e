//! Why a recording cannot be read.

use crate::recording::PROFILE;
use crate::recording::framing::FramingError;

/// Why a file cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file is none, or broken.
    #[error(transparent)]
    Framing(#[from] FramingError),
    /// Another program's.
    #[error("an MCAP file of profile {0:?}, not of \"{PROFILE}\"")]
    Foreign(String),
    /// It ends before it has said what it is a recording of.
    #[error("it ends before its head does: nothing was recorded")]
    NoHead,
    /// A place that was a message is none any more.
    #[error("byte {0}: the file has changed while it was read")]
    Changed(u64),
}
