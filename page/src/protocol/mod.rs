//! Messages between server and page, as bytes and JSON: `docs/page.md`. Pure: values in, bytes out,
//! and back.
//!
//! `page/golden/` contains an example of every binary message; the tests of this crate and of the
//! page read them.

pub mod camera_view;
pub mod chosen_angles;
pub mod request;
pub mod status;
pub mod text;
pub mod tick;
pub mod venue;

/// Version of the protocol: the first byte of every binary message.
pub const PROTOCOL: u8 = 1;

/// Why bytes are not the expected message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// The message is too short.
    #[error("the message ends after {got} bytes, expected {expected}")]
    TooShort {
        /// Its length.
        got: usize,
        /// The required minimum length.
        expected: usize,
    },
    /// Another version or kind of message.
    #[error("found version {version}, kind {kind}, expected version {PROTOCOL}, kind {expected}")]
    OtherKind {
        /// The version.
        version: u8,
        /// The kind.
        kind: u8,
        /// The expected kind.
        expected: u8,
    },
    /// The stride is shorter than one person.
    #[error("a person takes {got} bytes, expected at least {expected}")]
    ShortStride {
        /// The stride.
        got: usize,
        /// Size of a person.
        expected: usize,
    },
}

/// The bytes of a message.
#[derive(Clone, Copy)]
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    /// Reader of a message of the kind `expected`.
    fn with_kind(bytes: &'a [u8], expected: u8) -> Result<Self, ReadError> {
        let reader = Self(bytes);
        let [version, kind] = reader.array(0)?;
        if (version, kind) == (PROTOCOL, expected) {
            Ok(reader)
        } else {
            Err(ReadError::OtherKind {
                version,
                kind,
                expected,
            })
        }
    }

    fn array<const N: usize>(&self, at: usize) -> Result<[u8; N], ReadError> {
        let expected = at.saturating_add(N);
        let too_short = ReadError::TooShort {
            got: self.0.len(),
            expected,
        };
        let slice = self.0.get(at..expected).ok_or(too_short)?;
        slice.try_into().map_err(|_| too_short)
    }

    /// Checks that at least `bytes` are present, before memory is allocated.
    fn holds(&self, bytes: usize) -> Result<(), ReadError> {
        if self.0.len() >= bytes {
            Ok(())
        } else {
            Err(ReadError::TooShort {
                got: self.0.len(),
                expected: bytes,
            })
        }
    }

    fn u8(&self, at: usize) -> Result<u8, ReadError> {
        self.array::<1>(at).map(|[byte]| byte)
    }

    fn u16(&self, at: usize) -> Result<u16, ReadError> {
        self.array(at).map(u16::from_le_bytes)
    }

    fn i16(&self, at: usize) -> Result<i16, ReadError> {
        self.array(at).map(i16::from_le_bytes)
    }

    fn u32(&self, at: usize) -> Result<u32, ReadError> {
        self.array(at).map(u32::from_le_bytes)
    }

    fn u64(&self, at: usize) -> Result<u64, ReadError> {
        self.array(at).map(u64::from_le_bytes)
    }

    fn i64(&self, at: usize) -> Result<i64, ReadError> {
        self.array(at).map(i64::from_le_bytes)
    }

    fn f32(&self, at: usize) -> Result<f32, ReadError> {
        self.array(at).map(f32::from_le_bytes)
    }
}

#[cfg(test)]
mod golden;
