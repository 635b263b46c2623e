//! Errors of reading a recording.

use crate::recording::PROFILE;
use crate::recording::framing::FramingError;

/// Why a file cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file is not MCAP, or is broken.
    #[error(transparent)]
    Framing(#[from] FramingError),
    /// A file of another program.
    #[error("an MCAP file of profile {0:?}, not of \"{PROFILE}\"")]
    Foreign(String),
    /// It ends before its metadata.
    #[error("it ends before its head does: nothing was recorded")]
    NoHead,
    /// The file changed while it was read.
    #[error("byte {0}: the file has changed while it was read")]
    Changed(u64),
}
