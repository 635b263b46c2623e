//! Matches bodies of all cameras at one tick by whole bodies, once poses are known.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::plan::{KEYPOINT_M, KEYPOINT_PX};
use super::view::{Body, View};
use crate::adjustment::CameraState;
use crate::geometry::{Sight, triangulate};

/// Least number of keypoints that two bodies share.
const LEAST_KEYPOINTS: usize = 6;
/// Bodies with a larger mean loss are different.
const MOST_LOSS: f64 = 0.5;
/// Sine of the angle of two rays below which they do not determine the depth.
const LEAST_SINE: f64 = 0.02;
/// Largest depth of a keypoint, metres.
const MOST_DEPTH_M: f64 = 500.0;
/// Least number of keypoints of a person.
const LEAST_JOINTS: usize = 6;
/// Largest median distance of a person's keypoints from their middle, metres.
const MOST_SIZE_M: f64 = 1.3;

/// A body that several cameras saw at one tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Person {
    pub(super) tick: i64,
    /// The cameras that saw it, each with the index of the body among those of the tick.
    pub(super) members: Vec<(usize, usize)>,
    /// Position of each keypoint on which at least two cameras agree, metres.
    pub(super) joints_m: Vec<Option<Vector3<f64>>>,
}

/// A body of a posed camera.
struct Candidate<'a> {
    camera: usize,
    index: usize,
    center_m: Vector3<f64>,
    /// Standard deviation of a pixel, radians.
    px_rad: f64,
    body: &'a Body,
    /// Direction of each keypoint in the world.
    sights: Vec<Option<Vector3<f64>>>,
}

/// The persons of a tick that at least two posed cameras saw. `gate` is in standard deviations of a keypoint.
pub(super) fn persons(
    views: &[View],
    cameras: &[Option<CameraState>],
    tick: i64,
    gate: f64,
) -> Vec<Person> {
    let candidates = candidates(views, cameras, tick);
    let mut losses = Vec::new();
    for (i, a) in candidates.iter().enumerate() {
        for (j, b) in candidates.iter().enumerate().skip(i + 1) {
            if a.camera != b.camera
                && let Some(loss) = loss(a, b, gate).filter(|loss| *loss < MOST_LOSS)
            {
                losses.push((loss, i, j));
            }
        }
    }
    losses.sort_by(|x, y| x.0.total_cmp(&y.0));
    let clusters = clusters(&candidates, &losses);
    let found = clusters
        .into_iter()
        .filter_map(|cluster| person(&candidates, &cluster, tick, gate));
    found.collect()
}

fn candidates<'a>(
    views: &'a [View],
    cameras: &[Option<CameraState>],
    tick: i64,
) -> Vec<Candidate<'a>> {
    let mut found = Vec::new();
    for (camera, (view, state)) in views.iter().zip(cameras).enumerate() {
        let (Some(state), Some(bodies)) = (state, view.ticks.get(&tick)) else {
            continue;
        };
        let back = state.camera_from_world.inverse();
        for (index, body) in bodies.iter().enumerate() {
            let joints = body.joints.iter();
            found.push(Candidate {
                camera,
                index,
                center_m: state.center_w,
                px_rad: KEYPOINT_PX / view.focal_px(),
                body,
                sights: joints.map(|j| j.map(|j| back * j.bearing)).collect(),
            });
        }
    }
    found
}

/// Mean loss of the distances between the rays of shared keypoints; `None` if too few are shared.
fn loss(a: &Candidate<'_>, b: &Candidate<'_>, gate: f64) -> Option<f64> {
    let between = b.center_m - a.center_m;
    let (mut total, mut count) = (0.0, 0);
    for (x, y) in a.sights.iter().zip(&b.sights) {
        let (Some(x), Some(y)) = (x, y) else { continue };
        count += 1;
        let normal = x.cross(y);
        let sine2 = normal.norm_squared();
        if sine2 < LEAST_SINE * LEAST_SINE {
            total += 1.0;
            continue;
        }
        let depth_a = between.cross(y).dot(&normal) / sine2;
        let depth_b = between.cross(x).dot(&normal) / sine2;
        if !(depth_a > 0.0 && depth_b > 0.0 && depth_a < MOST_DEPTH_M && depth_b < MOST_DEPTH_M) {
            total += 1.0;
            continue;
        }
        let apart_m = between.dot(&normal).abs() / sine2.sqrt();
        // Both keypoints are noisy.
        let sigma_m = 1.5 * KEYPOINT_M + a.px_rad * depth_a + b.px_rad * depth_b;
        let d = apart_m / (gate * sigma_m);
        total += (d * d).min(1.0);
    }
    (count >= LEAST_KEYPOINTS).then(|| total / count as f64)
}

