//! Messages as bytes: a version byte, then `postcard`, bounded in size and checked.
//!
//! Untrusted bytes enter here: [`decode`] is the only way to a message. A decoded message is well
//! formed: counts, grids, boxes, numbers and texts. Whether it makes sense (an existing camera, a
//! current session) is checked by the node.

use std::sync::atomic::{AtomicU8, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Version of the messages; any change of their fields or of the patch codec increments it.
///
/// The bytes of each version are fixed in `proto/golden/`, one folder per version, whose files are
/// only ever added. A message that changes keeps its older forms in [`crate::message`], so that old
/// recordings are read. A new kind of message under its own key changes no other, and may be added
/// within a version: older nodes do not subscribe to it.
pub const VERSION: u8 = 2;
/// The oldest version that is read: recordings are kept for years.
pub const OLDEST_READ: u8 = 1;
/// The oldest version that is written, for nodes that are not updated yet: the previous one.
pub const OLDEST_WRITTEN: u8 = VERSION - 1;
/// Longest message, bytes. It also bounds the allocation of decoding: memory is reserved for the
/// elements that exist, not for the number that a message claims, so less than 64 bytes for each
/// byte of the message. Absent keypoints of sightings add at most 256 KiB.
pub const MAX_MESSAGE_BYTES: usize = 1 << 20;
/// Most messages of a viewpoint for one tick.
pub const MAX_PARTS: u16 = 1024;
/// Most cameras of one viewpoint.
pub const MAX_CAMERAS: usize = 64;
/// Most joints of a skeleton, and most of its angles (one bit each in `unobserved`).
pub const MAX_JOINTS: usize = 64;
/// Longest text of a status, bytes; longer texts are cut by [`cut_text`].
pub const MAX_TEXT_BYTES: usize = 8192;
/// Longest reason of a refusal in fusion's status, bytes: with one for every edge of the largest
/// venue, the status still fits a message.
pub const MAX_REFUSAL_BYTES: usize = 1024;
/// Longest reason of a camera in a status, bytes.
pub const MAX_REASON_BYTES: usize = 512;
/// Longest fingerprint in a status, bytes: one refusal contains two of them.
pub const MAX_HASH_BYTES: usize = 256;

/// A message between nodes.
pub trait Message: Serialize + DeserializeOwned {
    /// Checks counts, sizes and numbers.
    ///
    /// # Errors
    /// A short description of the problem.
    fn check(&self) -> Result<(), &'static str>;

    /// Escapes characters that are not plain ([`crate::plain_text`]) in the texts for people.
    fn make_plain(&mut self) {}

    /// Appends the message to `bytes` in the form of `version`, [`OLDEST_WRITTEN`] to [`VERSION`].
    ///
    /// # Errors
    /// Postcard's error; never for messages whose sequences know their length.
    fn write(&self, _version: u8, bytes: Vec<u8>) -> postcard::Result<Vec<u8>> {
        postcard::to_extend(self, bytes)
    }

    /// The message at the start of `bytes`, written by `version` ([`OLDEST_READ`] to [`VERSION`]),
    /// and the rest.
    ///
    /// # Errors
    /// Postcard's error.
    fn read(_version: u8, bytes: &[u8]) -> postcard::Result<(Self, &[u8])> {
        postcard::take_from_bytes(bytes)
    }
}

/// Why bytes are not a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WireError {
    /// The bytes are empty.
    #[error("the message is empty")]
    Empty,
    /// The message is too long.
    #[error("the message has {got} bytes, at most {MAX_MESSAGE_BYTES} are read")]
    TooLong {
        /// Its length.
        got: usize,
    },
    /// The message has another version.
    #[error(
        "it speaks version {got} of the messages, here {OLDEST_READ} to {VERSION} are read: update the older node"
    )]
    Version {
        /// Its version.
        got: u8,
    },
    /// The bytes are not this kind of message.
    #[error("the message cannot be read: {problem}")]
    Unreadable {
        /// Postcard's error.
        problem: String,
    },
    /// There are extra bytes after the message.
    #[error("{left} bytes are left over after the message")]
    LeftOver {
        /// Number of bytes.
        left: usize,
    },
    /// The content is impossible.
    #[error("the message is not valid: {0}")]
    Invalid(&'static str),
}

