//! Maps to bytes.

use super::compression_level::{CompressionLevel, FLOOR};
use super::entropy::range_coder::{BitCoder as _, BitWriter};
use super::entropy::symbol::plain;
use super::gaussian::correction::CorrectionGrid;
use super::gaussian::explain::{Explained, Explainer};
use super::gaussian::mode::{MapScale, Mode};
use super::gaussian::mode_coder;
use super::gaussian::recipe::{NO_CORRECTION, Recipe, Rest, STEPS_DOWN};
use super::lossless::{self, Shape};
use super::maps::{EncodedMaps, Maps};

/// Bits of the compression level at the start of a patch, and of the floor after it in lossless
/// ones.
pub(super) const LEVEL_BITS: u32 = 4;
pub(super) const FLOOR_BITS: u32 = 8;
/// Bits of the index of [`super::gaussian::recipe::STEPS_DOWN`] in patches of modes.
pub(super) const STEP_BITS: u32 = 4;

/// Encodes maps to bytes; reuses its memory from patch to patch.
#[derive(Debug, Clone)]
pub struct Encoder {
    exact: lossless::LosslessCoder,
    /// One map, with cells below the floor cleared.
    cleared: Vec<u8>,
    model: mode_coder::ModeCoder,
    explainer: Explainer,
    /// The modes of each map of the patch.
    explained: Vec<Explained>,
    grid: CorrectionGrid,
    modes: Vec<Mode>,
    /// Whether every patch starts with the priors.
    resets: bool,
}

impl Encoder {
    /// A new encoder.
    pub fn new() -> Self {
        Self {
            exact: lossless::LosslessCoder::new(),
            cleared: Vec::new(),
            model: mode_coder::ModeCoder::new(),
            explainer: Explainer::new(),
            explained: Vec::new(),
            grid: CorrectionGrid::default(),
            modes: Vec::new(),
            resets: true,
        }
    }

    /// Encodes `maps` at `level`.
    ///
    /// Equal maps give equal bytes, whatever was encoded before.
    pub fn encode(&mut self, maps: &Maps, level: CompressionLevel) -> EncodedMaps {
        let mut bytes = Vec::with_capacity(512);
        self.encode_into(maps, level, &mut bytes);
        encoded(maps, bytes)
    }

    /// As [`Self::encode`]: writes the bytes of the maps alone and replaces the content of `bytes`.
    /// Allocates nothing once all buffers have their size.
    pub fn encode_into(&mut self, maps: &Maps, level: CompressionLevel, bytes: &mut Vec<u8>) {
        bytes.clear();
        match Recipe::for_level(level) {
            None => self.exact(maps, FLOOR, bytes),
            Some(recipe) => self.modes(maps, level, &recipe, bytes),
        }
    }

    /// Encodes `maps` losslessly above `floor`; cells below become 0.
    ///
    /// Equal maps give equal bytes, whatever was encoded before. Cost: about 40 ns per nonzero
    /// cell; the rest is negligible.
    pub fn encode_above(&mut self, maps: &Maps, floor: u8) -> EncodedMaps {
        let mut bytes = Vec::new();
        self.exact(maps, floor, &mut bytes);
        encoded(maps, bytes)
    }

    /// Encodes at most `most` Gaussians of each map with the precision of `level` (not lossless),
    /// and nothing else, for comparison with systems that send Gaussians.
    pub fn encode_gaussians(
        &mut self,
        maps: &Maps,
        level: CompressionLevel,
        most: usize,
    ) -> EncodedMaps {
        let mut bytes = Vec::new();
        if let Some(mut recipe) = Recipe::for_level(level) {
            recipe.modes = most.min(recipe.modes);
            recipe.first = NO_CORRECTION;
            recipe.most_bytes = usize::MAX;
            self.modes(maps, level, &recipe, &mut bytes);
        }
        encoded(maps, bytes)
    }

    fn exact(&mut self, maps: &Maps, floor: u8, bytes: &mut Vec<u8>) {
        let floor = floor.max(1);
        let shape = Shape {
            width: maps.width(),
            height: maps.height(),
            floor,
        };
        let mut writer = BitWriter::new(std::mem::take(bytes));
        plain(
            &mut writer,
            LEVEL_BITS,
            CompressionLevel::LOSSLESS.number().into(),
        );
        plain(&mut writer, FLOOR_BITS, floor.into());
        self.exact.reset(shape.width, shape.height);
        for k in 0..maps.keypoints() {
            let cleared = maps.cells(k).iter();
            let cleared = cleared.map(|&cell| if cell < floor { 0 } else { cell });
            self.cleared.clear();
            self.cleared.extend(cleared);
            self.exact.map(&mut writer, shape, &mut self.cleared);
        }
        *bytes = writer.finish();
    }