/// Clusters of bodies with at most one per camera, joined in the order of increasing loss. Two clusters are joined if at least
/// two thirds of the pairs between them fit.
fn clusters(candidates: &[Candidate<'_>], losses: &[(f64, usize, usize)]) -> Vec<Vec<usize>> {
    let mut cluster_of: Vec<usize> = (0..candidates.len()).collect();
    let mut clusters: Vec<Vec<usize>> = (0..candidates.len()).map(|i| vec![i]).collect();
    let fitting: BTreeSet<(usize, usize)> = losses.iter().map(|(_, a, b)| (*a, *b)).collect();
    let fits = |i: usize, j: usize| fitting.contains(&(i.min(j), i.max(j)));
    for (_, i, j) in losses {
        let (a, b) = (cluster_of[*i], cluster_of[*j]);
        if a == b {
            continue;
        }
        let pairs = clusters[a]
            .iter()
            .flat_map(|x| clusters[b].iter().map(move |y| (*x, *y)));
        let (mut fitting, mut all) = (0, 0);
        let mut is_twice = false;
        for (x, y) in pairs {
            is_twice |= candidates[x].camera == candidates[y].camera;
            all += 1;
            fitting += usize::from(fits(x, y));
        }
        // Cameras opposite each other share few keypoints, so not all pairs need to fit.
        if is_twice || 3 * fitting < 2 * all {
            continue;
        }
        let moved = std::mem::take(&mut clusters[b]);
        for x in &moved {
            cluster_of[*x] = a;
        }
        clusters[a].extend(moved);
    }
    clusters.retain(|cluster| cluster.len() >= 2);
    clusters
}

fn person(candidates: &[Candidate<'_>], cluster: &[usize], tick: i64, gate: f64) -> Option<Person> {
    let own: Vec<&Candidate<'_>> = cluster.iter().filter_map(|i| candidates.get(*i)).collect();
    let count = own.iter().map(|it| it.body.joints.len()).max()?;
    let mut joints_m = Vec::with_capacity(count);
    for k in 0..count {
        let sights = own.iter().filter_map(|it| {
            let sight = it.sights.get(k).copied().flatten()?;
            Some((it.center_m, sight))
        });
        let sights: Vec<Sight> = sights.collect();
        joints_m.push(meeting(&own, &sights, gate));
    }
    let seen: Vec<Vector3<f64>> = joints_m.iter().flatten().copied().collect();
    if seen.len() < LEAST_JOINTS {
        return None;
    }
    let middle = seen.iter().fold(Vector3::zeros(), |s, p| s + p) / seen.len() as f64;
    let mut distances: Vec<f64> = seen.iter().map(|p| (p - middle).norm()).collect();
    distances.sort_by(f64::total_cmp);
    let median_m = distances.get(distances.len() / 2)?;
    (*median_m < MOST_SIZE_M).then(|| {
        let mut members: Vec<(usize, usize)> = own.iter().map(|it| (it.camera, it.index)).collect();
        members.sort_unstable();
        Person {
            tick,
            members,
            joints_m,
        }
    })
}

/// The point where most rays meet, within the gate at their approximate distance.
fn meeting(own: &[&Candidate<'_>], sights: &[Sight], gate: f64) -> Option<Vector3<f64>> {
    let px_rad = own.iter().map(|it| it.px_rad).fold(0.0, f64::max);
    // A wide gate gives the distance first.
    let (rough, _) = triangulate(sights, 0.1)?;
    let nearest_m = sights
        .iter()
        .map(|(center, _)| (rough - center).norm())
        .fold(f64::INFINITY, f64::min);
    let gate_rad = (gate * (KEYPOINT_M / nearest_m.max(0.5) + px_rad)).min(0.2);
    Some(triangulate(sights, gate_rad)?.0)
}
