//! The records of an MCAP file in order, each with its place (mcap.dev/spec), and its metadata
//! first. The crate `mcap` reads records and chunks; this module decides which of them may be read,
//! and their largest size.
//!
//! Lengths are never trusted: no allocation exceeds the rest of the file or a bound, and no chunk
//! is decompressed to more than [`MAX_CHUNK_BYTES`].

use std::io::{self, BufReader, Read, Seek, SeekFrom};

use mcap::McapError;
use mcap::records::{Metadata, Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::compression::{CompressionFormat, Decompression};

/// Longest chunk that is read, bytes, compressed and decompressed: ours have 4 MiB and one message.
const MAX_CHUNK_BYTES: u64 = 64 << 20;
/// Longest other record that is read, bytes; longer ones are skipped.
pub(super) const MAX_RECORD_BYTES: u64 = 16 << 20;
/// Opcode and length.
const HEAD_BYTES: u64 = 9;

/// Why a file is not a recording.
#[derive(Debug, thiserror::Error)]
pub enum FramingError {
    /// The system refused.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// It has another beginning.
    #[error("not an MCAP file: it does not begin with MCAP's magic bytes")]
    NotMcap,
    /// Invalid content.
    #[error("damaged at byte {at}: {problem}")]
    Damaged {
        /// Place in the file.
        at: u64,
        /// What is wrong.
        problem: &'static str,
    },
    /// Chunks have an unsupported compression.
    #[error("its chunks are compressed by {0:?}, expected \"lz4\" or \"zstd\"")]
    Compressed(String),
}

/// How a file ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileEnd {
    /// Bytes that could be read.
    pub read_bytes: u64,
    /// Bytes of the file.
    pub file_bytes: u64,
    /// Whether its end was written: otherwise the writer was stopped.
    pub whole: bool,
    /// Chunks and attached files with a wrong checksum; they were skipped.
    pub damaged_chunks: u64,
}

/// The body of a compressed chunk in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct PackedChunk {
    pub(super) at: u64,
    pub(super) len: u64,
}

/// Place of a record's body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RecordPlace {
    /// Its compressed chunk; `None` if it is directly in the file.
    pub(super) chunk: Option<PackedChunk>,
    /// First byte: of the file, or of the chunk's decompressed records.
    pub(super) at: u64,
}

/// Receives every relevant record of a file: header, channels, messages, attached files and
/// metadata.
pub(super) type Visit<'a> = dyn FnMut(Record<'_>, RecordPlace) + 'a;

/// Reads a file and calls `visit` for its records.
pub(super) fn walk<R: Read + Seek>(
    file: &mut R,
    visit: &mut Visit<'_>,
) -> Result<FileEnd, FramingError> {
    let file_bytes = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(0))?;
    let mut end = FileEnd {
        read_bytes: mcap::MAGIC.len() as u64,
        file_bytes,
        whole: false,
        damaged_chunks: 0,
    };
    let mut reader = LinearReader::new_with_options(file_options(false));
    let mut loaded = 0;
    while let Some(event) = reader.next_event() {
        let at = end.read_bytes + HEAD_BYTES;
        match event {
            Ok(LinearReadEvent::ReadRequest(n)) => {
                if n as u64 > file_bytes - loaded {
                    break;
                }
                file.read_exact(&mut reader.insert(n)[..n])?;
                reader.notify_read(n);
                loaded += n as u64;
            }
            Ok(LinearReadEvent::Record { data, opcode }) => {
                end.read_bytes = at + data.len() as u64;
                end.damaged_chunks += u64::from(!record(opcode, data, at, visit)?);
                end.whole = opcode == op::FOOTER;
            }
            Err(McapError::RecordTooLarge { opcode, len }) => {
                let Some(next) = at.checked_add(len).filter(|&next| next <= file_bytes) else {
                    break;
                };
                if opcode == op::CHUNK {
                    return Err(damaged(at, "a chunk that is too long"));
                }
                loaded = file.seek(SeekFrom::Start(next))?;
                end.read_bytes = next;
                reader = LinearReader::new_with_options(file_options(true));
            }
            Err(McapError::BadMagic) => return Err(FramingError::NotMcap),
            // A torn end: everything before it has been read.
            Err(_) => break,
        }
    }
    if loaded < mcap::MAGIC.len() as u64 {
        return Err(FramingError::NotMcap);
    }
    Ok(end)
}

