//! Bytes to maps.

use super::compression_level::CompressionLevel;
use super::encode::{FLOOR_BITS, LEVEL_BITS, STEP_BITS};
use super::entropy::range_coder::{BitCoder as _, BitReader};
use super::entropy::symbol::plain;
use super::gaussian::correction::CorrectionGrid;
use super::gaussian::mode::{MapScale, Mode};
use super::gaussian::mode_coder;
use super::gaussian::recipe::{Recipe, STEPS_DOWN};
use super::lossless::{self, Shape};
use super::maps::{EncodedMaps, Maps, PatchError};

/// Decodes bytes to maps; reuses its memory from patch to patch.
#[derive(Debug, Clone)]
pub struct Decoder {
    exact: lossless::LosslessCoder,
    model: mode_coder::ModeCoder,
    grid: CorrectionGrid,
    modes: Vec<Mode>,
}

impl Decoder {
    /// A new decoder.
    pub fn new() -> Self {
        Self {
            exact: lossless::LosslessCoder::new(),
            model: mode_coder::ModeCoder::new(),
            grid: CorrectionGrid::default(),
            modes: Vec::new(),
        }
    }

    /// Decodes `encoded` into `into`, whose memory is reused. For any bytes it allocates at most
    /// [`super::MAX_CELLS`] bytes, and two for each cell of one map.
    ///
    /// # Errors
    /// [`PatchError`] when the size is impossible or the bytes do not match it; `into` then has
    /// undefined content.
    pub fn decode(&mut self, encoded: &EncodedMaps, into: &mut Maps) -> Result<(), PatchError> {
        encoded.check_size()?;
        into.resize(
            encoded.width.into(),
            encoded.height.into(),
            encoded.keypoints.into(),
        );
        let mut reader = BitReader::new(&encoded.bytes);
        let level = plain(&mut reader, LEVEL_BITS, 0) as u8;
        match Recipe::for_level(CompressionLevel::new(level)) {
            None => self.exact(&mut reader, into),
            Some(recipe) => self.modes(&mut reader, &recipe, into),
        }?;
        match reader.left() {
            0 => Ok(()),
            left => Err(PatchError::TooLong { left }),
        }
    }

    fn exact(&mut self, reader: &mut BitReader<'_>, into: &mut Maps) -> Result<(), PatchError> {
        let floor = plain(reader, FLOOR_BITS, 0) as u8;
        let shape = Shape {
            width: into.width(),
            height: into.height(),
            floor: floor.max(1),
        };
        self.exact.reset(shape.width, shape.height);
        for keypoint in 0..into.keypoints() {
            let (cells, written) = into.cells_and_written(keypoint);
            *written = self.exact.map(reader, shape, cells);
            within(reader, keypoint)?;
        }
        Ok(())
    }

    fn modes(
        &mut self,
        reader: &mut BitReader<'_>,
        recipe: &Recipe,
        into: &mut Maps,
    ) -> Result<(), PatchError> {
        let scale = MapScale::from_maps(into);
        let rest = STEPS_DOWN[plain(reader, STEP_BITS, 0) as usize % STEPS_DOWN.len()];
        self.model.contexts.reset();
        self.model.begin(into.keypoints(), &scale);
        self.grid.reset(&scale);
        for keypoint in 0..into.keypoints() {
            self.modes.clear();
            self.model.modes(reader, recipe, &mut self.modes);
            let (cells, written) = into.cells_and_written(keypoint);
            for mode in &self.modes {
                mode.draw(&scale, cells);
                written.include(mode.rows(&scale), mode.columns(&scale));
            }
            let contexts = &mut self.model.contexts;
            if rest.step > 0 && reader.code(false, contexts.corrected(self.modes.len())) {
                self.grid.code(reader, contexts, cells, &scale);
                let [columns, rows] = self.grid.apply(cells, rest.step, &scale);
                written.include(rows, columns);
            }
            within(reader, keypoint)?;
        }
        Ok(())
    }
}

/// Refuses to read past the end of the bytes.
fn within(reader: &BitReader<'_>, keypoint: usize) -> Result<(), PatchError> {
    if reader.is_past_end() {
        Err(PatchError::TooShort { keypoint })
    } else {
        Ok(())
    }
}

impl Default for Decoder {
    fn default() -> Self {
        Self::new()
    }
}
