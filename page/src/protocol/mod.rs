//! What server and page say to each other, as bytes and as JSON: `docs/page.md`. Pure: values in, bytes out, and back.
//!
//! The bytes of one example of every binary message stand in `page/golden/`; this crate's tests and the page's read them.

pub mod camera_view;
pub mod chosen_angles;
pub mod json_tick;
mod reader;
pub mod request;
pub mod status;
pub mod text;
pub mod tick;
pub mod venue;

/// Version of the protocol: the first byte of every binary message.
pub const PROTOCOL: u8 = 1;

/// Why bytes are not the message that was expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// They end too early.
    #[error("the message ends after {got} bytes, expected {expected}")]
    TooShort {
        /// How many there are.
        got: usize,
        /// How many at least there should be.
        expected: usize,
    },
    /// Another version, or another kind of message.
    #[error("found version {version}, kind {kind}, expected version {PROTOCOL}, kind {expected}")]
    OtherKind {
        /// Its version.
        version: u8,
        /// Its kind.
        kind: u8,
        /// The kind that was expected.
        expected: u8,
    },
    /// A stride that is shorter than what it strides over.
    #[error("a person takes {got} bytes, expected at least {expected}")]
    ShortStride {
        /// The stride.
        got: usize,
        /// What a person takes.
        expected: usize,
    },
}

#[cfg(test)]
mod golden;
