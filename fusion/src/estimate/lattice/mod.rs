//! The search for the most probable keypoint positions: paper, eq. (6)-(8) and (12).
//!
//! ```text
//!   P_key = P_pred + argmax_d  F(d),    F(d) = S(d) exp(-|d|^2/(2 sigma^2))
//!   S(d)  = sum_j a_j S_j(mu_j(c_j + d)) / sum_j a_j
//! ```
//!
//! `S_j` is the map of view j, `mu_j` its projection, `c_j` the keypoint's prediction at the capture
//! instant of *that view* (a view taken 5 ms late looks for the keypoint where it was then), `a_j` what
//! the view counts: the occlusion weight of eq. (9), its share of the votes of viewpoints that stand
//! close together, and the native pixels per cell. All points of one keypoint's lattice are compared
//! over the same views: those whose `c_j` lies where they know something. A point outside such a
//! view's map takes the map's border.
//!
//! Where we depart from the paper: the sum is divided by the weights, so that thresholds do not
//! depend on the number of views; candidates are weighed by a Gaussian around the prediction; a
//! coarse pass, a halving descent and damped Newton steps on a smooth model of the maps take the
//! place of one fine lattice, so that the answer is not quantised; left and right are decided
//! together. A keypoint that nothing supports falls back to its prediction, with weight 0.
//!
//! Maps that two *persons* claim are not shared out here.

mod coarse;
mod refine;
mod sides;
#[cfg(test)]
mod tests;
mod witness;

use farfield_proto::keypoints::KeypointSet;
use farfield_proto::venue::parameters::LatticeParameters;
use nalgebra::Vector3;

use self::coarse::CoarsePass;
use self::sides::{Sides, decide_sides};
use self::witness::Witnesses;
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::estimate::evidence::View;

/// Most places at which one keypoint may be.
const MAX_MODES: usize = 4;

/// A place where the keypoint may be: a local maximum of F.
#[derive(Debug, Clone, Copy, PartialEq)]
struct LatticeMode {
    /// From the prediction, metres.
    offset_m: Vector3<f64>,
    /// F there.
    score: f64,
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
            modes: [LatticeMode {
                offset_m: Vector3::zeros(),
                score: 0.0,
            }; MAX_MODES],
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

/// One keypoint in the middle of the search.
#[derive(Debug, Clone, Default)]
struct Keypoint {
    witnesses: Witnesses,
    modes: LatticeModes,
}

/// The search, with its buffers. Nothing is allocated once they have grown to a venue's views.
#[derive(Debug, Clone)]
pub struct LatticeSearch {
    sides: Vec<Sides>,
    keypoints: Vec<Keypoint>,
    coarse: CoarsePass,
    /// Per pair of views: how much they are one witness, 0 to 1.
    closeness: Vec<f64>,
    /// Per view: how much of the person it sees, 0 to 1, and what that is made of.
    sight: Vec<f64>,
    sight_counts: Vec<[f64; 2]>,
}

impl LatticeSearch {
    /// A search for the keypoints of a network.
    pub fn new(keypoints: &KeypointSet) -> Self {
        Self {
            sides: Sides::of(keypoints),
            keypoints: vec![Keypoint::default(); keypoints.len()],
            coarse: CoarsePass::default(),
            closeness: Vec::new(),
            sight: Vec::new(),
            sight_counts: Vec::new(),
        }
    }

