//! Which views take part in the search for a keypoint, what each counts, and what they testify.

use farfield_proto::venue::parameters::LatticeParameters;
use nalgebra::{Matrix3x4, Unit, Vector2, Vector3};

use crate::body::keypoint_estimate::KeypointEstimate;
use crate::estimate::evidence::{View, bilinear};

/// Native pixels per map cell from which a crop counts fully. The usual networks have four input
/// pixels per cell: below four native pixels the crop was enlarged, and the network saw a blur.
const FULL_RESOLUTION_PX: f64 = 4.0;
/// Least of what resolution leaves of a view's vote: a blur is still a witness.
const LEAST_RESOLUTION: f64 = 0.1;
/// Height of a map, 0 to 1, from which it shows something.
const LEAST_RESPONSE: f64 = 0.15;
/// Depth of the whole lattice in front of the camera, metres.
const LEAST_DEPTH_M: f64 = 0.05;

/// One view that takes part.
#[derive(Debug, Clone)]
pub(super) struct Witness {
    /// Position among the views of the search.
    pub(super) view: usize,
    /// `a_j` over the sum of all `a_j`.
    pub(super) weight: f64,
    /// The view's share of one vote, resolution and what its silence is worth included, occlusion not.
    vote: f64,
    /// Whether its map shows anything where the lattice is.
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
    /// Sum of the votes that occlusion left over the sum of all votes.
    trust: f64,
    /// Metres per map cell at the keypoint, in the finest view.
    pub(super) cell_m: f64,
}

impl Witnesses {
    pub(super) fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Witness> {
        self.all.iter()
    }

    /// Gathers the views that know something where `keypoint` is predicted for them; what each counts is for
    /// [`Self::share_votes`] to say.
    pub(super) fn gather(
        &mut self,
        views: &[View],
        keypoint: usize,
        parameters: &LatticeParameters,
    ) {
        self.all.clear();
        self.cell_m = f64::INFINITY;
        // A corner of the lattice may come nearer to the camera than its centre by this much.
        let reach_m = parameters.half_width_m * 3.0f64.sqrt();
        for (index, view) in views.iter().enumerate() {
            if let Some((mut witness, cell_m)) = Witness::of(view, index, keypoint, reach_m) {
                let h = witness.cell_from_offset.column(3);
                let cell = Vector2::new(h.x, h.y) / h.z;
                let reach_cells = parameters.half_width_m / cell_m;
                let highest = view.highest_near(keypoint, cell, reach_cells);
                witness.responds = highest >= LEAST_RESPONSE;
                self.all.push(witness);
                self.cell_m = self.cell_m.min(cell_m);
            }
        }
    }

