//! Reading of recordings: tick by tick for a replay, or in order of time for a view.
//!
//! Messages are read by their places in the file. For a file with compressed chunks, one decompressed chunk is cached.

pub mod attached;
pub mod messages;
pub mod published;
pub mod reader;

use std::io::{Read, Seek, SeekFrom};

use super::PROFILE;
use super::framing::{FramingError, PackedChunk, RecordPlace, unpack};

/// Why a file cannot be replayed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file is not MCAP, or is broken.
    #[error(transparent)]
    Framing(#[from] FramingError),
    /// A file of another program.
    #[error("an MCAP file of profile {0:?}, expected \"{PROFILE}\"")]
    Foreign(String),
    /// It ends before its metadata.
    #[error("it ends inside its head: nothing was recorded")]
    NoHead,
    /// The file changed while it was read.
    #[error("byte {0}: the file has changed while it was read")]
    Changed(u64),
}

/// See [`MessagePosition::chunk`].
const NO_CHUNK: u32 = u32::MAX;
/// Channel, sequence and two times before a message's bytes.
const MESSAGE_HEAD_BYTES: u64 = 2 + 4 + 8 + 8;

/// Place of a recorded message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct MessagePosition {
    /// Number of its compressed chunk; [`NO_CHUNK`] if it is directly in the file.
    chunk: u32,
    /// Its first byte: of the file, or of the chunk's decompressed records.
    at: u64,
    len: u32,
}

/// The compressed chunks of a file, numbered while it is read.
#[derive(Debug, Default)]
struct ChunkNumbers(Vec<PackedChunk>);

impl ChunkNumbers {
    /// The place of a message's bytes; its record is at `place`, in the last chunk. `None` for an
    /// impossibly long message.
    fn position(&mut self, place: RecordPlace, data: &[u8]) -> Option<MessagePosition> {
        Some(MessagePosition {
            chunk: self.number(place.chunk),
            at: place.at + MESSAGE_HEAD_BYTES,
            len: u32::try_from(data.len()).ok()?,
        })
    }

    fn number(&mut self, chunk: Option<PackedChunk>) -> u32 {
        let Some(chunk) = chunk else {
            return NO_CHUNK;
        };
        if self.0.last() != Some(&chunk) {
            self.0.push(chunk);
        }
        self.0.len() as u32 - 1
    }
}

/// A file whose messages are read by their places.
#[derive(Debug)]
struct PlacedMessages<R> {
    file: R,
    chunks: Vec<PackedChunk>,
    /// The last read compressed chunk, and its records.
    unpacked: Option<(u32, Vec<u8>)>,
}

impl<R: Read + Seek> PlacedMessages<R> {
    fn new(file: R, chunks: ChunkNumbers) -> Self {
        Self {
            file,
            chunks: chunks.0,
            unpacked: None,
        }
    }

    /// The bytes of a message.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    fn bytes(&mut self, position: MessagePosition) -> Result<Vec<u8>, RecordingError> {
        if position.chunk == NO_CHUNK {
            return self.file_bytes(position.at, u64::from(position.len));
        }
        let kept = self.unpacked.take().filter(|(n, _)| *n == position.chunk);
        let records = match kept {
            Some((_, records)) => records,
            None => self.unpack(position)?,
        };
        let bytes = usize::try_from(position.at).ok().and_then(|at| {
            let until = at.checked_add(position.len as usize)?;
            records.get(at..until).map(<[u8]>::to_vec)
        });
        self.unpacked = Some((position.chunk, records));
        bytes.ok_or(RecordingError::Changed(position.at))
    }

    /// The records of the compressed chunk of `position`.
    fn unpack(&mut self, position: MessagePosition) -> Result<Vec<u8>, RecordingError> {
        let chunk = self.chunks.get(position.chunk as usize).copied();
        let chunk = chunk.ok_or(RecordingError::Changed(position.at))?;
        let body = self.file_bytes(chunk.at, chunk.len)?;
        Ok(unpack(&body, chunk.at)?)
    }

    fn file_bytes(&mut self, at: u64, len: u64) -> Result<Vec<u8>, RecordingError> {
        let mut bytes = vec![0; len as usize];
        self.file
            .seek(SeekFrom::Start(at))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(FramingError::Io)?;
        Ok(bytes)
    }
}