/// The first `wanted` metadata of a file, at any place: other writers may put them behind the
/// messages that they describe. Other records are skipped by their lengths. Broken data ends the
/// search; [`walk`] reports it.
pub(super) fn find_metadata<R: Read + Seek>(
    file: &mut R,
    wanted: impl Fn(&Metadata) -> bool,
) -> Result<Option<Metadata>, FramingError> {
    let file_bytes = file.seek(SeekFrom::End(0))?;
    let mut file = BufReader::new(file);
    let mut at = file.seek(SeekFrom::Start(mcap::MAGIC.len() as u64))?;
    while file_bytes.saturating_sub(at) >= HEAD_BYTES {
        let mut head = [0; HEAD_BYTES as usize];
        file.read_exact(&mut head)?;
        let [opcode, len @ ..] = head;
        let len = u64::from_le_bytes(len);
        at += HEAD_BYTES;
        // The summary, which the footer ends, contains no metadata.
        if opcode == op::FOOTER || len > file_bytes - at {
            break;
        }
        if opcode == op::METADATA && len <= MAX_RECORD_BYTES {
            let mut body = vec![0; len as usize];
            file.read_exact(&mut body)?;
            let Some(metadata) = metadata_of(&body) else {
                break;
            };
            if wanted(&metadata) {
                return Ok(Some(metadata));
            }
        } else {
            // No file is so long that this becomes negative.
            file.seek_relative(len.cast_signed())?;
        }
        at += len;
    }
    Ok(None)
}

fn metadata_of(body: &[u8]) -> Option<Metadata> {
    texts_end_within(op::METADATA, body)?;
    match mcap::parse_record(op::METADATA, body) {
        Ok(Record::Metadata(metadata)) => Some(metadata),
        _ => None,
    }
}

/// Options to read records of a file from its begin, or from `inside` it.
fn file_options(inside: bool) -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_skip_start_magic(inside)
        .with_skip_end_magic(true)
        .with_emit_chunks(true)
        .with_record_length_limit(MAX_CHUNK_BYTES as usize)
}

/// Calls `visit` for a record of the file whose body is at `at`; false for a wrong checksum.
fn record(opcode: u8, body: &[u8], at: u64, visit: &mut Visit<'_>) -> Result<bool, FramingError> {
    if opcode != op::CHUNK {
        let place = RecordPlace { chunk: None, at };
        return show(opcode, body, place, visit);
    }
    let chunk = McapChunk::parse(body, at)?;
    let packed = PackedChunk {
        at,
        len: body.len() as u64,
    };
    let packed = chunk.is_packed.then_some(packed);
    let begin = if chunk.is_packed { 0 } else { at + chunk.head };
    chunk.each_record(&mut |opcode, body, offset| {
        let place = RecordPlace {
            chunk: packed,
            at: begin + offset,
        };
        show(opcode, body, place, visit).map(drop)
    })
}

/// The decompressed records of the compressed chunk `body` at `at`.
pub(super) fn unpack(body: &[u8], at: u64) -> Result<Vec<u8>, FramingError> {
    let mut records = Vec::new();
    let whole = McapChunk::parse(body, at)?.each_record(&mut |opcode, body, _| {
        records.push(opcode);
        records.extend((body.len() as u64).to_le_bytes());
        records.extend(body);
        Ok(())
    })?;
    if whole {
        Ok(records)
    } else {
        Err(damaged(at, "a chunk whose checksum is wrong"))
    }
}

/// A chunk with a checked header.
struct McapChunk<'a> {
    /// Header and records.
    body: &'a [u8],
    /// Its place in the file.
    at: u64,
    /// Bytes before the records.
    head: u64,
    is_packed: bool,
    /// Bytes of the decompressed records, at most [`MAX_CHUNK_BYTES`].
    unpacked_bytes: u64,
}

/// Receives opcode, body and the body's place among the chunk's decompressed records.
type EachRecord<'a> = dyn FnMut(u8, &[u8], u64) -> Result<(), FramingError> + 'a;

impl<'a> McapChunk<'a> {
    fn parse(body: &'a [u8], at: u64) -> Result<Self, FramingError> {
        let broken = damaged(at, "a broken chunk");
        if texts_end_within(op::CHUNK, body).is_none() {
            return Err(broken);
        }
        let Ok(Record::Chunk { header, data }) = mcap::parse_record(op::CHUNK, body) else {
            return Err(broken);
        };
        let is_packed = !header.compression.is_empty();
        let size = header.uncompressed_size;
        if size > MAX_CHUNK_BYTES {
            return Err(damaged(at, "a chunk that unpacks to too much"));
        }
        if !is_packed && size != header.compressed_size {
            return Err(broken);
        }
        let head = (8 + 8 + 8 + 4 + 4 + 8 + header.compression.len()) as u64;
        Ok(Self {
            // Bytes after the records are ignored.
            body: &body[..head as usize + data.len()],
            at,
            head,
            is_packed,
            unpacked_bytes: size,
        })
    }

