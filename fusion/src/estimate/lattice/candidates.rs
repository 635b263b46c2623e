//! Candidates for a keypoint: the places where the lines of sight of the maps' peaks meet.
//!
//! A peak of view j is a line of sight: it is at the cell `p_j`, and near the prediction an offset
//! d is at the cell `c_j + J_j d`. The offset on which several lines and the Gaussian around the
//! prediction agree best solves
//!
//! ```text
//!   (sum_j w_j J_j' J_j / s^2 + sum_j w_j I / sigma^2) d = sum_j w_j J_j' (p_j - c_j) / s^2,    w_j = a_j h_j
//! ```
//!
//! with `h_j` the height of the peak and s its sigma: the maximum of F if every map is one
//! Gaussian. Two lines that pass each other closely make a candidate. A line that meets no other
//! makes one alone, next to the prediction. Then each candidate is refined with all lines that pass
//! it, and F selects the best.

use nalgebra::{Vector2, Vector3};

use super::witness::{Witness, Witnesses};
use super::{KeypointPlace, LatticeMode, LatticeModes, ModeOrigin};
use crate::estimate::evidence::{MapPeak, View};

/// Most lines of sight that are paired, the heaviest: pairs are the cost of many views.
const MAX_LINES: usize = 12;
/// Most candidates.
const MAX_CANDIDATES: usize = 16;
const _: () = assert!(MAX_CANDIDATES <= u32::BITS as usize);
/// Two lines meet if both pass within this of a place, in sigmas of a peak.
const MEETING_SIGMAS: f64 = 2.5;
/// A line that passes a candidate within this, in sigmas of a peak, may come from there.
const THERE_SIGMAS: f64 = 1.0;
/// A candidate uses the lines that pass within this, in sigmas of a peak, with less weight farther
/// away.
const TAKEN_SIGMAS: f64 = 3.0;
/// Candidates closer than this are one, in cells of the finest view: they lead to one peak of S.
pub(super) const ONE_PLACE_CELLS: f64 = 2.0;
/// Share of the best score below which a candidate is dropped.
const LEAST_OF_BEST: f64 = 0.3;

/// The line of sight of one peak, near the prediction.
#[derive(Debug, Clone, Copy)]
struct Sightline {
    /// Index of its witness.
    witness: usize,
    /// `w_j`.
    weight: f64,
    /// Cells per metre along columns and rows, over the sigma of a peak.
    slopes: [Vector3<f64>; 2],
    /// `c_j - p_j`, over the sigma of a peak.
    off: Vector2<f64>,
    information: Symmetric,
    pull: Vector3<f64>,
    is_met: bool,
    /// One bit per candidate that it passes closely.
    explained: u32,
}

/// The sum of the information of some lines.
#[derive(Debug, Clone, Copy, Default)]
struct Meeting {
    weight: f64,
    information: Symmetric,
    pull: Vector3<f64>,
}

/// The candidates of one keypoint, with their buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct Candidates {
    lines: Vec<Sightline>,
    places_m: Vec<Vector3<f64>>,
}

impl Candidates {
    /// Fills `modes` with the best candidates.
    pub(super) fn find(
        &mut self,
        at: &KeypointPlace<'_>,
        witnesses: &Witnesses,
        modes: &mut LatticeModes,
    ) {
        self.gather(at, witnesses);
        self.meet(at, ONE_PLACE_CELLS * witnesses.cell_m);
        for &place_m in &self.places_m {
            let offset_m = self.drawn_together(place_m, at);
            let score = witnesses.score(at, offset_m);
            if score > 0.0 {
                insert(
                    modes,
                    LatticeMode::new(offset_m, score, ModeOrigin::Meeting),
                    witnesses.cell_m,
                );
            }
        }
        let least = modes.as_slice().first().map_or(0.0, |m| m.score) * LEAST_OF_BEST;
        modes.n = modes.as_slice().iter().filter(|m| m.score >= least).count();
    }

