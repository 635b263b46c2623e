//! The search for the most probable keypoint positions: paper, eq. (6)-(8) and (12).
//!
//! ```text
//!   P_key = P_pred + argmax_d  F(d),    F(d) = S(d) exp(-|d|^2/(2 sigma^2))
//!   S(d)  = sum_j a_j S_j(mu_j(c_j + d)) / sum_j a_j
//! ```
//!
//! `S_j` is the map of view j, `mu_j` its projection, and `c_j` the keypoint's prediction at the
//! capture instant of *that view* (a view taken 5 ms late uses the place at that time). `a_j` is
//! the weight of the view: the occlusion weight of eq. (9), its share of the votes of viewpoints
//! that stand close together, and the native pixels per cell. All points of one keypoint's lattice
//! are compared over the same views: those with data at their `c_j`. A point outside such a view's
//! map takes the map's border.
//!
//! Differences from the paper:
//!
//! - The sum is divided by the weights, so that thresholds do not depend on the number of views.
//! - Candidates are weighted by a Gaussian around the prediction.
//! - Candidates are not the points of a lattice but the few places where the lines of sight of the
//!   maps' peaks meet. F, linear in the maps, selects one of them.
//! - From there damped Newton steps on a smooth model of the maps lead to the maximum of the sum of
//!   the maps' *squares*, so that the result is not quantised. (An unsure network draws a lower
//!   peak, and its errors are larger.)
//! - Left and right are decided together.
//!
//! The whole lattice is scored only if maps have values but no peak, such as the slope of a peak
//! outside. A halving descent then leads to its best points. A keypoint without support falls back
//! to its prediction, with weight 0.
//!
//! Peaks that belong to two *persons* are assigned elsewhere.

mod candidates;
mod coarse;
mod refine;
mod sides;
#[cfg(test)]
mod tests;
mod witness;

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::venue::parameters::LatticeParameters;
use nalgebra::Vector3;

use self::candidates::Candidates;
use self::coarse::CoarsePass;
use self::refine::Refiner;
use self::sides::{Sides, are_one_spot, decide_sides};
use self::witness::{Closeness, Witnesses};
use crate::body::observed::KeypointEstimate;
use crate::estimate::evidence::View;

/// Most modes of one keypoint.
const MAX_MODES: usize = 4;
/// Most whole steps of an ascent, before they are halved.
const MOST_STRIDES: usize = 6;

/// A possible place of the keypoint: a local maximum of F.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LatticeMode {
    /// From the prediction, metres.
    offset_m: Vector3<f64>,
    /// F there.
    score: f64,
    origin: ModeOrigin,
}

/// How a mode was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ModeOrigin {
    /// Meeting of lines of sight: a maximum of F by the places of the peaks.
    Meeting,
    /// End of an ascent, within a fine step.
    Ascent,
    /// End of Newton's steps.
    Refined,
}

impl LatticeMode {
    fn new(offset_m: Vector3<f64>, score: f64, origin: ModeOrigin) -> Self {
        Self {
            offset_m,
            score,
            origin,
        }
    }
}

/// The best few local maxima of one keypoint, best first.
#[derive(Debug, Clone, Copy)]
struct LatticeModes {
    modes: [LatticeMode; MAX_MODES],
    n: usize,
}

impl Default for LatticeModes {
    fn default() -> Self {
        Self {
            modes: [LatticeMode::new(Vector3::zeros(), 0.0, ModeOrigin::Meeting); MAX_MODES],
            n: 0,
        }
    }
}

impl LatticeModes {
    fn as_slice(&self) -> &[LatticeMode] {
        &self.modes[..self.n]
    }

    /// Keeps the best [`MAX_MODES`], best first; of equal ones the earlier.
    fn insert(&mut self, mode: LatticeMode) {
        let at = self
            .as_slice()
            .iter()
            .position(|m| mode.score > m.score)
            .unwrap_or(self.n);
        if at < MAX_MODES {
            self.n = (self.n + 1).min(MAX_MODES);
            self.modes[at..self.n].rotate_right(1);
            self.modes[at] = mode;
        }
    }
}

/// One keypoint during the search.
#[derive(Debug, Clone, Default)]
struct Keypoint {
    witnesses: Witnesses,
    modes: LatticeModes,
    /// Per witness, the value of its map at the place that was refined last.
    values: Vec<f64>,
}

