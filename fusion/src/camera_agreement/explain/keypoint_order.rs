//! Whether the keypoints of a camera are in another order than those of the others: a file of another program, or left and
//! right exchanged.
//!
//! Every keypoint of a person in one camera is compared with every keypoint of that person in the others. The
//! assignment of least cost gives the order. If it differs from the one by names, the camera has another order.

use nalgebra::Vector3;

use super::super::geometry::meeting;
use super::super::pairs::{CameraRays, Partners, cost};
use super::super::samples::MAX_COMPARED;
use crate::assign::assign;

/// Additional cost of a keypoint that moves, because keypoints of a face lie together.
const MOVED_COST: f64 = 0.03;
/// Smallest decrease of the cost of a keypoint that counts as moved.
const MIN_MOVED_GAIN: f64 = 0.1;
/// Fewest moved keypoints: fewer are errors of a network.
const MIN_MOVED: usize = 4;
/// Fewest comparisons of two keypoints for a mean.
const MIN_COMPARED: usize = 4;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct KeypointOrder {
    /// Per keypoint of the network the place where the camera has it.
    pub(super) places: Vec<usize>,
    /// How many have surely moved.
    pub(super) moved: usize,
    /// Whether only left and right are exchanged.
    pub(super) sides: bool,
}

/// The order of the keypoints of `own` that fits these others best; `None` if it is that of the names.
pub(super) fn keypoint_order(
    own: &CameraRays,
    others: &[&CameraRays],
    partners: &Partners,
) -> Option<KeypointOrder> {
    let mut costs = Costs::none(partners.len());
    for other in others {
        for (bodies, theirs) in own.of_pass.iter().zip(&other.of_pass) {
            let middles: Vec<Vector3<f64>> = theirs.iter().map(|body| middle(body)).collect();
            for body in bodies.iter().take(MAX_COMPARED) {
                let middle = middle(body);
                // The middle of a body does not depend on the order.
                let gap_m = |them: &Vector3<f64>| {
                    let met = meeting((own.center_m(), &middle), (other.center_m(), them));
                    met.map_or(f64::INFINITY, |met| met.gap_m)
                };
                let gaps_m = theirs.iter().zip(middles.iter().map(gap_m));
                let nearest = gaps_m.min_by(|a, b| a.1.total_cmp(&b.1));
                let nearest = nearest.map(|(body, _)| body);
                for (keypoint, direction) in nearest.into_iter().flatten().enumerate() {
                    for (place, shown) in body.iter().enumerate() {
                        let met = meeting((other.center_m(), direction), (own.center_m(), shown));
                        if let Some(met) = met {
                            costs.add(keypoint, place, cost(met.gap_m));
                        }
                    }
                }
            }
        }
    }
    costs.order(partners)
}

/// Costs of taking keypoints for each other: sum and count per keypoint of the network and place in the camera.
struct Costs {
    n: usize,
    cells: Vec<(f64, usize)>,
}

impl Costs {
    fn none(n: usize) -> Self {
        Self {
            n,
            cells: vec![(0.0, 0); n * n],
        }
    }

    fn add(&mut self, keypoint: usize, place: usize, cost: f64) {
        let both = keypoint < self.n && place < self.n;
        let cell = self.cells.get_mut(keypoint * self.n + place);
        if let Some((sum, compared)) = cell.filter(|_| both) {
            *sum += cost;
            *compared += 1;
        }
    }

    fn mean(&self, keypoint: usize, place: usize) -> f64 {
        match self.cells[keypoint * self.n + place] {
            (sum, compared) if compared >= MIN_COMPARED => sum / compared as f64,
            _ => 1.0,
        }
    }

    /// The order of least cost; `None` if it is that of the names.
    fn order(&self, partners: &Partners) -> Option<KeypointOrder> {
        let cost = |keypoint: usize, place: usize| {
            self.mean(keypoint, place) + MOVED_COST * f64::from(u8::from(keypoint != place))
        };
        let places: Option<Vec<usize>> = assign(self.n, self.n, cost).into_iter().collect();
        let places = places?;
        let has_moved = |keypoint: usize| {
            let place = places[keypoint];
            let gain = self.mean(keypoint, keypoint) - self.mean(keypoint, place);
            place != keypoint && gain > MIN_MOVED_GAIN
        };
        let moved: Vec<usize> = (0..self.n).filter(|&k| has_moved(k)).collect();
        let sides = moved
            .iter()
            .all(|&keypoint| places[keypoint] == partners[keypoint]);
        (moved.len() >= MIN_MOVED).then_some(KeypointOrder {
            moved: moved.len(),
            sides,
            places,
        })
    }
}

/// The direction to the middle of a body.
fn middle(body: &[Vector3<f64>]) -> Vector3<f64> {
    let seen = body.iter().filter(|ray| ray.norm_squared() > 0.0);
    seen.map(Vector3::normalize).sum()
}