    /// Gathers the lines of sight, the heaviest first.
    fn gather(&mut self, at: &KeypointPlace<'_>, witnesses: &Witnesses) {
        self.lines.clear();
        for (index, witness) in witnesses.iter().enumerate() {
            let view = &at.views[witness.view];
            for peak in view.peaks(at.keypoint).as_slice() {
                let line = Sightline::new(peak, index, witness, view);
                if line.weight > 0.0 {
                    let own = &self.lines;
                    let place = own.iter().position(|l| line.weight > l.weight);
                    let place = place.unwrap_or(own.len());
                    if place < MAX_LINES {
                        self.lines.truncate(MAX_LINES - 1);
                        self.lines.insert(place, line);
                    }
                }
            }
        }
    }

    /// Finds the places where lines meet, and those of lines that meet no other.
    fn meet(&mut self, at: &KeypointPlace<'_>, one_place_m: f64) {
        self.places_m.clear();
        for b in 1..self.lines.len() {
            for a in 0..b {
                let [one, other] = [self.lines[a], self.lines[b]];
                // With many views, most pairs meet where others have already met.
                let is_known = one.explained & other.explained != 0;
                if one.witness == other.witness || is_known {
                    continue;
                }
                let mut both = Meeting::default();
                both.add(&one, 1.0);
                both.add(&other, 1.0);
                let place_m = both.place_m(at);
                let passes = |line: &Sightline| {
                    line.passes(&place_m).norm_squared() < MEETING_SIGMAS * MEETING_SIGMAS
                };
                if passes(&one) && passes(&other) {
                    self.lines[a].is_met = true;
                    self.lines[b].is_met = true;
                    self.add(place_m, one_place_m);
                }
            }
        }
        for index in 0..self.lines.len() {
            if !self.lines[index].is_met {
                let mut alone = Meeting::default();
                alone.add(&self.lines[index], 1.0);
                self.add(alone.place_m(at), one_place_m);
            }
        }
    }

    fn add(&mut self, place_m: Vector3<f64>, one_place_m: f64) {
        let one2 = one_place_m * one_place_m;
        let mut known = self.places_m.iter();
        if self.places_m.len() < MAX_CANDIDATES
            && known.all(|known| (known - place_m).norm_squared() >= one2)
        {
            let place = self.places_m.len();
            self.places_m.push(place_m);
            for line in &mut self.lines {
                let is_there = line.passes(&place_m).norm_squared() < THERE_SIGMAS * THERE_SIGMAS;
                line.is_met |= is_there;
                line.explained |= u32::from(is_there) << place;
            }
        }
    }

    /// The place on which all lines that pass `place_m` agree.
    fn drawn_together(&self, place_m: Vector3<f64>, at: &KeypointPlace<'_>) -> Vector3<f64> {
        let mut near = Meeting::default();
        for line in &self.lines {
            let inside = 1.0 - line.passes(&place_m).norm_squared() / (TAKEN_SIGMAS * TAKEN_SIGMAS);
            if inside > 0.0 {
                near.add(line, inside * inside);
            }
        }
        if near.weight > 0.0 {
            near.place_m(at)
        } else {
            place_m
        }
    }
}

/// Adds a mode; of two at one place the better is kept.
fn insert(modes: &mut LatticeModes, mode: LatticeMode, cell_m: f64) {
    let one_place_m = ONE_PLACE_CELLS * cell_m;
    let is_near = |m: &LatticeMode| (m.offset_m - mode.offset_m).norm() < one_place_m;
    let n = modes.n;
    if let Some(known) = modes.as_slice().iter().position(is_near) {
        if modes.modes[known].score >= mode.score {
            return;
        }
        modes.modes[known..n].rotate_left(1);
        modes.n -= 1;
    }
    modes.insert(mode);
}

