//! Maps to bytes.

use super::correction::Grid;
use super::explain::Explainer;
use super::mode::{Mode, Scale};
use super::modes;
use super::range_coder::{BitCoder as _, Writer};
use super::recipe::Recipe;
use super::symbol::plain;
use super::walk::{self, Shape};
use super::{EncodedMaps, FLOOR, Maps, Quality};

/// Bits of the quality at the head of a patch, and of the floor after that of lossless ones.
pub(super) const QUALITY_BITS: u32 = 4;
pub(super) const FLOOR_BITS: u32 = 8;

/// Turns maps into bytes; keeps its memory from patch to patch.
#[derive(Debug, Clone)]
pub struct Encoder {
    exact: walk::Model,
    /// One map, cells below the floor cleared.
    kept: Vec<u8>,
    model: modes::Model,
    explainer: Explainer,
    grid: Grid,
    modes: Vec<Mode>,
}

impl Encoder {
    /// A new encoder.
    pub fn new() -> Self {
        Self {
            exact: walk::Model::new(),
            kept: Vec::new(),
            model: modes::Model::new(),
            explainer: Explainer::new(),
            grid: Grid::default(),
            modes: Vec::new(),
        }
    }

    /// Encodes `maps` as closely as `quality` says.
    ///
    /// Equal maps give equal bytes, whatever was encoded before.
    pub fn encode(&mut self, maps: &Maps, quality: Quality) -> EncodedMaps {
        let mut bytes = Vec::with_capacity(512);
        self.encode_into(maps, quality, &mut bytes);
        encoded(maps, bytes)
    }

    /// As [`Self::encode`]: the bytes of the maps alone, in the place of what is in `bytes`. Allocates
    /// nothing once everything has its size.
    pub fn encode_into(&mut self, maps: &Maps, quality: Quality, bytes: &mut Vec<u8>) {
        bytes.clear();
        match Recipe::of(quality) {
            None => self.exact(maps, FLOOR, bytes),
            Some(recipe) => self.modes(maps, quality, &recipe, bytes),
        }
    }

    /// Encodes `maps`; cells below `floor` become 0, all others are kept exactly.
    ///
    /// Equal maps give equal bytes, whatever was encoded before. Cost: about 40 ns per cell that is
    /// not zero, the rest is hardly seen.
    pub fn encode_above(&mut self, maps: &Maps, floor: u8) -> EncodedMaps {
        let mut bytes = Vec::new();
        self.exact(maps, floor, &mut bytes);
        encoded(maps, bytes)
    }

    /// Encodes at most `most` Gaussians of each map as finely as `quality` (not without loss) writes
    /// them, and nothing else: what peers send, for comparisons.
    pub fn encode_gaussians(&mut self, maps: &Maps, quality: Quality, most: usize) -> EncodedMaps {
        let mut bytes = Vec::new();
        if let Some(mut recipe) = Recipe::of(quality) {
            recipe.modes = most.min(recipe.modes);
            recipe.correction.tolerance = u8::MAX;
            self.modes(maps, quality, &recipe, &mut bytes);
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
        let mut writer = Writer::new(std::mem::take(bytes));
        plain(&mut writer, QUALITY_BITS, Quality::LOSSLESS.level().into());
        plain(&mut writer, FLOOR_BITS, floor.into());
        self.exact.reset(shape.width, shape.height);
        for k in 0..maps.keypoints() {
            let kept = maps.cells(k).iter();
            let kept = kept.map(|&cell| if cell < floor { 0 } else { cell });
            self.kept.clear();
            self.kept.extend(kept);
            self.exact.map(&mut writer, shape, &mut self.kept);
        }
        *bytes = writer.finish();
    }

    fn modes(&mut self, maps: &Maps, quality: Quality, recipe: &Recipe, bytes: &mut Vec<u8>) {
        let scale = Scale::of(maps);
        let mut writer = Writer::new(std::mem::take(bytes));
        plain(&mut writer, QUALITY_BITS, quality.level().into());
        self.model.reset(maps.keypoints(), &scale);
        for k in 0..maps.keypoints() {
            let cells = maps.cells(k);
            self.explainer.explain(cells, recipe, &scale);
            self.modes.clear();
            self.modes.extend_from_slice(self.explainer.modes());
            self.model.modes(&mut writer, recipe, &mut self.modes);
            let correction = &recipe.correction;
            let off = self.explainer.off(cells, recipe.floor);
            let shown = self.explainer.shown();
            let corrected = off > correction.tolerance && {
                self.grid.reset(&scale, correction);
                let step = correction.step;
                self.grid.measure(cells, shown, recipe.floor, step, &scale)
            };
            let contexts = &mut self.model.contexts;
            if writer.code(corrected, contexts.corrected(self.modes.len())) {
                self.grid.code(&mut writer, contexts, shown, &scale);
            }
        }
        *bytes = writer.finish();
    }

    /// The probabilities after the last patch that was not without loss: what those known beforehand
    /// are measured by.
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
