//! The relative pose of two cameras from people that both saw, without identities.
//!
//! Feet propose ([`super::floor_match`]) and whole bodies decide: for each proposal bodies are paired, and the pose is
//! refined on all keypoints of the pairs, by their distances to the epipolar lines.

use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::floor_match::{Effort, Feet, PlaneMotion, motions};
use super::ground::Ground;
use crate::geometry::{
    RelativePose, TwoViews, refined_pose, relative_pose, sampson_rad, triangulate,
};
use crate::people::plan::{ANKLE_TO_SHOULDER, BodyPlan, KEYPOINT_M, KEYPOINT_PX};
use crate::people::view::{Body, View};
use farfield_proto::order_statistics::upper_median;

/// Least number of bodies seen by both cameras.
pub(in crate::people) const LEAST_MATCHED: usize = 20;
/// Largest mean loss of the keypoints of a pair (0: all fit, 1: none).
const MOST_LOSS: f64 = 0.55;
/// Most ticks that are compared.
const MOST_TICKS: usize = 120;
/// Least number of keypoints that two bodies share.
const LEAST_KEYPOINTS: usize = 6;
/// Bodies with a larger mean loss are different.
const MOST_BODY_LOSS: f64 = 0.5;
/// Gates for pairing bodies in successive rounds, standard deviations: starts are rough.
const GATES: [f64; 4] = [16.0, 8.0, 4.0, 3.0];
/// Largest distance of the feet of one body in two cameras: a constant part.
const FOOT_GATE_M: f64 = 0.6;
/// The part that is relative to the distances from both cameras.
const FOOT_GATE_SHARE: f64 = 0.10;
/// Most keypoints for refinement.
const MOST_PAIRS: usize = 1500;
/// Samples of five keypoints.
const SAMPLES: usize = 60;
/// Parallax above which a pair does not improve, radians.
const ENOUGH_PARALLAX_RAD: f64 = 0.5;

/// One camera, prepared for comparison.
#[derive(Debug, Clone)]
pub(in crate::people) struct Walkers<'a> {
    pub(in crate::people) view: &'a View,
    pub(in crate::people) ground: Ground,
    pub(in crate::people) feet: Feet,
}

impl<'a> Walkers<'a> {
    pub(in crate::people) fn new(
        view: &'a View,
        ground: Ground,
        plan: &BodyPlan,
        stature_m: f64,
    ) -> Self {
        let ticks = view.ticks.iter().map(|(tick, bodies)| {
            let feet = bodies
                .iter()
                .filter_map(|body| Some((body.tracklet, ground.foot_m(body, plan, stature_m)?)));
            (*tick, feet.collect())
        });
        Self {
            view,
            ground,
            feet: ticks.collect(),
        }
    }
}

/// The pose of the second camera relative to the first: `x_b = rotation x_a + shift_m`.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::people) struct Pair {
    pub(in crate::people) first: usize,
    pub(in crate::people) second: usize,
    pub(in crate::people) rotation: UnitQuaternion<f64>,
    pub(in crate::people) shift_m: Vector3<f64>,
    /// Number of paired bodies, from at most 120 ticks.
    pub(in crate::people) matched: usize,
    /// Mean loss of their keypoints, 0 to 1.
    pub(in crate::people) loss: f64,
    /// Median angle between the two rays of a keypoint.
    pub(in crate::people) parallax_rad: f64,
}

impl Pair {
    pub(in crate::people) fn is_sound(&self) -> bool {
        self.matched >= LEAST_MATCHED && self.loss < MOST_LOSS
    }

    /// Its weight among pairs.
    pub(in crate::people) fn worth(&self) -> f64 {
        let parallax = self.parallax_rad.clamp(0.02, ENOUGH_PARALLAX_RAD);
        self.matched as f64 * (1.0 - self.loss) * parallax
    }
}

