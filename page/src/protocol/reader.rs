//! Reads little-endian numbers at given places; a place past the end is an error, never a panic.

use super::{PROTOCOL, ReadError};

/// The bytes of a message.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    /// Of a message of the kind `expected`.
    pub(super) fn of_kind(bytes: &'a [u8], expected: u8) -> Result<Self, ReadError> {
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

    pub(super) fn array<const N: usize>(&self, at: usize) -> Result<[u8; N], ReadError> {
        let expected = at.saturating_add(N);
        let too_short = ReadError::TooShort {
            got: self.0.len(),
            expected,
        };
        let slice = self.0.get(at..expected).ok_or(too_short)?;
        slice.try_into().map_err(|_| too_short)
    }

    /// That there are `bytes` at least: before memory is asked for.
    pub(super) fn holds(&self, bytes: usize) -> Result<(), ReadError> {
        if self.0.len() >= bytes {
            Ok(())
        } else {
            Err(ReadError::TooShort {
                got: self.0.len(),
                expected: bytes,
            })
        }
    }

    pub(super) fn u8(&self, at: usize) -> Result<u8, ReadError> {
        self.array::<1>(at).map(|[byte]| byte)
    }

    pub(super) fn u16(&self, at: usize) -> Result<u16, ReadError> {
        self.array(at).map(u16::from_le_bytes)
    }

    pub(super) fn i16(&self, at: usize) -> Result<i16, ReadError> {
        self.array(at).map(i16::from_le_bytes)
    }

    pub(super) fn u32(&self, at: usize) -> Result<u32, ReadError> {
        self.array(at).map(u32::from_le_bytes)
    }

    pub(super) fn u64(&self, at: usize) -> Result<u64, ReadError> {
        self.array(at).map(u64::from_le_bytes)
    }

    pub(super) fn i64(&self, at: usize) -> Result<i64, ReadError> {
        self.array(at).map(i64::from_le_bytes)
    }

    pub(super) fn f32(&self, at: usize) -> Result<f32, ReadError> {
        self.array(at).map(f32::from_le_bytes)
    }
}