    /// Calls `show` for every record; false for a wrong checksum, and then for none.
    fn each_record(&self, show: &mut EachRecord<'_>) -> Result<bool, FramingError> {
        let broken = || damaged(self.at, "a broken chunk");
        let mut reader = self.reader().map_err(|_| broken())?;
        let mut seen = 0;
        while seen < self.unpacked_bytes {
            match reader.next_event() {
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    show(opcode, data, seen + HEAD_BYTES)?;
                    seen += HEAD_BYTES + data.len() as u64;
                }
                Some(Err(McapError::BadChunkCrc { .. })) => return Ok(false),
                Some(Err(McapError::UnsupportedCompression(name))) => {
                    return Err(FramingError::Compressed(name.chars().take(16).collect()));
                }
                // It already has all bytes.
                Some(Ok(LinearReadEvent::ReadRequest(_)) | Err(_)) | None => return Err(broken()),
            }
        }
        Ok(true)
    }

    /// A reader that has the chunk's bytes, positioned inside it.
    fn reader(&self) -> Result<LinearReader, McapError> {
        let len = self.body.len() as u64;
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(len.max(self.unpacked_bytes) as usize);
        let mut reader = LinearReader::new_with_options(options);
        for format in [CompressionFormat::Lz4, CompressionFormat::Zstd] {
            reader.add_decompressor(Decompression::new(format, MAX_CHUNK_BYTES))?;
        }
        let bytes = self.body.len() + HEAD_BYTES as usize;
        let room = reader.insert(bytes);
        room[0] = op::CHUNK;
        room[1..HEAD_BYTES as usize].copy_from_slice(&len.to_le_bytes());
        room[HEAD_BYTES as usize..bytes].copy_from_slice(self.body);
        reader.notify_read(bytes);
        Ok(reader)
    }
}

/// Calls `visit` for one record if it is relevant; false for a wrong checksum.
fn show(
    opcode: u8,
    body: &[u8],
    place: RecordPlace,
    visit: &mut Visit<'_>,
) -> Result<bool, FramingError> {
    let wanted = matches!(
        opcode,
        op::HEADER | op::CHANNEL | op::MESSAGE | op::ATTACHMENT | op::METADATA
    );
    if !wanted || body.len() as u64 > MAX_RECORD_BYTES {
        return Ok(true);
    }
    let at = place.chunk.map_or(place.at, |chunk| chunk.at);
    let broken = damaged(at, "a broken record");
    if texts_end_within(opcode, body).is_none() {
        return Err(broken);
    }
    match mcap::parse_record(opcode, body) {
        Ok(record) => visit(record, place),
        Err(McapError::BadAttachmentCrc { .. }) => return Ok(false),
        Err(_) => return Err(broken),
    }
    Ok(true)
}

/// Whether the texts of a record end within it: `mcap` allocates the length of a text before it
/// checks it, and trusts the checksum of an attached file.
fn texts_end_within(opcode: u8, body: &[u8]) -> Option<()> {
    // Bytes before the texts, number of texts, bytes that must follow.
    let (ahead, texts, behind) = match opcode {
        op::HEADER => (0, 2, 0),
        op::CHANNEL => (4, 2, 4),
        op::CHUNK => (28, 1, 8),
        op::ATTACHMENT => (16, 2, 12),
        op::METADATA => (0, 1, 4),
        _ => return Some(()),
    };
    let mut rest = body.get(ahead..)?;
    for _ in 0..texts {
        rest = behind_text(rest)?;
    }
    rest.get(behind..)?;
    if matches!(opcode, op::CHANNEL | op::METADATA) {
        let mut map = &rest[4..rest.len() - behind_text(rest)?.len()];
        while !map.is_empty() {
            map = behind_text(map)?;
        }
    }
    Some(())
}

/// The bytes after a text or a map: both begin with their length.
fn behind_text(bytes: &[u8]) -> Option<&[u8]> {
    let (len, rest) = bytes.split_first_chunk()?;
    rest.get(u32::from_le_bytes(*len) as usize..)
}

fn damaged(at: u64, problem: &'static str) -> FramingError {
    FramingError::Damaged { at, problem }
}
