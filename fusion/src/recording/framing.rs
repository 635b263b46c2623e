//! The records of an MCAP file, front to back, with the place of every message. (mcap.dev/spec: opcode,
//! length, body; numbers little-endian; strings and maps with a 4-byte length ahead.)
//!
//! Lengths are never believed: nothing is allocated beyond what is left of the file, nor beyond a bound.

use std::io::{self, Read, Seek, SeekFrom};

use mcap::MAGIC;
use mcap::records::op;

/// Longest chunk that is read, bytes: ours have 4 MiB and one message.
const MAX_CHUNK_BYTES: u64 = 64 << 20;
/// Longest other record that is read, bytes; what is longer is passed over.
pub(super) const MAX_RECORD_BYTES: u64 = 16 << 20;
/// Opcode and length.
const HEAD_BYTES: u64 = 9;

/// Why a file is not a recording.
#[derive(Debug, thiserror::Error)]
pub enum FramingError {
    /// The system refused.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// It begins otherwise.
    #[error("not an MCAP file: it does not begin with MCAP's magic bytes")]
    NotMcap,
    /// What stands there cannot be.
    #[error("damaged at byte {at}: {problem}")]
    Damaged {
        /// Place in the file.
        at: u64,
        /// What is wrong.
        problem: &'static str,
    },
    /// Chunks are packed.
    #[error(
        "its chunks are compressed ({0}); unpack it first: mcap compress --compression none IN -o OUT"
    )]
    Compressed(String),
}

/// What is met on the way.
#[derive(Debug)]
pub(super) enum Met<'a> {
    /// Who wrote the file.
    Header {
        /// The profile.
        profile: String,
    },
    /// A channel.
    Channel {
        /// Its number.
        id: u16,
        /// Its topic.
        topic: &'a str,
    },
    /// A message.
    Message {
        /// Its channel's number.
        channel: u16,
        /// Where its bytes stand in the file.
        at: u64,
        /// Its bytes.
        data: &'a [u8],
    },
    /// An attached file.
    Attachment {
        /// Its name.
        name: &'a str,
        /// Its bytes.
        data: &'a [u8],
    },
    /// A metadata record.
    Metadata {
        /// Its name.
        name: &'a str,
        /// Its fields.
        fields: Vec<(&'a str, &'a str)>,
    },
}

/// How a file ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileEnd {
    /// Bytes up to which it could be read.
    pub read_bytes: u64,
    /// Bytes that it has.
    pub file_bytes: u64,
    /// Whether its end was written: else whoever wrote it was stopped.
    pub whole: bool,
    /// Chunks whose checksum is wrong; they were passed over.
    pub damaged_chunks: u64,
}

/// Goes through a file and shows `visit` what is there.
pub(super) fn walk<R: Read + Seek>(
    file: &mut R,
    visit: &mut dyn FnMut(Met<'_>),
) -> Result<FileEnd, FramingError> {
    let file_bytes = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(0))?;
    let mut magic = [0; MAGIC.len()];
    if file_bytes < magic.len() as u64 {
        return Err(FramingError::NotMcap);
    }
    file.read_exact(&mut magic)?;
    if magic != *MAGIC {
        return Err(FramingError::NotMcap);
    }
    let mut end = FileEnd {
        read_bytes: magic.len() as u64,
        file_bytes,
        whole: false,
        damaged_chunks: 0,
    };
    let mut body = Vec::new();
    while let Some((opcode, len)) = next_head(file, &end)? {
        let at = end.read_bytes + HEAD_BYTES;
        let is_chunk = opcode == op::CHUNK;
        if is_chunk && len > MAX_CHUNK_BYTES {
            return Err(damaged(at, "a chunk that is too long"));
        }
        let wanted = matches!(
            opcode,
            op::HEADER | op::CHANNEL | op::MESSAGE | op::ATTACHMENT | op::METADATA
        );
        if is_chunk || wanted && len <= MAX_RECORD_BYTES {
            body.resize(len as usize, 0);
            file.read_exact(&mut body)?;
            if is_chunk {
                end.damaged_chunks += u64::from(!chunk(&body, at, visit)?);
            } else {
                visit_record(opcode, &body, at, visit).ok_or(damaged(at, "a broken record"))?;
            }
        } else {
            file.seek(SeekFrom::Start(at + len))?;
        }
        end.read_bytes = at + len;
        if opcode == op::FOOTER {
            end.whole = true;
            break;
        }
    }
    Ok(end)
}