    fn modes(
        &mut self,
        maps: &Maps,
        level: CompressionLevel,
        recipe: &Recipe,
        bytes: &mut Vec<u8>,
    ) {
        let last = STEPS_DOWN.len() - 1;
        let (mut down, mut explained_from) = (recipe.first, None);
        loop {
            let further = recipe.floor.max(STEPS_DOWN[down].further);
            if explained_from != Some(further) {
                self.explain(maps, recipe, further);
                explained_from = Some(further);
            }
            bytes.clear();
            let mut writer = BitWriter::new(std::mem::take(bytes));
            plain(&mut writer, LEVEL_BITS, level.number().into());
            plain(&mut writer, STEP_BITS, down as u32);
            self.write(&mut writer, maps, recipe, STEPS_DOWN[down]);
            *bytes = writer.finish();
            if bytes.len() <= recipe.most_bytes || down == last {
                return;
            }
            // A step at most halves the bytes.
            down += (bytes.len() / recipe.most_bytes).clamp(1, last - down);
        }
    }

    fn explain(&mut self, maps: &Maps, recipe: &Recipe, further: u8) {
        let scale = MapScale::from_maps(maps);
        let n = maps.keypoints();
        self.explained
            .resize_with(n.max(self.explained.len()), Explained::default);
        for (k, into) in self.explained[..n].iter_mut().enumerate() {
            self.explainer
                .explain(maps.cells(k), recipe, further, &scale, into);
        }
    }

    fn write(&mut self, writer: &mut BitWriter, maps: &Maps, recipe: &Recipe, rest: Rest) {
        let scale = MapScale::from_maps(maps);
        if self.resets {
            self.model.contexts.reset();
        }
        self.model.begin(maps.keypoints(), &scale);
        self.grid.reset(&scale);
        for (k, explained) in self.explained[..maps.keypoints()].iter().enumerate() {
            self.modes.clear();
            self.modes.extend_from_slice(&explained.modes);
            self.model.modes(writer, recipe, &mut self.modes);
            if rest.step == 0 {
                continue;
            }
            let seen = explained.residual(maps.cells(k), recipe.floor);
            let corrected = seen.off.iter().any(|&off| off > rest.tolerance)
                && self.grid.measure(&seen, rest.step, &scale);
            let contexts = &mut self.model.contexts;
            if writer.code(corrected, contexts.corrected(self.modes.len())) {
                self.grid.code(writer, contexts, seen.shown, &scale);
            }
        }
    }

    /// The highest peak of each map, fitted: column and row, cells, and height, of 255. `None` if
    /// no cell is above the floor. For callers that need keypoints only: an edge that follows
    /// people itself, and comparisons.
    pub fn peaks(&mut self, maps: &Maps) -> Vec<Option<([f32; 2], f32)>> {
        let scale = MapScale::from_maps(maps);
        let Some(mut recipe) = Recipe::for_level(CompressionLevel::new(1)) else {
            return Vec::new();
        };
        recipe.modes = 1;
        let mut explained = Explained::default();
        let peak = |k: usize| {
            self.explainer
                .explain(maps.cells(k), &recipe, recipe.floor, &scale, &mut explained);
            let mode = explained.modes.first()?;
            Some((mode.center(&scale), mode.height.into()))
        };
        (0..maps.keypoints()).map(peak).collect()
    }

    /// As [`Self::encode`], but keeps the probabilities learnt from earlier maps, to measure the
    /// priors.
    pub fn encode_on(&mut self, maps: &Maps, level: CompressionLevel) -> EncodedMaps {
        self.resets = false;
        let encoded = self.encode(maps, level);
        self.resets = true;
        encoded
    }

    /// The probabilities (of 65,536) after the last lossy patch, from which the priors are
    /// measured.
    pub fn learnt(&self) -> Vec<u16> {
        self.model.contexts.learnt().collect()
    }
}

fn encoded(maps: &Maps, bytes: Vec<u8>) -> EncodedMaps {
    EncodedMaps {
        width: maps.width() as u16,
        height: maps.height() as u16,
        keypoints: maps.keypoints() as u8,
        bytes,
    }
}

impl Default for Encoder {
    fn default() -> Self {
        Self::new()
    }
}
