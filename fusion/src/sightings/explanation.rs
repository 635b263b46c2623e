//! Which sightings a known body explains.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use rayon::prelude::*;

use crate::sightings::rays::{COSINE_ROUNDING, PARALLEL_FROM, SightedBody};
use crate::sightings::reconstruction::Reconstruction;

/// Least keypoints that a witness shares with a body to be explained by it.
const EXPLAINED_KEYPOINTS: usize = 3;

/// A known body at the tick of the sightings.
#[derive(Debug, Clone, PartialEq)]
pub struct KnownBody {
    /// Expected places of the network's keypoints, world metres, in the network's order.
    pub keypoints_m: Vec<Vector3<f64>>,
}

/// Known bodies, and which of the witnesses of a pass each explains.
#[derive(Debug, Clone)]
pub(crate) struct Explanation {
    pub(crate) bodies: Vec<KnownBody>,
    /// Per witness, the index of the body that explains it.
    pub(crate) by: Vec<Option<usize>>,
}

impl Explanation {
    /// Finds the witnesses that `bodies` explain. In one viewpoint each body explains one witness,
    /// the nearest: so a new person close to a tracked one is not mistaken for it.
    pub(crate) fn new(witnesses: &[SightedBody], bodies: Vec<KnownBody>, explained_m: f64) -> Self {
        Self {
            by: explained(witnesses, &bodies, explained_m),
            bodies,
        }
    }
}