/// All pairs of `walkers` (by the index of their camera) with common bodies.
pub(in crate::people) fn all_pairs(
    walkers: &[Option<Walkers<'_>>],
    plan: &BodyPlan,
    stature_m: f64,
    seed: u64,
) -> Vec<Pair> {
    let indices: Vec<(usize, usize)> = (0..walkers.len())
        .flat_map(|i| (i + 1..walkers.len()).map(move |j| (i, j)))
        .collect();
    // Each pair has its own random numbers, so that the order of the threads does not matter.
    indices
        .into_par_iter()
        .filter_map(|(i, j)| {
            let (a, b) = (walkers[i].as_ref()?, walkers[j].as_ref()?);
            let seed = seed ^ ((i as u64) << 32 | j as u64);
            Some(Pair {
                first: i,
                second: j,
                ..pair(a, b, plan, stature_m, seed)?
            })
        })
        .collect()
}

/// The pose of `b` relative to `a`; the indices are zero.
pub(in crate::people) fn pair(
    a: &Walkers<'_>,
    b: &Walkers<'_>,
    plan: &BodyPlan,
    stature_m: f64,
    seed: u64,
) -> Option<Pair> {
    let proposals = motions(&a.feet, &b.feet, 0, Effort::FULL, seed);
    let found = proposals
        .iter()
        .filter_map(|motion| refined(a, b, motion, plan, stature_m, seed));
    found.max_by(|x, y| {
        let worth = |pair: &Pair| pair.matched as f64 * (1.0 - pair.loss);
        worth(x).total_cmp(&worth(y))
    })
}

/// The pose of `b` relative to `a` if their floors are related by `motion`, metres.
fn pose_from_motion(
    a: &Ground,
    b: &Ground,
    motion: &PlaneMotion,
) -> (UnitQuaternion<f64>, Vector3<f64>) {
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), motion.angle_rad);
    let camera_from_ground = b.ground_from_camera.inverse();
    let shift = Vector3::new(motion.shift_m.x, motion.shift_m.y, a.height_m - b.height_m);
    (
        camera_from_ground * turn * a.ground_from_camera,
        camera_from_ground * shift,
    )
}

/// Standard deviation of a keypoint's direction, radians: the larger one of both cameras, by the median distance of feet.
fn sigma_rad(a: &Walkers<'_>, b: &Walkers<'_>) -> f64 {
    let own = |it: &Walkers<'_>| {
        let feet = it.feet.values().flatten();
        let distances = feet.map(|(_, at)| libm::hypot(at.norm(), it.ground.height_m));
        let distance_m = upper_median(distances.collect()).unwrap_or(5.0).max(1.0);
        KEYPOINT_M / distance_m + KEYPOINT_PX / it.view.focal_px()
    };
    own(a).max(own(b))
}

fn refined(
    a: &Walkers<'_>,
    b: &Walkers<'_>,
    motion: &PlaneMotion,
    plan: &BodyPlan,
    stature_m: f64,
    seed: u64,
) -> Option<Pair> {
    let sigma_rad = sigma_rad(a, b);
    let (rotation, shift_m) = pose_from_motion(&a.ground, &b.ground, motion);
    let mut pose = (rotation, shift_m.try_normalize(1e-3)?);
    let mut best: Option<RelativePose> = None;
    let mut matches = Vec::new();
    for gate in GATES {
        let gate_rad = gate * sigma_rad;
        matches = matched(a, b, motion, plan, stature_m, &pose, gate_rad);
        let pairs = keypoints(&matches);
        let mut found = refined_pose(&pose, &pairs, gate_rad);
        if gate <= 4.0 {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            let fresh = relative_pose(&pairs, gate_rad, SAMPLES, &mut rng);
            let is_better = |it: &RelativePose| found.as_ref().is_none_or(|old| it.loss < old.loss);
            if let Some(fresh) = fresh.filter(|it| is_better(it)) {
                found = Some(fresh);
            }
        }
        let found = found?;
        pose = (found.rotation, found.translation);
        best = Some(found);
    }
    let best = best?;
    let baseline_m = baseline_m(&matches, &pose, plan, stature_m).unwrap_or(shift_m.norm());
    Some(Pair {
        first: 0,
        second: 0,
        rotation: pose.0,
        shift_m: pose.1 * baseline_m,
        matched: matches.len(),
        loss: best.loss,
        parallax_rad: best.parallax_rad,
    })
}

