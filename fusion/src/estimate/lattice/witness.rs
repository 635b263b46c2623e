//! Views in the search for a keypoint: which take part, their weights, and the evidence at the
//! result.

use farfield_proto::venue::parameters::LatticeParameters;
use nalgebra::{Matrix3x4, Unit, Vector2, Vector3};

use super::{KeypointPlace, prior};
use crate::body::observed::KeypointEstimate;
use crate::estimate::evidence::{ExpectedKeypoint, View};

/// Native pixels per map cell from which a crop has full weight. The usual networks have four input
/// pixels per cell: below four native pixels the crop was enlarged, and the network saw a blur.
const FULL_RESOLUTION_PX: f64 = 4.0;
/// Least factor of resolution in a view's vote: a blur is still evidence.
const LEAST_RESOLUTION: f64 = 0.1;
/// Height of a map, 0 to 1, from which it shows something.
const LEAST_RESPONSE: f64 = 0.15;
/// Least depth of the whole lattice in front of the camera, metres.
const LEAST_DEPTH_M: f64 = 0.05;

/// One view that takes part.
#[derive(Debug, Clone)]
pub(super) struct Witness {
    /// Position among the views of the search.
    pub(super) view: usize,
    /// `a_j` over the sum of all `a_j`.
    pub(super) weight: f64,
    /// The view's share of one vote, with resolution and the weight of its silence, without
    /// occlusion.
    vote: f64,
    /// Whether its map shows anything in the lattice.
    pub(super) responds: bool,
    /// Offset from the prediction (metres, homogeneous) to homogeneous cells.
    pub(super) cell_from_offset: Matrix3x4<f64>,
    /// From the camera to the prediction.
    ray: Unit<Vector3<f64>>,
}

/// The views that take part in the search for one keypoint.
#[derive(Debug, Clone, Default)]
pub(super) struct Witnesses {
    all: Vec<Witness>,
    /// Sum of the votes with occlusion over the sum of all votes.
    trust: f64,
    /// Metres per map cell at the keypoint, in the finest view.
    pub(super) cell_m: f64,
}

