//! Whether the keypoints of a camera are in another order than those of the others: a file that another program wrote, or
//! left and right confused.
//!
//! Of the people whom cameras show, every keypoint of one is compared with every keypoint of the others. The assignment of least
//! cost says which is which; where it is not the one of the names, the order is another.

use nalgebra::Vector3;

use super::super::geometry::meeting;
use super::super::pairs::{CameraRays, Partners, cost};
use super::super::samples::MAX_COMPARED;
use crate::assign::assign;

/// What it costs to take a keypoint for another: those of a face lie together.
const MOVED_COST: f64 = 0.03;
/// By how much less a keypoint must cost in its other place to count as one that has moved.
const MOVED_GAIN: f64 = 0.1;
/// Least keypoints that have moved: fewer are a network's confusions.
const MIN_MOVED: usize = 4;
/// Least comparisons of two keypoints that tell.
const MIN_COMPARED: usize = 4;

/// In which order the keypoints of a camera are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct KeypointOrder {
    /// Per keypoint of the network the one that the camera has in its place.
    pub(super) of: Vec<usize>,
    /// How many are elsewhere for certain.
    pub(super) moved: usize,
    /// Whether left and right are exchanged, and nothing else.
    pub(super) sides: bool,
}

/// The order of the keypoints of `own` that fits these others best; `None` where it is that of the names.
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
                // Whatever the order, a middle is one.
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
                            costs.add((keypoint, place), cost(met.gap_m));
                        }
                    }
                }
            }
        }
    }
    costs.order(partners)
}

/// What it costs to take keypoints for each other: per keypoint of the network and place in which a camera has one, the
/// sum and how many there are.
struct Costs {
    n: usize,
    of: Vec<(f64, usize)>,
}

impl Costs {
    fn none(n: usize) -> Self {
        Self {
            n,
            of: vec![(0.0, 0); n * n],
        }
    }

    fn add(&mut self, (keypoint, place): (usize, usize), cost: f64) {
        let both = keypoint < self.n && place < self.n;
        let cell = self.of.get_mut(keypoint * self.n + place);
        if let Some((sum, compared)) = cell.filter(|_| both) {
            *sum += cost;
            *compared += 1;
        }
    }

    fn mean(&self, (keypoint, place): (usize, usize)) -> f64 {
        match self.of[keypoint * self.n + place] {
            (sum, compared) if compared >= MIN_COMPARED => sum / compared as f64,
            _ => 1.0,
        }
    }

    /// The order of least cost; `None` where it is that of the names.
    fn order(&self, partners: &Partners) -> Option<KeypointOrder> {
        let with_names = |keypoint: usize, place: usize| {
            self.mean((keypoint, place)) + MOVED_COST * f64::from(u8::from(keypoint != place))
        };
        let of: Option<Vec<usize>> = assign(self.n, self.n, with_names).into_iter().collect();
        let of = of?;
        let has_moved = |keypoint: usize| {
            let place = of[keypoint];
            let gain = self.mean((keypoint, keypoint)) - self.mean((keypoint, place));
            place != keypoint && gain > MOVED_GAIN
        };
        let moved: Vec<usize> = (0..self.n).filter(|&k| has_moved(k)).collect();
        let sides = moved
            .iter()
            .all(|&keypoint| of[keypoint] == partners[keypoint]);
        (moved.len() >= MIN_MOVED).then_some(KeypointOrder {
            moved: moved.len(),
            sides,
            of,
        })
    }
}

/// Where the middle of a body is seen.
fn middle(body: &[Vector3<f64>]) -> Vector3<f64> {
    let seen = body.iter().filter(|ray| ray.norm_squared() > 0.0);
    seen.map(Vector3::normalize).sum()
}