    /// Finds the keypoints of one person from its `views` of one tick. `predicted_m` are the
    /// predictions at the tick (world, metres); those at the capture instants, and the occlusion
    /// weights, are in the views. `estimates` is overwritten, one per keypoint of the network.
    /// Predictions that are missing or not finite give estimates without weight.
    pub fn search(
        &mut self,
        views: &[View],
        predicted_m: &[Vector3<f64>],
        parameters: &LatticeParameters,
        estimates: &mut Vec<KeypointEstimate>,
    ) {
        witness::closeness(views, predicted_m, parameters, &mut self.closeness);
        for (index, keypoint) in self.keypoints.iter_mut().enumerate() {
            keypoint.witnesses.gather(views, index, parameters);
        }
        let gathered = self.keypoints.iter().map(|keypoint| &keypoint.witnesses);
        witness::sight(views, gathered, &mut self.sight_counts, &mut self.sight);
        for (index, keypoint) in self.keypoints.iter_mut().enumerate() {
            keypoint.modes = LatticeModes::default();
            keypoint
                .witnesses
                .share_votes(views, index, &self.closeness, &self.sight);
            if !keypoint.witnesses.is_empty() {
                keypoint.find_modes(views, index, &mut self.coarse, parameters);
            }
        }
        let at = |index: usize| {
            predicted_m
                .get(index)
                .copied()
                .unwrap_or(Vector3::repeat(f64::NAN))
        };
        estimates.clear();
        estimates
            .extend((0..self.keypoints.len()).map(|k| KeypointEstimate::unsupported(at(k), 0.0)));
        for (index, keypoint) in self.keypoints.iter().enumerate() {
            estimates[index] = keypoint.estimate(
                views,
                index,
                at(index),
                keypoint.modes.as_slice().first(),
                parameters,
            );
        }
        for sides in &self.sides {
            let pair = sides.indices();
            let Some(chosen) =
                decide_sides(pair.map(|k| &self.keypoints[k]), pair.map(at), parameters)
            else {
                continue;
            };
            for (k, mode) in pair.into_iter().zip(chosen) {
                estimates[k] =
                    self.keypoints[k].estimate(views, k, at(k), mode.as_ref(), parameters);
            }
        }
    }
}

impl Keypoint {
    /// Coarse pass, descent and Newton: fills `modes`.
    fn find_modes(
        &mut self,
        views: &[View],
        index: usize,
        coarse: &mut CoarsePass,
        parameters: &LatticeParameters,
    ) {
        let witnesses = &self.witnesses;
        let coarse_m = coarse.run(views, index, witnesses, parameters);
        let fine_m = coarse_m / f64::from(parameters.fine_per_coarse.max(1));
        for rough in coarse.modes().as_slice() {
            let mut mode = *rough;
            let score = |offset_m: Vector3<f64>| {
                let prior = prior(offset_m, parameters.prior_sigma_m);
                LatticeMode {
                    offset_m,
                    score: prior * witnesses.support(views, index, offset_m),
                }
            };
            let mut step_m = coarse_m * 0.5;
            mode.score = score(mode.offset_m).score;
            while step_m >= fine_m * 0.99 {
                mode = refine::best_neighbour(mode, step_m, score);
                step_m *= 0.5;
            }
            if mode.score <= 0.0 {
                continue;
            }
            // The score stays that of F's maximum; the place is that of S's, near it.
            mode.offset_m = refine::newton(
                witnesses,
                views,
                index,
                (mode, fine_m),
                parameters.prior_sigma_m,
            );
            // Two coarse maxima may lead to one.
            let known = self
                .modes
                .as_slice()
                .iter()
                .any(|m| (m.offset_m - mode.offset_m).norm() < fine_m);
            if !known {
                self.modes.insert(mode);
            }
        }
    }

    /// The estimate for `mode`, or the fall back to the prediction without one.
    fn estimate(
        &self,
        views: &[View],
        index: usize,
        predicted_m: Vector3<f64>,
        mode: Option<&LatticeMode>,
        parameters: &LatticeParameters,
    ) -> KeypointEstimate {
        let Some(&LatticeMode { offset_m, .. }) = mode else {
            return KeypointEstimate::unsupported(predicted_m, 0.0);
        };
        let support = self
            .witnesses
            .support(views, index, offset_m)
            .clamp(0.0, 1.0);
        let position_m = predicted_m + offset_m;
        if support < parameters.min_support || !position_m.iter().all(|v| v.is_finite()) {
            return KeypointEstimate::unsupported(predicted_m, support);
        }
        let mut estimate = KeypointEstimate::unsupported(position_m, support);
        self.witnesses
            .testify(views, index, (offset_m, parameters), &mut estimate);
        estimate
    }
}

/// The Gaussian around the prediction that candidates are weighed by; its peak is 1.
fn prior(offset_m: Vector3<f64>, sigma_m: f64) -> f64 {
    libm::exp(-0.5 * offset_m.norm_squared() / (sigma_m * sigma_m))
}