    /// Viewpoints close together share one vote; a view that shows nothing here counts what it shows of the
    /// rest of the person ([`sight`]); then the weights are made to sum up to 1.
    pub(super) fn share_votes(
        &mut self,
        views: &[View],
        keypoint: usize,
        closeness: &[f64],
        sight: &[f64],
    ) {
        for i in 0..self.all.len() {
            let me = self.all[i].view;
            // Who shows nothing here takes no more of a neighbour's vote than it has itself.
            let shared = |w: &Witness| {
                let has = w.responds || w.view == me;
                let has = if has { 1.0 } else { sight[w.view] };
                has * closeness[me * views.len() + w.view]
            };
            let crowd: f64 = self.all.iter().map(shared).sum();
            self.all[i].vote = 1.0 / crowd.max(1.0);
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
        // Views that count nothing (g = 0 and all occluded, or all blind) are no witnesses.
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

    /// Fills in what follows from the single views at the found offset: weight, views, ray.
    pub(super) fn testify(
        &self,
        views: &[View],
        keypoint: usize,
        (offset_m, parameters): (Vector3<f64>, &LatticeParameters),
        estimate: &mut KeypointEstimate,
    ) {
        let value = |witness: &Witness| witness.map_value(views, keypoint, offset_m);
        let limit_rad = parameters.independent_angle_deg.to_radians();
        let (mut independent, mut best) = (0.0, None::<(f64, &Witness)>);
        estimate.weight = (self.trust * estimate.support).clamp(0.0, 1.0);
        for (i, witness) in self.all.iter().enumerate() {
            let says = value(witness);
            if says < parameters.min_support {
                continue;
            }
            let others = self.all.iter().enumerate().filter(|&(j, _)| j != i);
            let crowd: f64 = others
                .map(|(_, other)| (other, shared(witness.lines_apart_rad(other), limit_rad)))
                .filter(|&(other, shared)| shared > 0.0 && value(other) >= parameters.min_support)
                .map(|(_, shared)| shared)
                .sum();
            independent += 1.0 / (1.0 + crowd);
            if best.is_none_or(|(most, _)| witness.weight * says > most) {
                best = Some((witness.weight * says, witness));
            }
        }
        // Above the threshold on average means above it somewhere: at least one view.
        estimate.views = f64::max(independent.round(), 1.0) as u16;
        estimate.ray = best
            .filter(|_| estimate.views == 1)
            .map(|(_, witness)| witness.ray);
    }
}

impl Witness {
    /// The view as a witness, and its metres per cell; `None` when it knows nothing there.
    fn of(view: &View, index: usize, keypoint: usize, reach_m: f64) -> Option<(Self, f64)> {
        let center_m = *view.predicted_m.get(keypoint)?;
        if !center_m.iter().all(|v| v.is_finite()) {
            return None;
        }
        let cell_from_world = view.cell_from_world(keypoint);
        let h = cell_from_world * center_m.push(1.0);
        let known =
            h.z > LEAST_DEPTH_M + reach_m && view.knows(keypoint, Vector2::new(h.x, h.y) / h.z);
        if !known {
            return None;
        }
        let mut cell_from_offset = cell_from_world;
        cell_from_offset.set_column(3, &h);
        let focal_cells = cell_from_world.fixed_view::<2, 3>(0, 0)
            - Vector2::new(h.x, h.y) / h.z * cell_from_world.fixed_view::<1, 3>(2, 0);
        // Mean of the two axes' cells per radian.
        let cells_per_m = focal_cells.norm() / 2.0f64.sqrt() / h.z;
        let witness = Self {
            view: index,
            weight: 0.0,
            vote: 0.0,
            responds: false,
            cell_from_offset,
            ray: Unit::new_normalize(center_m - view.center_m()),
        };
        Some((witness, 1.0 / cells_per_m))
    }

    /// Angle between the lines on which two views put the keypoint, 0 to π/2: the rays of opposite
    /// cameras are one line, and nothing is known along it.
    fn lines_apart_rad(&self, other: &Self) -> f64 {
        let (a, b) = (self.ray.as_ref(), other.ray.as_ref());
        libm::atan2(a.cross(b).norm(), a.dot(b).abs())
    }

    /// The view's map at an offset from the prediction, 0 to 1.
    pub(super) fn map_value(&self, views: &[View], keypoint: usize, offset_m: Vector3<f64>) -> f64 {
        let h = self.cell_from_offset * offset_m.push(1.0);
        let view = &views[self.view];
        bilinear(
            view.cells(keypoint),
            view.map_size(),
            Vector2::new(h.x, h.y) / h.z,
        )
    }
}

/// Per view, how much of the person it sees: the share of the keypoints, of those that it should see, at which its maps
/// show anything. A view before which something unknown stands shows nothing at all, and its silence about a keypoint
/// says as little; one that shows the rest of the person says that this keypoint is not here. `keypoints` are
/// gathered.
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

/// Per pair of views, row by row: 1 where they look from the same direction, falling to 0 at
/// `independent_angle_deg`, as seen from the middle of the predictions.
pub(super) fn closeness(
    views: &[View],
    predicted_m: &[Vector3<f64>],
    parameters: &LatticeParameters,
    closeness: &mut Vec<f64>,
) {
    let known = predicted_m
        .iter()
        .filter(|p| p.iter().all(|v| v.is_finite()));
    let (sum, n) = known.fold((Vector3::zeros(), 0usize), |(sum, n), p| (sum + p, n + 1));
    let middle_m = sum / n.max(1) as f64;
    let limit_rad = parameters.independent_angle_deg.to_radians();
    closeness.clear();
    for a in views {
        for b in views {
            let apart = (a.center_m() - middle_m).angle(&(b.center_m() - middle_m));
            closeness.push(shared(apart, limit_rad));
        }
    }
    // A view is always itself, also with a limit of zero.
    for i in 0..views.len() {
        closeness[i * views.len() + i] = 1.0;
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
