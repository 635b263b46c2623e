//! Bytes to maps.

use super::range_coder::Reader;
use super::walk::{Model, Shape};
use super::{EncodedMaps, Maps, PatchError};

/// Turns bytes back into maps; keeps its memory from patch to patch.
#[derive(Debug, Clone)]
pub struct Decoder {
    model: Model,
}

impl Decoder {
    /// A new decoder.
    pub fn new() -> Self {
        Self {
            model: Model::new(),
        }
    }

    /// Decodes `encoded` into `into`, whose memory is used again. Allocates at most
    /// [`super::MAX_CELLS`] bytes, whatever the bytes say.
    ///
    /// # Errors
    /// [`PatchError`] when the size is impossible or the bytes do not fit it; `into` then holds
    /// nothing of use.
    pub fn decode(&mut self, encoded: &EncodedMaps, into: &mut Maps) -> Result<(), PatchError> {
        encoded.check_size()?;
        into.resize(
            encoded.width.into(),
            encoded.height.into(),
            encoded.keypoints.into(),
        );
        let mut reader = Reader::new(&encoded.bytes);
        self.model.reset(into.width(), into.height());
        let floor = self.model.floor(&mut reader, 0);
        let shape = Shape {
            width: into.width(),
            height: into.height(),
            floor,
        };
        for keypoint in 0..into.keypoints() {
            self.model.map(&mut reader, shape, into.cells_mut(keypoint));
            if reader.is_past_end() {
                return Err(PatchError::TooShort { keypoint });
            }
        }
        match reader.left() {
            0 => Ok(()),
            left => Err(PatchError::TooLong { left }),
        }
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}