impl Witnesses {
    pub(super) fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    pub(super) fn iter(&self) -> std::slice::Iter<'_, Witness> {
        self.all.iter()
    }

    /// Gathers the views with data at their prediction of `keypoint`. [`Self::share_votes`] sets
    /// the weights.
    pub(super) fn gather(
        &mut self,
        views: &[View],
        keypoint: usize,
        parameters: &LatticeParameters,
    ) {
        self.all.clear();
        self.cell_m = f64::INFINITY;
        // A corner of the lattice may be nearer to the camera than its centre by this much.
        let reach_m = parameters.half_width_m * 3.0f64.sqrt();
        for (index, view) in views.iter().enumerate() {
            let expected = view.expected(keypoint);
            let in_front = |e: &&ExpectedKeypoint| e.depth_m() > LEAST_DEPTH_M + reach_m;
            if let Some(expected) = expected.filter(in_front) {
                self.all.push(Witness {
                    view: index,
                    weight: 0.0,
                    vote: 0.0,
                    responds: view.peaks(keypoint).highest() >= LEAST_RESPONSE,
                    cell_from_offset: view.cell_from_offset(keypoint, expected),
                    ray: Unit::new_normalize(expected.position_m - view.center_m()),
                });
                self.cell_m = self.cell_m.min(expected.cell_m);
            }
        }
    }

    /// Sets the weights, with the sum 1. Viewpoints close together share one vote. The vote of a
    /// view that shows nothing here is multiplied by the share of the person that it sees
    /// ([`sight`]).
    pub(super) fn share_votes(
        &mut self,
        views: &[View],
        keypoint: usize,
        closeness: &mut Closeness,
        sight: &[f64],
    ) {
        for witness in &mut self.all {
            // A view that shows nothing here takes no more of a neighbour's vote than it has
            // itself.
            let has = if witness.responds {
                1.0
            } else {
                sight[witness.view]
            };
            closeness.crowd[witness.view] = (has, 1.0);
        }
        for &(a, b, shared) in &closeness.close {
            let [of_a, of_b] = [a, b].map(|view| closeness.crowd[view].0);
            closeness.crowd[a].1 += of_b * shared;
            closeness.crowd[b].1 += of_a * shared;
        }
        for witness in &mut self.all {
            witness.vote = 1.0 / closeness.crowd[witness.view].1;
            closeness.crowd[witness.view] = (0.0, 1.0);
        }
        let (mut votes, mut weights) = (0.0, 0.0);
        for witness in &mut self.all {
            let resolution =
                views[witness.view].grid(keypoint).pixels_per_cell() / FULL_RESOLUTION_PX;
            witness.vote *= resolution.clamp(LEAST_RESOLUTION, 1.0);
            if !witness.responds {
                witness.vote *= sight[witness.view];
            }
            witness.weight = witness.vote * views[witness.view].occlusion[keypoint].clamp(0.0, 1.0);
            votes += witness.vote;
            weights += witness.weight;
        }
        // Views without any weight (g = 0 and all occluded, or all blind) are no witnesses.
        if weights <= 0.0 {
            self.all.clear();
            return;
        }
        self.trust = weights / votes;
        for witness in &mut self.all {
            witness.weight /= weights;
        }
    }

    /// S at an offset from the prediction: the weighted mean of the maps, 0 to 1.
    pub(super) fn support(&self, views: &[View], keypoint: usize, offset_m: Vector3<f64>) -> f64 {
        let weighted = self
            .all
            .iter()
            .map(|w| w.weight * w.map_value(views, keypoint, offset_m));
        weighted.sum()
    }

    /// F at an offset from the prediction.
    pub(super) fn score(&self, at: &KeypointPlace<'_>, offset_m: Vector3<f64>) -> f64 {
        let prior = prior(offset_m, at.parameters.prior_sigma_m);
        prior * self.support(at.views, at.keypoint, offset_m)
    }

    /// S at an offset from the prediction; stores each map's value there in `values`.
    pub(super) fn read_maps(
        &self,
        views: &[View],
        keypoint: usize,
        offset_m: Vector3<f64>,
        values: &mut Vec<f64>,
    ) -> f64 {
        values.clear();
        let witnesses = self.all.iter();
        values.extend(witnesses.map(|w| w.map_value(views, keypoint, offset_m)));
        self.weighed(values)
    }

    /// S from the value of each map.
    pub(super) fn weighed(&self, values: &[f64]) -> f64 {
        let weighted = self
            .all
            .iter()
            .zip(values)
            .map(|(w, values)| w.weight * *values);
        weighted.sum()
    }

    /// Sets weight, views and ray of the estimate from the values of the single views at the
    /// result.
    pub(super) fn set_evidence(
        &self,
        values: &[f64],
        parameters: &LatticeParameters,
        estimate: &mut KeypointEstimate,
    ) {
        let limit_rad = parameters.independent_angle_deg.to_radians();
        let least_cosine = libm::cos(limit_rad);
        let (mut independent, mut best) = (0.0, None::<(f64, &Witness)>);
        estimate.weight = (self.trust * estimate.support).clamp(0.0, 1.0);
        let supports = |value: f64| value >= parameters.min_support;
        for (i, (witness, &value_i)) in self.all.iter().zip(values).enumerate() {
            if !supports(value_i) {
                continue;
            }
            let mut crowd = 0.0;
            for (j, (other, &value_j)) in self.all.iter().zip(values).enumerate() {
                // Most are far apart, and the cosine shows it.
                if j != i && supports(value_j) && witness.ray.dot(&other.ray).abs() >= least_cosine
                {
                    crowd += shared(witness.lines_apart_rad(other), limit_rad);
                }
            }
            independent += 1.0 / (1.0 + crowd);
            if best.is_none_or(|(most, _)| witness.weight * value_i > most) {
                best = Some((witness.weight * value_i, witness));
            }
        }
        // A mean above the threshold implies at least one view above it.
        estimate.views = f64::max(independent.round(), 1.0) as u16;
        estimate.ray = best
            .filter(|_| estimate.views == 1)
            .map(|(_, witness)| witness.ray);
    }
}

