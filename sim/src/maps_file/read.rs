//! Reads a file of maps and checks all of it.

use std::ops::Range;
use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use farfield_proto::message::MAX_CAPTURE_OFFSET_US;
use serde::de::DeserializeOwned;

use super::{CHECKSUM_BYTES, Header, MAGIC};
use crate::faults::{MapObservation, StoredMapObservation};

/// Largest accepted file, bytes.
pub(super) const MAX_FILE_BYTES: u64 = 1 << 30;
/// Longest accepted name of a camera, bytes.
const MAX_NAME_BYTES: usize = 256;

/// Why bytes are not a valid file of maps.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MapsFileError {
    /// Another kind of file.
    #[error("is not a file of maps: it does not begin as one")]
    OtherFile,
    /// A file of another version.
    #[error("is a file of maps of version {got}, expected {}", MAGIC[MAGIC.len() - 1])]
    Version {
        /// The version in the file.
        got: u8,
    },
    /// The file ends too early.
    #[error("was cut: it ends in {place}")]
    Cut {
        /// The part that is cut.
        place: String,
    },
    /// A part of the file cannot be read.
    #[error("{place}: {problem}")]
    Damaged {
        /// The damaged part.
        place: String,
        /// What is wrong with it.
        problem: String,
    },
    /// Extra bytes after the end.
    #[error("has {0} bytes after its end")]
    LeftOver(usize),
    /// The checksum does not match.
    #[error("was changed after it was written: its checksum does not fit")]
    Checksum,
}

/// The maps of one camera; every tick is readable.
#[derive(Debug, Clone)]
pub struct MapsFile {
    header: Header,
    bytes: Vec<u8>,
    /// The ranges of the ticks' observations in `bytes`.
    ticks: Vec<Range<usize>>,
}

impl MapsFile {
    /// Checks `bytes`: framing, checksum, and that every tick holds an observation. Memory: the
    /// bytes, and 16 more per tick.
    ///
    /// # Errors
    /// [`MapsFileError`] when anything is wrong.
    pub fn parse(bytes: Vec<u8>) -> Result<Self, MapsFileError> {
        let (version, magic) = (MAGIC[MAGIC.len() - 1], &MAGIC[..MAGIC.len() - 1]);
        match bytes.get(..MAGIC.len()) {
            Some(found) if found.starts_with(magic) => {
                let got = found[MAGIC.len() - 1];
                if got != version {
                    return Err(MapsFileError::Version { got });
                }
            }
            _ => return Err(MapsFileError::OtherFile),
        }
        let mut at = MAGIC.len();
        let range = record(&bytes, &mut at, "its header")?;
        let header: Header = read(&bytes[range], "its header")?;
        check_header(&header)?;
        let mut ticks = Vec::new();
        for tick in 0..header.ticks {
            let place = format!("tick {tick} of {}", header.ticks);
            let range = record(&bytes, &mut at, &place)?;
            let stored: StoredMapObservation = read(&bytes[range.clone()], &place)?;
            stored.check().map_err(|problem| damaged(&place, problem))?;
            ticks.push(range);
        }
        let checksum = take(&bytes, &mut at, CHECKSUM_BYTES, "its checksum")?;
        if at < bytes.len() {
            return Err(MapsFileError::LeftOver(bytes.len() - at));
        }
        if blake3::hash(&bytes[..checksum.start]).as_bytes()[..] != bytes[checksum] {
            return Err(MapsFileError::Checksum);
        }
        Ok(Self {
            header,
            bytes,
            ticks,
        })
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The observation of `camera` at the `tick`-th tick of the recording or of a repetition.
    /// `None` after the end of a recording that does not repeat.
    ///
    /// # Errors
    /// [`MapsFileError::Damaged`] when the tick holds an impossible observation.
    pub fn observation(
        &self,
        tick: u64,
        camera: &Arc<CameraModel>,
    ) -> Result<Option<MapObservation>, MapsFileError> {
        let n = self.ticks.len() as u64;
        let tick = if self.header.repeats { tick % n } else { tick };
        let Some(range) = usize::try_from(tick).ok().and_then(|i| self.ticks.get(i)) else {
            return Ok(None);
        };
        let place = format!("tick {tick} of {n}");
        let stored: StoredMapObservation = read(&self.bytes[range.clone()], &place)?;
        let restored = stored.restore(camera, self.header.capture_offset_us);
        restored
            .map(Some)
            .map_err(|problem| damaged(&place, problem))
    }
}

fn damaged(place: &str, problem: &str) -> MapsFileError {
    MapsFileError::Damaged {
        place: place.to_owned(),
        problem: problem.to_owned(),
    }
}

fn check_header(header: &Header) -> Result<(), MapsFileError> {
    let Header {
        camera,
        rate_hz,
        ticks,
        capture_offset_us,
        ..
    } = header;
    let problem = if camera.len() > MAX_NAME_BYTES {
        format!("a camera's name of {} bytes", camera.len())
    } else if !(1.0..=1000.0).contains(rate_hz) {
        format!("found {rate_hz:?} ticks per second, expected 1 to 1000")
    } else if capture_offset_us.unsigned_abs() > MAX_CAPTURE_OFFSET_US.unsigned_abs() {
        format!("captures {capture_offset_us} us from their ticks")
    } else if *ticks == 0 {
        "it has no tick".to_owned()
    } else {
        return Ok(());
    };
    Err(MapsFileError::Damaged {
        place: "its header".to_owned(),
        problem,
    })
}

fn take(
    bytes: &[u8],
    at: &mut usize,
    n: usize,
    place: &str,
) -> Result<Range<usize>, MapsFileError> {
    let end = at.checked_add(n).filter(|&end| end <= bytes.len());
    let end = end.ok_or_else(|| MapsFileError::Cut {
        place: place.to_owned(),
    })?;
    let range = *at..end;
    *at = end;
    Ok(range)
}

/// The next record, by its length.
fn record(bytes: &[u8], at: &mut usize, place: &str) -> Result<Range<usize>, MapsFileError> {
    let length = take(bytes, at, 4, place)?;
    let length = bytes[length]
        .iter()
        .rev()
        .fold(0, |n, &b| n << 8 | usize::from(b));
    take(bytes, at, length, place)
}

/// A record without trailing bytes.
fn read<T: DeserializeOwned>(bytes: &[u8], place: &str) -> Result<T, MapsFileError> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Ok(value),
        Ok((_, rest)) => Err(damaged(
            place,
            &format!("{} bytes are left over", rest.len()),
        )),
        Err(error) => Err(damaged(place, &error.to_string())),
    }
}
