//! The body that a group of witnesses sees, if they see one at all.

use nalgebra::{Matrix3, Vector3};

use crate::sightings::rays::{SightedBody, SightedRay};

/// Least angle between two rays of a keypoint, radians (8 degrees): below it a pixel of noise moves
/// the point along the rays by more than a limb.
const MIN_ANGLE_RAD: f64 = 0.14;

/// Distance below which a camera does not get more weight for being near, metres.
const NEAREST_M: f64 = 0.1;

/// A keypoint in space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SightedKeypoint {
    /// World metres.
    pub position_m: Vector3<f64>,
    /// Mean score of the peaks that it was made from, 0 to 1.
    pub score: f64,
    /// How many viewpoints agree on it.
    pub views: u16,
}

/// What a group of witnesses agrees on.
#[derive(Debug, Clone)]
pub(crate) struct Reconstruction {
    /// Indices of the witnesses that agree, ascending.
    pub(crate) members: Vec<usize>,
    /// Per keypoint of the network.
    pub(crate) keypoints_m: Vec<Option<SightedKeypoint>>,
    /// Agreeing rays, each counted less the farther it passes from its point.
    pub(crate) support: f64,
}

/// Triangulates the keypoints that `members` have in common, leaving out rays that pass farther
/// than `gate_m` from the point, and members that are left with fewer than `min_keypoints` rays.
///
/// `None` when fewer than two members, or fewer than `min_keypoints` points, remain.
pub(crate) fn reconstruct(
    witnesses: &[SightedBody],
    members: &[usize],
    gate_m: f64,
    min_keypoints: usize,
) -> Option<Reconstruction> {
    let mut members = members.to_vec();
    let n_keypoints = witnesses.get(*members.first()?)?.rays.len();
    loop {
        if members.len() < 2 {
            return None;
        }
        let mut points = Vec::with_capacity(n_keypoints);
        for k in 0..n_keypoints {
            let rays: Vec<&SightedRay> = members
                .iter()
                .filter_map(|&m| witnesses[m].rays[k].as_ref())
                .collect();
            points.push(agreed_point(rays, gate_m));
        }
        let worst = members
            .iter()
            .enumerate()
            .map(|(at, &m)| (at, member_rays(&witnesses[m], &points, gate_m)))
            .min_by_key(|&(_, agreeing)| agreeing)?;
        if worst.1 < min_keypoints {
            members.remove(worst.0);
            continue;
        }
        return Some(summary(witnesses, members, points, gate_m));
    }
}

/// How many rays of `witness` pass within `gate_m` of their points.
fn member_rays(witness: &SightedBody, points: &[Option<SightedKeypoint>], gate_m: f64) -> usize {
    distances(witness, points).filter(|&d| d <= gate_m).count()
}

/// Distances of the rays of `witness` from the points that exist.
pub(crate) fn distances<'a>(
    witness: &'a SightedBody,
    points: &'a [Option<SightedKeypoint>],
) -> impl Iterator<Item = f64> + 'a {
    witness
        .rays
        .iter()
        .zip(points)
        .filter_map(|(ray, point)| Some(ray.as_ref()?.distance_m(&point.as_ref()?.position_m)))
}

fn summary(
    witnesses: &[SightedBody],
    members: Vec<usize>,
    keypoints_m: Vec<Option<SightedKeypoint>>,
    gate_m: f64,
) -> Reconstruction {
    let support = members
        .iter()
        .flat_map(|&m| distances(&witnesses[m], &keypoints_m))
        .map(|d| (1.0 - (d / gate_m).powi(2)).max(0.0))
        .sum();
    Reconstruction {
        members,
        keypoints_m,
        support,
    }
}