/// The search, with reused buffers: allocates only until they have the size for a venue's views.
#[derive(Debug, Clone)]
pub struct LatticeSearch {
    sides: Vec<Sides>,
    keypoints: Vec<Keypoint>,
    closeness: Closeness,
    /// Per view: the share of the person that it sees, 0 to 1, and the sums of that share.
    sight: Vec<f64>,
    sight_counts: Vec<[f64; 2]>,
    work: Work,
}

/// The buffers of the steps.
#[derive(Debug, Clone, Default)]
struct Work {
    candidates: Candidates,
    coarse: CoarsePass,
    refiner: Refiner,
}

impl LatticeSearch {
    /// A search for the keypoints of a network.
    pub fn new(keypoints: &KeypointSet) -> Self {
        Self {
            sides: Sides::of_network(keypoints),
            keypoints: vec![Keypoint::default(); keypoints.len()],
            closeness: Closeness::default(),
            sight: Vec::new(),
            sight_counts: Vec::new(),
            work: Work::default(),
        }
    }

    /// Finds the keypoints of one person from its `views` of one tick. `predicted_m` are the
    /// predictions at the tick (world, metres). Those at the capture instants, and the occlusion
    /// weights, are in the views. `estimates` is overwritten, one per keypoint of the network.
    /// Missing or non-finite predictions give estimates without weight.
    pub fn search(
        &mut self,
        views: &mut [View],
        predicted_m: &[Vector3<f64>],
        parameters: &LatticeParameters,
        estimates: &mut Vec<KeypointEstimate>,
    ) {
        for view in &mut *views {
            view.find_peaks(parameters.half_width_m);
        }
        let views = &*views;
        self.closeness.measure(views, predicted_m, parameters);
        for (index, keypoint) in self.keypoints.iter_mut().enumerate() {
            keypoint.witnesses.gather(views, index, parameters);
        }
        let gathered = self.keypoints.iter().map(|keypoint| &keypoint.witnesses);
        witness::sight(views, gathered, &mut self.sight_counts, &mut self.sight);
        let place = |index: usize| KeypointPlace {
            views,
            keypoint: index,
            predicted_m: predicted_m
                .get(index)
                .copied()
                .unwrap_or(Vector3::repeat(f64::NAN)),
            parameters,
        };
        estimates.clear();
        for (index, keypoint) in self.keypoints.iter_mut().enumerate() {
            let at = place(index);
            keypoint
                .witnesses
                .share_votes(views, index, &mut self.closeness, &self.sight);
            keypoint.find_modes(&at, &mut self.work);
            let best = keypoint.modes.as_slice().first().copied();
            estimates.push(keypoint.estimate(&at, best));
        }
        for sides in &self.sides {
            let pair = sides.indices();
            let predicted_m = pair.map(|k| place(k).predicted_m);
            if !are_one_spot(pair.map(|k| &self.keypoints[k]), predicted_m) {
                continue;
            }
            for k in pair {
                self.keypoints[k].settle(&place(k));
            }
            let chosen = decide_sides(
                pair.map(|k| &self.keypoints[k]),
                predicted_m,
                parameters.min_support,
            );
            for (k, mode) in pair.into_iter().zip(chosen) {
                let keypoint = &mut self.keypoints[k];
                let mode = mode.map(|mode| keypoint.refined(&place(k), mode, &mut self.work));
                estimates[k] = keypoint.estimate(&place(k), mode);
            }
        }
    }
}

/// Place and data of the search for one keypoint.
#[derive(Clone, Copy)]
struct KeypointPlace<'a> {
    views: &'a [View],
    keypoint: usize,
    /// At the tick, world, metres.
    predicted_m: Vector3<f64>,
    parameters: &'a LatticeParameters,
}

impl Keypoint {
    /// Fills `modes`; the best one is refined.
    fn find_modes(&mut self, at: &KeypointPlace<'_>, work: &mut Work) {
        self.modes = LatticeModes::default();
        if self.witnesses.is_empty() {
            return;
        }
        work.candidates.find(at, &self.witnesses, &mut self.modes);
        if self.modes.n == 0 && self.witnesses.iter().any(|witness| witness.responds) {
            self.climb(at, &mut work.coarse);
        }
        if let Some(&best) = self.modes.as_slice().first() {
            self.modes.modes[0] = self.refined(at, best, work);
        }
    }

    /// Coarse pass and descent, for maps with slopes of peaks outside the lattice.
    fn climb(&mut self, at: &KeypointPlace<'_>, coarse: &mut CoarsePass) {
        coarse.run(at.views, at.keypoint, &self.witnesses, at.parameters);
        for rough in coarse.modes().as_slice() {
            self.insert_top(at, rough.offset_m);
        }
    }