/// The next record's opcode and length; `None` when what is left of the file is not a whole record.
fn next_head<R: Read>(file: &mut R, end: &FileEnd) -> Result<Option<(u8, u64)>, FramingError> {
    let left = end.file_bytes - end.read_bytes;
    if left < HEAD_BYTES {
        return Ok(None);
    }
    let mut head = [0; HEAD_BYTES as usize];
    file.read_exact(&mut head)?;
    let mut fields = Fields(&head[1..]);
    let len = fields.u64().unwrap_or(u64::MAX);
    Ok((len <= left - HEAD_BYTES).then_some((head[0], len)))
}

/// The records of a chunk; false when its checksum is wrong.
fn chunk(body: &[u8], at: u64, visit: &mut dyn FnMut(Met<'_>)) -> Result<bool, FramingError> {
    let broken = || damaged(at, "a broken chunk");
    let mut fields = Fields(body);
    let head = (|| {
        fields.take(16)?;
        let size = fields.u64()?;
        let crc = fields.u32()?;
        let compression = fields.text()?;
        let packed = fields.u64()?;
        Some((size, crc, compression, packed))
    })();
    let (size, crc, compression, packed) = head.ok_or_else(broken)?;
    if !compression.is_empty() {
        return Err(FramingError::Compressed(
            compression.chars().take(16).collect(),
        ));
    }
    let records_at = at + (body.len() - fields.0.len()) as u64;
    let records = usize::try_from(packed).ok().and_then(|n| fields.take(n));
    let records = records
        .filter(|records| records.len() as u64 == size)
        .ok_or_else(broken)?;
    if crc != 0 && crc32fast::hash(records) != crc {
        return Ok(false);
    }
    let mut rest = Fields(records);
    while !rest.0.is_empty() {
        let record = rest.u8().zip(rest.u64());
        let record = record.and_then(|(opcode, len)| {
            let record_at = records_at + (records.len() - rest.0.len()) as u64;
            let body = rest.take(usize::try_from(len).ok()?)?;
            visit_record(opcode, body, record_at, visit)
        });
        record.ok_or_else(broken)?;
    }
    Ok(true)
}

/// Shows one record whose body stands at `at`; `None` when it is broken.
fn visit_record(opcode: u8, body: &[u8], at: u64, visit: &mut dyn FnMut(Met<'_>)) -> Option<()> {
    let mut fields = Fields(body);
    match opcode {
        op::HEADER => visit(Met::Header {
            profile: fields.text()?.to_owned(),
        }),
        op::CHANNEL => {
            let id = fields.u16()?;
            fields.u16()?;
            visit(Met::Channel {
                id,
                topic: fields.text()?,
            });
        }
        op::MESSAGE => {
            let channel = fields.u16()?;
            fields.take(4 + 8 + 8)?;
            let at = at + (body.len() - fields.0.len()) as u64;
            visit(Met::Message {
                channel,
                at,
                data: fields.0,
            });
        }
        op::ATTACHMENT => {
            fields.take(16)?;
            let name = fields.text()?;
            fields.text()?;
            let len = usize::try_from(fields.u64()?).ok()?;
            visit(Met::Attachment {
                name,
                data: fields.take(len)?,
            });
        }
        op::METADATA => {
            let name = fields.text()?;
            let len = fields.u32()? as usize;
            let mut map = Fields(fields.take(len)?);
            let mut found = Vec::new();
            while !map.0.is_empty() {
                found.push((map.text()?, map.text()?));
            }
            visit(Met::Metadata {
                name,
                fields: found,
            });
        }
        _ => {}
    }
    Some(())
}

fn damaged(at: u64, problem: &'static str) -> FramingError {
    FramingError::Damaged { at, problem }
}

/// Reads numbers and texts off the front of bytes.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, n: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Option<&'a str> {
        let len = self.u32()? as usize;
        std::str::from_utf8(self.take(len)?).ok()
    }
}