impl Witness {
    /// Angle between the lines on which two views put the keypoint, 0 to π/2: the rays of opposite
    /// cameras are one line, and the position along it is unknown.
    fn lines_apart_rad(&self, other: &Self) -> f64 {
        let (a, b) = (self.ray.as_ref(), other.ray.as_ref());
        libm::atan2(a.cross(b).norm(), a.dot(b).abs())
    }

    /// The cell of an offset from the prediction.
    pub(super) fn cell_at(&self, offset_m: &Vector3<f64>) -> Vector2<f64> {
        let h = self.cell_from_offset * offset_m.push(1.0);
        Vector2::new(h.x, h.y) * (1.0 / h.z)
    }

    /// The view's map at an offset from the prediction, 0 to 1.
    pub(super) fn map_value(&self, views: &[View], keypoint: usize, offset_m: Vector3<f64>) -> f64 {
        let map = views[self.view].map(keypoint);
        map.bilinear(self.cell_at(&offset_m))
    }
}

/// Per view, the share of the person that it sees: of the keypoints that it should see, those at
/// which its maps show anything. A view behind an unknown obstacle shows nothing at all, and its
/// silence about a keypoint is no evidence. The silence of one that shows the rest of the person is
/// evidence that this keypoint is not here. `keypoints` are gathered.
pub(super) fn sight<'a>(
    views: &[View],
    keypoints: impl Iterator<Item = &'a Witnesses>,
    counts: &mut Vec<[f64; 2]>,
    sight: &mut Vec<f64>,
) {
    counts.clear();
    counts.resize(views.len(), [0.0; 2]);
    for (keypoint, witnesses) in keypoints.enumerate() {
        for witness in &witnesses.all {
            let should = views[witness.view].occlusion[keypoint].clamp(0.0, 1.0);
            let [seen, all] = &mut counts[witness.view];
            *all += should;
            *seen += if witness.responds { should } else { 0.0 };
        }
    }
    sight.clear();
    let share = |[seen, all]: &[f64; 2]| if *all > 0.0 { seen / all } else { 0.0 };
    sight.extend(counts.iter().map(share));
}

/// Which views have nearly the same direction.
#[derive(Debug, Clone, Default)]
pub(super) struct Closeness {
    /// Pairs of views and how much they are one witness: 1 for the same direction, falling to 0 at
    /// `independent_angle_deg`, as seen from the middle of the predictions. Pairs at 0 are omitted.
    close: Vec<(usize, usize, f64)>,
    /// Per view, its direction.
    directions: Vec<Vector3<f64>>,
    /// Per view: its own vote on a keypoint, and the sum of those that share it; (0, 1) between
    /// keypoints.
    crowd: Vec<(f64, f64)>,
}

impl Closeness {
    /// Compares the directions of `views` towards the middle of `predicted_m`.
    pub(super) fn measure(
        &mut self,
        views: &[View],
        predicted_m: &[Vector3<f64>],
        parameters: &LatticeParameters,
    ) {
        let known = predicted_m
            .iter()
            .filter(|p| p.iter().all(|v| v.is_finite()));
        let (sum, n) = known.fold((Vector3::zeros(), 0usize), |(sum, n), p| (sum + p, n + 1));
        let middle_m = sum / n.max(1) as f64;
        let limit_rad = parameters.independent_angle_deg.to_radians();
        let least_cosine = libm::cos(limit_rad);
        let Self {
            close,
            directions,
            crowd,
        } = self;
        directions.clear();
        directions.extend(views.iter().map(|v| (v.center_m() - middle_m).normalize()));
        crowd.clear();
        crowd.resize(views.len(), (0.0, 1.0));
        close.clear();
        for (b, of_b) in directions.iter().enumerate() {
            for (a, of_a) in directions[..b].iter().enumerate() {
                if of_a.dot(of_b) > least_cosine {
                    let apart_rad = libm::atan2(of_a.cross(of_b).norm(), of_a.dot(of_b));
                    close.push((a, b, shared(apart_rad, limit_rad)));
                }
            }
        }
    }
}

/// How much two directions are one: 1 at no angle, falling to 0 at the limit.
fn shared(apart_rad: f64, limit_rad: f64) -> f64 {
    if apart_rad >= limit_rad {
        0.0
    } else {
        1.0 - apart_rad / limit_rad
    }
}