    /// Keeps, after the best mode, only maxima of F, and not crossings of lines of sight on the
    /// slope of a higher one.
    fn settle(&mut self, at: &KeypointPlace<'_>) {
        let rough = self.modes;
        self.modes.n = self.modes.n.min(1);
        for mode in &rough.as_slice()[self.modes.n..] {
            self.insert_top(at, mode.offset_m);
        }
    }

    /// Adds the maximum of F that a halving ascent reaches from `start_m`, unless it is known.
    fn insert_top(&mut self, at: &KeypointPlace<'_>, start_m: Vector3<f64>) {
        let score = |offset_m: Vector3<f64>| self.witnesses.score(at, offset_m);
        let fine_m = self.fine_m(at);
        let mut step_m = fine_m * f64::from(at.parameters.fine_per_coarse.max(1));
        let mut mode = LatticeMode::new(start_m, score(start_m), ModeOrigin::Ascent);
        for _ in 0..MOST_STRIDES {
            let next = refine::best_neighbour(mode, step_m, score);
            if next == mode {
                break;
            }
            mode = next;
        }
        while step_m > fine_m * 1.01 {
            step_m *= 0.5;
            mode = refine::best_neighbour(mode, step_m, score);
        }
        let one_place_m = candidates::ONE_PLACE_CELLS * self.witnesses.cell_m;
        let known = self.modes.as_slice().iter();
        let mut apart_m = known.map(|m| (m.offset_m - mode.offset_m).norm());
        if mode.score > 0.0 && apart_m.all(|apart_m| apart_m >= one_place_m) {
            self.modes.insert(mode);
        }
    }

    /// The finest step of an ascent, metres.
    fn fine_m(&self, at: &KeypointPlace<'_>) -> f64 {
        let coarse_m = at.parameters.coarse_step_cells * self.witnesses.cell_m;
        coarse_m / f64::from(at.parameters.fine_per_coarse.max(1))
    }

    /// The mode that Newton's steps reach. Its score stays that of F's maximum; the place is that
    /// of S's, near it.
    fn refined(
        &mut self,
        at: &KeypointPlace<'_>,
        mode: LatticeMode,
        work: &mut Work,
    ) -> LatticeMode {
        let pulled_steps = match mode.origin {
            ModeOrigin::Meeting => 0,
            ModeOrigin::Ascent => refine::PULLED_STEPS,
            ModeOrigin::Refined => {
                self.read_maps(at, mode.offset_m);
                return mode;
            }
        };
        let start = (mode.offset_m, pulled_steps);
        let step_m = self.fine_m(at);
        let found = work.refiner.newton(at, &self.witnesses, start, step_m);
        let before = mode.score / prior(mode.offset_m, at.parameters.prior_sigma_m);
        let found = found.filter(|offset_m| self.read_maps(at, *offset_m) >= refine::LOSS * before);
        let offset_m = found.unwrap_or_else(|| {
            self.read_maps(at, mode.offset_m);
            mode.offset_m
        });
        LatticeMode {
            offset_m,
            origin: ModeOrigin::Refined,
            ..mode
        }
    }

    /// S at an offset; stores each map's value there.
    fn read_maps(&mut self, at: &KeypointPlace<'_>, offset_m: Vector3<f64>) -> f64 {
        self.witnesses
            .read_maps(at.views, at.keypoint, offset_m, &mut self.values)
    }

    /// The estimate for `mode`, which was refined last; without one, the prediction.
    fn estimate(&mut self, at: &KeypointPlace<'_>, mode: Option<LatticeMode>) -> KeypointEstimate {
        let Some(LatticeMode { offset_m, .. }) = mode else {
            return KeypointEstimate::unsupported(at.predicted_m, 0.0);
        };
        let support = self.witnesses.weighed(&self.values).clamp(0.0, 1.0);
        let position_m = at.predicted_m + offset_m;
        if support < at.parameters.min_support || !position_m.iter().all(|v| v.is_finite()) {
            return KeypointEstimate::unsupported(at.predicted_m, support);
        }
        let mut estimate = KeypointEstimate::unsupported(position_m, support);
        self.witnesses
            .set_evidence(&self.values, at.parameters, &mut estimate);
        estimate
    }
}

/// The Gaussian around the prediction that weights candidates; its peak is 1.
fn prior(offset_m: Vector3<f64>, sigma_m: f64) -> f64 {
    libm::exp(-0.5 * offset_m.norm_squared() / (sigma_m * sigma_m))
}