/// Pairs of bodies with the least loss under `pose` and with near feet under `motion`; each body is in one pair.
fn matched<'a>(
    a: &'a Walkers<'_>,
    b: &'a Walkers<'_>,
    motion: &PlaneMotion,
    plan: &BodyPlan,
    stature_m: f64,
    pose: &(UnitQuaternion<f64>, Vector3<f64>),
    gate_rad: f64,
) -> Vec<(&'a Body, &'a Body)> {
    let e = pose.1.cross_matrix() * pose.0.to_rotation_matrix().matrix();
    let (from, to) = (&a.view.ticks, &b.view.ticks);
    let ticks: Vec<i64> = from
        .keys()
        .filter(|t| to.contains_key(t))
        .copied()
        .collect();
    let stride = ticks.len().div_ceil(MOST_TICKS).max(1);
    let foot = |walkers: &Walkers<'_>, body: &Body| walkers.ground.foot_m(body, plan, stature_m);
    let is_near = |at_a: Option<Vector2<f64>>, at_b: Option<Vector2<f64>>| {
        let (Some(at_a), Some(at_b)) = (at_a, at_b) else {
            return true;
        };
        let gate_m = FOOT_GATE_M + FOOT_GATE_SHARE * (at_a.norm() + at_b.norm());
        (motion.apply(&at_a) - at_b).norm() < gate_m
    };
    let mut found = Vec::new();
    for tick in ticks.iter().step_by(stride) {
        let (Some(own), Some(others)) = (from.get(tick), to.get(tick)) else {
            continue;
        };
        let mut losses = Vec::new();
        for (i, x) in own.iter().enumerate() {
            let at_a = foot(a, x);
            for (j, y) in others.iter().enumerate() {
                if !is_near(at_a, foot(b, y)) {
                    continue;
                }
                if let Some(loss) = body_loss(&e, x, y, gate_rad) {
                    losses.push((loss, i, j));
                }
            }
        }
        losses.sort_by(|x, y| x.0.total_cmp(&y.0));
        let (mut used_a, mut used_b) = (vec![false; own.len()], vec![false; others.len()]);
        for (_, i, j) in losses {
            if !used_a[i] && !used_b[j] {
                (used_a[i], used_b[j]) = (true, true);
                found.push((&own[i], &others[j]));
            }
        }
    }
    found
}

/// Mean loss of the keypoints that two bodies share; `None` if they are different bodies.
fn body_loss(e: &nalgebra::Matrix3<f64>, x: &Body, y: &Body, gate_rad: f64) -> Option<f64> {
    let both = x.joints.iter().zip(&y.joints);
    let both = both.filter_map(|(x, y)| Some((x.as_ref()?.bearing, y.as_ref()?.bearing)));
    let (mut total, mut count) = (0.0, 0);
    for pair in both {
        let d = sampson_rad(e, &pair) / gate_rad;
        total += (d * d).min(1.0);
        count += 1;
    }
    let loss = total / f64::from(count.max(1));
    (count as usize >= LEAST_KEYPOINTS && loss < MOST_BODY_LOSS).then_some(loss)
}

/// At most 1,500 evenly spaced keypoints of paired bodies.
fn keypoints(matches: &[(&Body, &Body)]) -> Vec<TwoViews> {
    let each = matches.iter().flat_map(|(x, y)| {
        let both = x.joints.iter().zip(&y.joints);
        both.filter_map(|(x, y)| Some((x.as_ref()?.bearing, y.as_ref()?.bearing)))
    });
    let all: Vec<TwoViews> = each.collect();
    let stride = all.len().div_ceil(MOST_PAIRS).max(1);
    all.into_iter().step_by(stride).collect()
}

/// The distance of the pinholes at which bodies have their usual length from ankles to shoulders.
fn baseline_m(
    matches: &[(&Body, &Body)],
    (rotation, translation): &(UnitQuaternion<f64>, Vector3<f64>),
    plan: &BodyPlan,
    stature_m: f64,
) -> Option<f64> {
    let center = -(rotation.inverse() * translation);
    let meet = |x: &Body, y: &Body, indices: &[usize]| {
        let a = x.bearing_of_all(indices)?;
        let b = rotation.inverse() * y.bearing_of_all(indices)?;
        Some(triangulate(&[(Vector3::zeros(), a), (center, b)], 0.05)?.0)
    };
    let lengths = matches.iter().filter_map(|(x, y)| {
        let ankles = meet(x, y, &plan.ankles)?;
        let shoulders = meet(x, y, &plan.shoulders)?;
        Some((shoulders - ankles).norm())
    });
    let lengths: Vec<f64> = lengths.collect();
    if lengths.len() < LEAST_MATCHED / 2 {
        return None;
    }
    let length = upper_median(lengths).filter(|length| *length > 1e-6)?;
    Some(ANKLE_TO_SHOULDER * stature_m / length)
}