impl Sightline {
    fn new(peak: &MapPeak, index: usize, witness: &Witness, view: &View) -> Self {
        let m = &witness.cell_from_offset;
        let depth_m = m.m34;
        let per_cell = 1.0 / view.peak_sigma_cells();
        let row = |i: usize| Vector3::new(m[(i, 0)], m[(i, 1)], m[(i, 2)]);
        let scale = per_cell / depth_m;
        let slopes = [
            (row(0) - row(2) * peak.cell.x) * scale,
            (row(1) - row(2) * peak.cell.y) * scale,
        ];
        let off = (Vector2::new(m.m14, m.m24) / depth_m - peak.cell) * per_cell;
        let weight = witness.weight * peak.height;
        let [x, y] = slopes;
        Self {
            witness: index,
            weight,
            slopes,
            off,
            information: Symmetric::of_products([(&x, &(x * weight)), (&y, &(y * weight))]),
            pull: (x * off.x + y * off.y) * -weight,
            is_met: false,
            explained: 0,
        }
    }

    /// How far the line passes a place, in sigmas of a peak.
    fn passes(&self, place_m: &Vector3<f64>) -> Vector2<f64> {
        let [x, y] = &self.slopes;
        self.off + Vector2::new(x.dot(place_m), y.dot(place_m))
    }
}

impl Meeting {
    fn add(&mut self, line: &Sightline, share: f64) {
        self.weight += line.weight * share;
        self.information.add(&line.information, share);
        self.pull += line.pull * share;
    }

    /// The place on which the lines agree, inside the lattice.
    fn place_m(&self, at: &KeypointPlace<'_>) -> Vector3<f64> {
        let sigma_m = at.parameters.prior_sigma_m;
        let prior = self.weight / (sigma_m * sigma_m);
        let place_m = self.information.solve(prior, &self.pull);
        let half_m = at.parameters.half_width_m;
        place_m.map(|v| v.clamp(-half_m, half_m))
    }
}

/// A symmetric 3 x 3 matrix: xx, xy, xz, yy, yz, zz.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Symmetric([f64; 6]);

impl Symmetric {
    /// The sum of the outer products of two pairs of vectors, which is symmetric.
    pub(super) fn of_products([one, other]: [(&Vector3<f64>, &Vector3<f64>); 2]) -> Self {
        let entry = |i: usize, j: usize| one.0[i] * one.1[j] + other.0[i] * other.1[j];
        Self([
            entry(0, 0),
            entry(0, 1),
            entry(0, 2),
            entry(1, 1),
            entry(1, 2),
            entry(2, 2),
        ])
    }

    /// Adds `share` of `other`.
    pub(super) fn add(&mut self, other: &Self, share: f64) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            *own += other * share;
        }
    }

    /// Solves (self + `more` I) x = b by the adjugate; not finite unless self has no negative
    /// eigenvalues and `more` > 0.
    pub(super) fn solve(&self, more: f64, b: &Vector3<f64>) -> Vector3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        let (xx, yy, zz) = (xx + more, yy + more, zz + more);
        let (a, d, e) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let (f, g, h) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
        let inverse = 1.0 / (xx * a + xy * d + xz * e);
        Vector3::new(
            (a * b.x + d * b.y + e * b.z) * inverse,
            (d * b.x + f * b.y + g * b.z) * inverse,
            (e * b.x + g * b.y + h * b.z) * inverse,
        )
    }
}

#[cfg(test)]
mod symmetric_tests {
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn the_solution_solves_the_system(
            a in prop::array::uniform9(-3.0f64..3.0), b in prop::array::uniform3(-1.0f64..1.0), more in 0.1f64..10.0,
        ) {
            let a = Matrix3::from_row_slice(&a);
            let m = a * a.transpose();
            let b = Vector3::from(b);
            let x = Symmetric([m.m11, m.m12, m.m13, m.m22, m.m23, m.m33]).solve(more, &b);
            prop_assert!(((m + Matrix3::identity() * more) * x - b).norm() < 1e-9);
        }
    }
}
