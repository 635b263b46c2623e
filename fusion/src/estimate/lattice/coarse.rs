//! The coarse pass: the whole lattice at steps of about two cells, and its local maxima.
//!
//! This takes most of the time. So samples are those of the nearest cell, and the projection of a
//! row of the lattice is three multiply-adds and one division per point, in f32. The error is far
//! below a tenth of a cell, the step twenty times that.

use farfield_proto::venue::parameters::LatticeParameters;
use nalgebra::Vector3;

use super::witness::{Witness, Witnesses};
use super::{LatticeMode, LatticeModes, ModeOrigin};
use crate::estimate::evidence::View;

/// Most steps from the centre to a side; a larger lattice has wider steps.
const MAX_STEPS: usize = 12;
/// Points of the longest row.
const MAX_ROW: usize = 2 * MAX_STEPS + 1;
/// Share of the best score below which a local maximum is dropped.
const LEAST_OF_BEST: f32 = 0.3;
/// 2^23: adding it to a smaller nonnegative f32 leaves the nearest integer in the low bits.
const TO_INTEGER: f32 = 8_388_608.0;

/// Buffers and result of a coarse pass.
#[derive(Debug, Clone, Default)]
pub(super) struct CoarsePass {
    /// F per point, x fastest.
    scores: Vec<f32>,
    /// One map, row by row.
    map: Vec<u8>,
    modes: LatticeModes,
}

impl CoarsePass {
    /// The local maxima of the last run.
    pub(super) fn modes(&self) -> &LatticeModes {
        &self.modes
    }

    /// Scores the lattice of one keypoint.
    pub(super) fn run(
        &mut self,
        views: &[View],
        keypoint: usize,
        witnesses: &Witnesses,
        parameters: &LatticeParameters,
    ) {
        let wanted =
            (parameters.half_width_m / (parameters.coarse_step_cells * witnesses.cell_m)).ceil();
        // NaN and values below 1 become 1.
        let k = (wanted as usize).clamp(1, MAX_STEPS);
        let step_m = parameters.half_width_m / k as f64;
        let n = 2 * k + 1;
        self.scores.clear();
        self.scores.resize(n * n * n, 0.0);
        for witness in witnesses.iter() {
            self.add(witness, &views[witness.view], keypoint, k, step_m);
        }
        self.weigh(k, step_m / parameters.prior_sigma_m);
        self.find_modes(k, step_m);
    }

    /// Adds the weighted map of one view to every point.
    fn add(&mut self, witness: &Witness, view: &View, keypoint: usize, k: usize, step_m: f64) {
        let n = 2 * k + 1;
        let (width, height) = view.map_size();
        view.map(keypoint).write_unpacked(&mut self.map);
        let limits = ((width - 1) as f32, (height - 1) as f32);
        let weight = (witness.weight / 255.0) as f32;
        let m = &witness.cell_from_offset;
        let [x, y, z]: [Vector3<f64>; 3] = [0, 1, 2].map(|i| m.column(i) * step_m);
        let corner = m.column(3) - (x + y + z) * k as f64;
        let along = x.map(|v| v as f32);
        let mut at = [0u32; MAX_ROW];
        for (row, scores) in self.scores.chunks_exact_mut(n).enumerate() {
            let start = (corner + y * (row % n) as f64 + z * (row / n) as f64).map(|v| v as f32);
            for (i, at) in at[..n].iter_mut().enumerate() {
                let i = i as f32;
                let inverse = 1.0 / (start.z + i * along.z);
                let u = ((start.x + i * along.x) * inverse).max(0.0).min(limits.0);
                let v = ((start.y + i * along.y) * inverse).max(0.0).min(limits.1);
                let column = (u + TO_INTEGER).to_bits() & 0xffff;
                let line = (v + TO_INTEGER).to_bits() & 0xffff;
                *at = line * width as u32 + column;
            }
            for (score, &at) in scores.iter_mut().zip(&at) {
                *score += weight * f32::from(self.map[at as usize]);
            }
        }
    }

    /// Multiplies by the Gaussian around the prediction; `step` is in its sigmas.
    fn weigh(&mut self, k: usize, step: f64) {
        let n = 2 * k + 1;
        let mut gauss = [0.0f32; MAX_ROW];
        for (i, g) in gauss[..n].iter_mut().enumerate() {
            let x = (i as f64 - k as f64) * step;
            *g = libm::exp(-0.5 * x * x) as f32;
        }
        for (row, scores) in self.scores.chunks_exact_mut(n).enumerate() {
            let across = gauss[row % n] * gauss[row / n];
            for (score, g) in scores.iter_mut().zip(&gauss) {
                *score *= across * g;
            }
        }
    }

    /// Collects the points that no neighbour exceeds.
    fn find_modes(&mut self, k: usize, step_m: f64) {
        self.modes = LatticeModes::default();
        let best = self.scores.iter().copied().fold(0.0, f32::max);
        if best <= 0.0 {
            return;
        }
        let n = 2 * k + 1;
        for (index, &score) in self.scores.iter().enumerate() {
            if score < LEAST_OF_BEST * best || !self.is_highest_around(index, n) {
                continue;
            }
            let place = [index % n, index / n % n, index / (n * n)];
            let offset_m = Vector3::from(place.map(|i| (i as f64 - k as f64) * step_m));
            self.modes.insert(LatticeMode::new(
                offset_m,
                f64::from(score),
                ModeOrigin::Ascent,
            ));
        }
    }

    /// Whether none of the 26 neighbours is higher; of a plateau, its first point counts.
    fn is_highest_around(&self, index: usize, n: usize) -> bool {
        let [x, y, z] = [index % n, index / n % n, index / (n * n)];
        let around = |i: usize| i.saturating_sub(1)..=(i + 1).min(n - 1);
        let mut neighbours = around(z)
            .flat_map(|z| around(y).map(move |y| (y, z)))
            .flat_map(|(y, z)| around(x).map(move |x| (z * n + y) * n + x));
        neighbours.all(|other| {
            let (mine, theirs) = (self.scores[index], self.scores[other]);
            theirs < mine || (theirs <= mine && other >= index)
        })
    }
}