/// The point that at least two of `rays` agree on; of more than two, the ray without which the
/// others agree best is dropped until all pass within `gate_m`.
fn agreed_point(rays: Vec<&SightedRay>, gate_m: f64) -> Option<SightedKeypoint> {
    let bundle = RayBundle::of(rays);
    let mut kept: Vec<usize> = (0..bundle.rays.len()).collect();
    let mut others = Vec::with_capacity(kept.len());
    let mut best = bundle.meeting(&kept)?;
    while best.worst_m > gate_m {
        if kept.len() == 2 {
            return None;
        }
        let without = (0..kept.len()).filter_map(|dropped| {
            others.clear();
            others.extend_from_slice(&kept[..dropped]);
            others.extend_from_slice(&kept[dropped + 1..]);
            Some((bundle.meeting(&others)?, dropped))
        });
        // Flat angles make rays pass near each other whatever they show, so they count for less.
        let doubt = |m: &RayMeeting| m.worst_m / m.sine;
        let (meeting, dropped) = without.min_by(|a, b| doubt(&a.0).total_cmp(&doubt(&b.0)))?;
        best = meeting;
        kept.remove(dropped);
    }
    let score = kept.iter().map(|&r| bundle.rays[r].score).sum::<f64>() / kept.len() as f64;
    Some(SightedKeypoint {
        position_m: best.point_m,
        score,
        views: kept.len() as u16,
    })
}

/// Where rays meet, more or less.
struct RayMeeting {
    point_m: Vector3<f64>,
    /// Largest distance of a ray from the point, metres.
    worst_m: f64,
    /// Sine of the widest angle between two of the rays.
    sine: f64,
}

/// The rays of one keypoint, with what all of their subsets share.
struct RayBundle<'a> {
    rays: Vec<&'a SightedRay>,
    /// I - d dᵀ of each ray.
    across: Vec<Matrix3<f64>>,
    /// Per ray, the sines of its angles to those before it.
    sines: Vec<Vec<f64>>,
}

impl<'a> RayBundle<'a> {
    fn of(rays: Vec<&'a SightedRay>) -> Self {
        let across =
            |ray: &&SightedRay| Matrix3::identity() - ray.direction * ray.direction.transpose();
        let sines = |(n, ray): (usize, &&SightedRay)| {
            let before = rays[..n].iter();
            before
                .map(|other| other.direction.cross(&ray.direction).norm())
                .collect()
        };
        Self {
            across: rays.iter().map(across).collect(),
            sines: rays.iter().enumerate().map(sines).collect(),
            rays,
        }
    }

    /// The nearest point to the rays `of` these indices, ascending; `None` when they are too few or nearly parallel,
    /// or meet behind a camera.
    fn meeting(&self, of: &[usize]) -> Option<RayMeeting> {
        let before = |(n, &r): (usize, &usize)| {
            let others = of[..n].iter();
            others.fold(0.0_f64, |widest, &other| widest.max(self.sines[r][other]))
        };
        let sine = of.iter().enumerate().map(before).fold(0.0, f64::max);
        if sine < libm::sin(MIN_ANGLE_RAD) {
            return None;
        }
        let even = self.nearest_point(of, |_| 1.0)?;
        // An error of a pixel is an error in metres that grows with the distance, so near cameras
        // decide; one repetition is enough for the distances to be known.
        let trust = |ray: &SightedRay| ray.depth_m(&even).max(NEAREST_M).powi(-2);
        let point_m = self.nearest_point(of, trust)?;
        let rays = of.iter().map(|&r| self.rays[r]);
        let in_front = rays.clone().all(|ray| ray.depth_m(&point_m) > 0.0);
        let worst_m = rays.map(|ray| ray.distance_m(&point_m)).fold(0.0, f64::max);
        in_front.then_some(RayMeeting {
            point_m,
            worst_m,
            sine,
        })
    }

    /// The point with the least weighted sum of squared distances from the rays `of` these indices.
    ///
    /// ```text
    ///   (sum w P) x = sum w P o,   P = I - d d'      w = score times `trust`
    /// ```
    fn nearest_point(
        &self,
        of: &[usize],
        trust: impl Fn(&SightedRay) -> f64,
    ) -> Option<Vector3<f64>> {
        let mut a = Matrix3::zeros();
        let mut b = Vector3::zeros();
        for &r in of {
            let ray = self.rays[r];
            let p = self.across[r] * (ray.score * trust(ray));
            a += p;
            b += p * ray.origin_m;
        }
        let x = a.cholesky()?.solve(&b);
        x.iter().all(|v| v.is_finite()).then_some(x)
    }
}
