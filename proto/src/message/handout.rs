//! Handout: how fusion sends the venue's files to its edges. A list of the files, signed if there
//! are keys, and their bytes in chunks.

use serde::{Deserialize, Serialize};

use crate::wire::Message;

/// Bytes of a file in one answer: small enough that the patches of a tick do not wait behind it.
pub const CHUNK_BYTES: u64 = 64 * 1024;
/// Most files of a list.
pub const MAX_FILES: usize = 16;
/// Longest path in a list, bytes.
pub const MAX_PATH_BYTES: usize = 1024;
/// Most bytes of a list, of a certificate and of a signature.
const MAX_LIST_BYTES: usize = 64 * 1024;
/// Prefix of the signed bytes (domain separation): a signature of other data is not valid for a
/// list.
pub const SIGNED_AHEAD: &[u8] = b"farfield handout 1\0";

/// Edge to fusion, as the payload of a query.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub enum HandoutRequest {
    /// The list of files. Answered with a [`SignedList`].
    List,
    /// Bytes of a file, from an offset, at most [`CHUNK_BYTES`]. Answered with a [`Chunk`].
    Chunk {
        /// Index of the file in the list.
        file: u16,
        /// The first byte.
        from: u64,
    },
}

/// The kind of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum FileKind {
    /// The venue file.
    Venue,
    /// The calibration.
    Calibration,
    /// The keypoint network's card.
    NetworkCard,
    /// The keypoint network.
    Network,
    /// The detector's card.
    DetectorCard,
    /// The detector.
    Detector,
}

impl FileKind {
    /// Its name in messages to the operator.
    pub fn name(self) -> &'static str {
        match self {
            Self::Venue => "venue file",
            Self::Calibration => "calibration",
            Self::NetworkCard => "keypoint network's card",
            Self::Network => "keypoint network",
            Self::DetectorCard => "detector's card",
            Self::Detector => "detector",
        }
    }
}

/// The files of a venue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileList {
    /// The venue's name.
    pub venue: String,
    /// The files; exactly one is the venue file.
    pub files: Vec<SharedFile>,
}

/// One file of a venue.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SharedFile {
    /// Its kind.
    pub kind: FileKind,
    /// Its path relative to the folder of the venue file; empty for the venue file itself.
    pub path: String,
    /// Its length, bytes.
    pub bytes: u64,
    /// Its BLAKE3 hash.
    pub blake3: [u8; 32],
}

/// A [`FileList`] with fusion's signature.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SignedList {
    /// The list, as [`crate::wire::encode_for_anyone`] writes it.
    pub list: Vec<u8>,
    /// `None` in a venue without keys.
    pub signature: Option<ListSignature>,
}

/// Fusion's signature.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct ListSignature {
    /// Fusion's certificate, DER.
    pub certificate: Vec<u8>,
    /// ECDSA (P-256, SHA-256, ASN.1) over [`SIGNED_AHEAD`] and the list.
    pub ecdsa: Vec<u8>,
}

/// A part of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Chunk {
    /// Its bytes; empty at the end of the file.
    pub bytes: Vec<u8>,
}

impl Message for HandoutRequest {
    fn check(&self) -> Result<(), &'static str> {
        match self {
            Self::Chunk { file, .. } if usize::from(*file) >= MAX_FILES => {
                Err("a file index beyond any list")
            }
            _ => Ok(()),
        }
    }
}

impl Message for FileList {
    fn check(&self) -> Result<(), &'static str> {
        if self.files.len() > MAX_FILES {
            return Err("more files than a list may have");
        }
        if self.files.iter().any(|f| f.path.len() > MAX_PATH_BYTES) {
            return Err("a path is too long");
        }
        let venues = self.files.iter().filter(|f| f.kind == FileKind::Venue);
        if venues.count() != 1 {
            return Err("not exactly one venue file");
        }
        Ok(())
    }
}

impl Message for SignedList {
    fn check(&self) -> Result<(), &'static str> {
        let signature = self.signature.as_ref();
        let fits = |bytes: &[u8]| bytes.len() <= MAX_LIST_BYTES;
        if fits(&self.list) && signature.is_none_or(|s| fits(&s.certificate) && fits(&s.ecdsa)) {
            return Ok(());
        }
        Err("a part of the list is too long")
    }
}

impl Message for Chunk {
    fn check(&self) -> Result<(), &'static str> {
        if self.bytes.len() as u64 > CHUNK_BYTES {
            return Err("more bytes than a chunk may have");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire;

    fn file(kind: FileKind) -> SharedFile {
        SharedFile {
            kind,
            path: String::new(),
            bytes: 7,
            blake3: [3; 32],
        }
    }

    #[test]
    fn a_list_has_exactly_one_venue_file() {
        let mut list = FileList {
            venue: "hall".to_owned(),
            files: vec![file(FileKind::Venue), file(FileKind::Calibration)],
        };
        assert_eq!(wire::decode(&wire::encode(&list)), Ok(list.clone()));
        list.files[1].kind = FileKind::Venue;
        assert!(wire::decode::<FileList>(&wire::encode(&list)).is_err());
    }

    #[test]
    fn oversized_answers_are_refused() {
        let chunk = |n: u64| Chunk {
            bytes: vec![0; n as usize],
        };
        assert!(wire::decode::<Chunk>(&wire::encode(&chunk(CHUNK_BYTES))).is_ok());
        assert!(wire::decode::<Chunk>(&wire::encode(&chunk(CHUNK_BYTES + 1))).is_err());
        let request = HandoutRequest::Chunk { file: 99, from: 0 };
        assert!(wire::decode::<HandoutRequest>(&wire::encode(&request)).is_err());
    }
}