fn explained(
    witnesses: &[SightedBody],
    tracked: &[KnownBody],
    explained_m: f64,
) -> Vec<Option<usize>> {
    let seen_of = |(t, body): (usize, &KnownBody)| {
        let (mut pairs, mut distances) = (Vec::new(), Vec::new());
        let mut ball = BodyBall::around(body, explained_m);
        for (w, witness) in witnesses.iter().enumerate() {
            if ball.is_out_of_reach(witness) {
                continue;
            }
            let distance = distance_below(explained_m, witness, body, &mut distances);
            pairs.extend(distance.map(|d| (d, t, w)));
        }
        pairs
    };
    // In either case the pairs are in the order of the bodies.
    let mut pairs: Vec<(f64, usize, usize)> = if witnesses.len() < PARALLEL_FROM {
        tracked.iter().enumerate().flat_map(seen_of).collect()
    } else {
        let bodies = tracked.par_iter().enumerate();
        bodies.flat_map_iter(seen_of).collect()
    };
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

/// A ball that a ray must touch to come near any keypoint of a body.
struct BodyBall {
    centre_m: Vector3<f64>,
    radius_m: f64,
    /// As seen by the camera with this index.
    seen: Option<(usize, SeenBall)>,
}

/// A ball as a camera sees it; `None` if the camera is inside.
type SeenBall = Option<BallOutline>;

#[derive(Clone, Copy)]
struct BallOutline {
    /// Unit direction to the ball's centre, world.
    direction: Vector3<f64>,
    /// Sine and cosine of the angle between its centre and its edge.
    sine_cosine: [f64; 2],
}

impl BodyBall {
    /// The ball of the rays that pass nearer than `limit_m` to any keypoint of `body`.
    fn around(body: &KnownBody, limit_m: f64) -> Self {
        let n = body.keypoints_m.len().max(1) as f64;
        let centre_m = body.keypoints_m.iter().sum::<Vector3<f64>>() / n;
        let off_m = body.keypoints_m.iter().map(|p| (p - centre_m).norm());
        // A keypoint that is NaN makes the ball NaN: then no witness is out of reach.
        let radius_m = limit_m + off_m.fold(0.0, f64::max);
        Self {
            centre_m,
            radius_m,
            seen: None,
        }
    }

    /// Whether all rays of `witness` certainly miss the ball; false is not certain.
    fn is_out_of_reach(&mut self, witness: &SightedBody) -> bool {
        let Some(cone) = &witness.cone else {
            return false;
        };
        let (_, seen) = match self.seen {
            Some(seen) if seen.0 == witness.camera => seen,
            _ => *self
                .seen
                .insert((witness.camera, self.outline(&cone.origin_m))),
        };
        let [sine, cosine] = cone.sine_cosine;
        seen.is_some_and(|ball| {
            let [ball_sine, ball_cosine] = ball.sine_cosine;
            // Cosine of the angle at which cone and ball touch from outside, which is less than a
            // half turn.
            let touching = cosine * ball_cosine - sine * ball_sine;
            cosine > 0.0 && cone.axis.dot(&ball.direction) < touching - COSINE_ROUNDING
        })
    }

    fn outline(&self, from_m: &Vector3<f64>) -> SeenBall {
        let to_centre_m = self.centre_m - from_m;
        let distance_m = to_centre_m.norm();
        let sine = self.radius_m / distance_m;
        (sine < 1.0).then(|| BallOutline {
            direction: to_centre_m / distance_m,
            sine_cosine: [sine, (1.0 - sine * sine).sqrt()],
        })
    }
}

/// Median distance of the rays of a witness from the keypoints of a tracked body, metres, if it is
/// below `limit_m`. Overwrites `distances`.
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
    // The upper median is below the limit if more than half of all are.
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::body::fixture::{Noise, standing};
    use crate::sightings::fixture::{hall, hall_of_sixteen};
    use crate::sightings::rays::witnesses;

    #[test]
    fn explanations_do_not_depend_on_other_viewpoints() {
        let (hall, mut noise) = (hall_of_sixteen(), Noise(3));
        let places_m: Vec<[f64; 2]> = (0..10)
            .map(|_| [6.0 * noise.uniform() - 3.0, 4.0 * noise.uniform() - 2.0])
            .collect();
        let bodies = places_m
            .iter()
            .map(|&[x, y]| standing(x, y, 1.7, &mut noise));
        let bodies: Vec<Vec<Vector3<f64>>> = bodies.collect();
        let sightings = hall.sightings(&bodies, 5.0, &mut noise);
        let all = witnesses(&sightings, &hall.cameras, 17, 0.1);
        assert!(all.len() >= PARALLEL_FROM, "{}", all.len());
        let known: Vec<KnownBody> = bodies[..8]
            .iter()
            .map(|body| KnownBody {
                keypoints_m: body.clone(),
            })
            .collect();
        let mut alone = Vec::new();
        for (viewpoint, _) in &hall.cameras {
            let own: Vec<_> = sightings
                .iter()
                .filter(|sighting| hall.cameras[usize::from(sighting.camera.0)].0 == *viewpoint)
                .cloned()
                .collect();
            let own = witnesses(&own, &hall.cameras, 17, 0.1);
            alone.extend(Explanation::new(&own, known.clone(), 0.3).by);
        }
        assert!(alone.iter().flatten().count() > PARALLEL_FROM / 2);
        for threads in [1, 2, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let together = pool.unwrap().install(|| {
                let all = witnesses(&sightings, &hall.cameras, 17, 0.1);
                Explanation::new(&all, known.clone(), 0.3).by
            });
            assert_eq!(together, alone, "{threads} threads");
        }
    }

    proptest! {
        #[test]
        fn a_witness_out_of_reach_is_far_from_every_keypoint(seed in any::<u64>(), limit_m in 0.0f64..3.0) {
            let (hall, mut noise) = (hall(), Noise(seed));
            let mut within = |half_m: f64| half_m * (2.0 * noise.uniform() - 1.0);
            let places_m = [[within(5.0), within(4.0)], [within(5.0), within(4.0)]];
            let bodies = places_m.map(|[x, y]| standing(x, y, 1.7, &mut noise));
            let sightings = hall.sightings(&bodies, 5.0, &mut noise);
            let all = witnesses(&sightings, &hall.cameras, 17, 0.1);
            for keypoints_m in bodies {
                let body = KnownBody { keypoints_m };
                let mut ball = BodyBall::around(&body, limit_m);
                for witness in all.iter().filter(|&witness| ball.is_out_of_reach(witness)) {
                    let pairs = witness.rays.iter().zip(&body.keypoints_m);
                    let nearest_m = pairs
                        .filter_map(|(ray, point_m)| Some(ray.as_ref()?.distance_m(point_m)))
                        .fold(f64::INFINITY, f64::min);
                    prop_assert!(nearest_m >= limit_m, "{nearest_m} m");
                }
            }
        }
    }
}
