//! Which sightings are explained by somebody who is known already.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use crate::sightings::rays::SightedBody;
use crate::sightings::reconstruction::Reconstruction;

/// Least keypoints that a witness shares with a body to be explained by it.
const EXPLAINED_KEYPOINTS: usize = 3;

/// A body that is known already, at the tick of the sightings.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownBody {
    /// Where the keypoints of the network are expected, world metres, in the network's order.
    pub keypoints_m: Vec<Vector3<f64>>,
}

/// Per witness, which of the `tracked` bodies it sees, if any. In one viewpoint each body explains one witness, the
/// nearest: somebody new who stands close to a tracked person is not mistaken for it.
pub(crate) fn explained(
    witnesses: &[SightedBody],
    tracked: &[KnownBody],
    explained_m: f64,
) -> Vec<Option<usize>> {
    let (mut pairs, mut distances) = (Vec::new(), Vec::new());
    for (t, body) in tracked.iter().enumerate() {
        for (w, witness) in witnesses.iter().enumerate() {
            let distance = distance_below(explained_m, witness, body, &mut distances);
            pairs.extend(distance.map(|d| (d, t, w)));
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut explained = vec![None; witnesses.len()];
    let mut used = BTreeSet::new();
    for (_, t, w) in pairs {
        if explained[w].is_none() && used.insert((t, witnesses[w].viewpoint)) {
            explained[w] = Some(t);
        }
    }
    explained
}

/// Median distance of the rays of a witness from the keypoints of a tracked body, metres, where it is below `limit_m`.
/// `distances` is overwritten.
fn distance_below(
    limit_m: f64,
    witness: &SightedBody,
    body: &KnownBody,
    distances: &mut Vec<f64>,
) -> Option<f64> {
    let rays = witness.rays.iter().zip(&body.keypoints_m);
    let n = rays.clone().filter(|(ray, _)| ray.is_some()).count();
    if n < EXPLAINED_KEYPOINTS {
        return None;
    }
    // The upper median is below the limit when more than half of all are.
    let mut may_be_far = n - (n / 2 + 1);
    distances.clear();
    for (ray, point_m) in rays {
        let Some(ray) = ray else { continue };
        let distance_m = ray.distance_m(point_m);
        distances.push(distance_m);
        if distance_m < limit_m {
            continue;
        }
        if may_be_far == 0 {
            return None;
        }
        may_be_far -= 1;
    }
    distances.sort_by(f64::total_cmp);
    distances.get(n / 2).copied()
}

/// Mean distance of the keypoints of a group from those of a tracked body, metres.
pub(crate) fn body_distance_m(group: &Reconstruction, body: &KnownBody) -> Option<f64> {
    let pairs = group.keypoints_m.iter().zip(&body.keypoints_m);
    let distances: Vec<f64> = pairs
        .filter_map(|(point, tracked)| Some((point.as_ref()?.position_m - tracked).norm()))
        .collect();
    (!distances.is_empty()).then(|| distances.iter().sum::<f64>() / distances.len() as f64)
}