/// The message as bytes, version first.
///
/// # Panics
/// Never for the messages of [`crate::message`]: all their sequences know their length.
pub fn encode<M: Message>(message: &M) -> Vec<u8> {
    encode_as(message, VERSION)
}

/// The message as bytes for a node that reads `version`, version first. A version outside the
/// written ones counts as the nearest of them.
///
/// # Panics
/// Never for the messages of [`crate::message`]: all their sequences know their length.
pub fn encode_as<M: Message>(message: &M, version: u8) -> Vec<u8> {
    let version = version.clamp(OLDEST_WRITTEN, VERSION);
    message
        .write(version, vec![version])
        .expect("writing to memory a type whose sequences know their length")
}

/// The message as bytes for an unknown node: requests and their answers.
///
/// # Panics
/// Never for the messages of [`crate::message`]: all their sequences know their length.
pub fn encode_for_anyone<M: Message>(message: &M) -> Vec<u8> {
    encode_as(message, OLDEST_WRITTEN)
}

/// The version of messages to a node: the newest that both nodes read. So nodes of two neighbouring
/// versions work together, and a venue is updated machine by machine, fusion first.
///
/// The attachment of a status contains the newest version that its node reads; the status itself
/// has a version that all receivers read.
#[derive(Debug)]
pub struct SpokenVersion(AtomicU8);

impl Default for SpokenVersion {
    fn default() -> Self {
        Self(AtomicU8::new(VERSION))
    }
}

impl SpokenVersion {
    /// Notes a status of the node, and the newest version that it `reads`; `None` means the version
    /// of the status.
    pub fn note_status(&self, status: &[u8], reads: Option<u8>) {
        if let Some(version) = reads.or_else(|| status.first().copied()) {
            let spoken = version.clamp(OLDEST_WRITTEN, VERSION);
            self.0.store(spoken, Ordering::Relaxed);
        }
    }

    /// The version to write for the node.
    pub fn get(&self) -> u8 {
        self.0.load(Ordering::Relaxed)
    }
}

/// The start of `text`, at most [`MAX_TEXT_BYTES`], cut between characters.
pub fn cut_text(text: String) -> String {
    cut(text, MAX_TEXT_BYTES)
}

/// The start of a camera's error, at most [`MAX_REASON_BYTES`], cut between characters.
pub fn cut_reason(text: String) -> String {
    cut(text, MAX_REASON_BYTES)
}

/// The start of a refusal's reason, at most [`MAX_REFUSAL_BYTES`], cut between characters.
pub fn cut_refusal(text: String) -> String {
    cut(text, MAX_REFUSAL_BYTES)
}

fn cut(mut text: String, most_bytes: usize) -> String {
    text.truncate(text.floor_char_boundary(most_bytes));
    text
}

/// Decodes a message of kind `M`.
///
/// # Errors
/// [`WireError`] when the bytes are not exactly one valid message of a readable version.
pub fn decode<M: Message>(bytes: &[u8]) -> Result<M, WireError> {
    if bytes.len() > MAX_MESSAGE_BYTES {
        return Err(WireError::TooLong { got: bytes.len() });
    }
    let (&version, body) = bytes.split_first().ok_or(WireError::Empty)?;
    if !(OLDEST_READ..=VERSION).contains(&version) {
        return Err(WireError::Version { got: version });
    }
    let (mut message, rest) = M::read(version, body).map_err(|error| WireError::Unreadable {
        problem: error.to_string(),
    })?;
    if !rest.is_empty() {
        return Err(WireError::LeftOver { left: rest.len() });
    }
    message.check().map_err(WireError::Invalid)?;
    message.make_plain();
    Ok(message)
}

#[cfg(test)]
mod fixture;
#[cfg(test)]
mod golden;
#[cfg(test)]
mod tests;
