//! A first similarity from the clicks, robust to wrong clicks.

use std::collections::BTreeMap;

use nalgebra::{UnitQuaternion, Vector3};

use super::marks::{Known, MarkFreedom};
use super::sight::{Sights, What};
use super::similarity::Similarity;
use crate::adjustment::CameraState;
use crate::board::pose_from_points;
use crate::geometry::{Sight, three_point, triangulate};

/// Largest angle between the clicks of a point, radians.
const CLICK_RAD: f64 = 0.02;
/// Most triples of places that are tried.
const MOST_TRIPLES: usize = 3000;
/// Most triples of the marks of one camera: each costs a quartic and up to four poses to evaluate.
const MOST_TRIPLES_OF_CAMERA: usize = 400;
/// Residual beyond which an observation counts as wrong, standard deviations.
const MOST_SIGMAS: f64 = 30.0;
/// Least height of a triple of places over its longest side, relative to that side.
const LEAST_SPREAD: f64 = 0.05;
/// Least number of clicks for the pose of one camera.
const LEAST_CLICKS: usize = 4;

/// The similarity with which most observations agree, among those proposed by triples of places and by cameras.
pub(super) fn start(sights: &Sights<'_>, freedom: MarkFreedom) -> Result<Similarity, String> {
    let places = places(sights);
    let mut proposed = from_triples(&places, freedom);
    proposed.extend(from_cameras(sights, freedom));
    if freedom == MarkFreedom::Rigid {
        proposed.extend(from_three_marks(sights));
    }
    let cost = |it: &Similarity| {
        let each = sights.seen.iter().map(|seen| {
            let residual = sights.residual(seen, it);
            let r = residual.map_or(f64::INFINITY, |(r, sigma)| r.norm() / (MOST_SIGMAS * sigma));
            (r * r).min(1.0)
        });
        each.sum::<f64>()
    };
    let costs = proposed.into_iter().map(|it| (cost(&it), it));
    let best = costs.min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, it)| it).ok_or_else(|| {
        format!(
            "found {} clicked marks or known places that two cameras see, expected three that are not on one line, or two \
             cameras with {LEAST_CLICKS} marks each",
            places.len()
        )
    })
}

/// Known places in the world of the cameras, and in the venue.
fn places(sights: &Sights<'_>) -> Vec<(Vector3<f64>, Vector3<f64>)> {
    let mut clicked: BTreeMap<&str, (Vec<Sight>, Vector3<f64>)> = BTreeMap::new();
    let mut found = Vec::new();
    for seen in &sights.seen {
        match &seen.what {
            What::Click {
                camera,
                direction,
                known: Known::Place(at),
                ..
            } => {
                let Some((_, state)) = sights.cameras.get(*camera) else {
                    continue;
                };
                let entry = clicked.entry(seen.name.as_str());
                let own = entry.or_insert_with(|| (Vec::new(), Vector3::from(*at)));
                own.0.push((state.center_w, *direction));
            }
            What::Place(at, known) => found.push((*at, *known)),
            _ => {}
        }
    }
    let met = clicked.into_values().filter_map(|(rays, known)| {
        let (at, _) = triangulate(&rays, CLICK_RAD)?;
        Some((at, known))
    });
    found.extend(met);
    found
}

fn from_triples(places: &[(Vector3<f64>, Vector3<f64>)], freedom: MarkFreedom) -> Vec<Similarity> {
    let each = triples(places, MOST_TRIPLES).into_iter();
    let proposed = each.filter_map(|chosen| {
        let (found, known) = (chosen.map(|it| it.0), chosen.map(|it| it.1));
        let are_spread = is_spread(&known) && is_spread(&found);
        are_spread
            .then(|| fitted(&found, &known, freedom))
            .flatten()
    });
    proposed.collect()
}

fn fitted(
    found: &[Vector3<f64>; 3],
    known: &[Vector3<f64>; 3],
    freedom: MarkFreedom,
) -> Option<Similarity> {
    let similarity = Similarity::between(found, known).ok()?;
    Some(with_freedom(similarity, &found[0], &known[0], freedom))
}

/// Sets the scale to 1 for [`MarkFreedom::Rigid`]; `found` still maps to `known`.
fn with_freedom(
    it: Similarity,
    found: &Vector3<f64>,
    known: &Vector3<f64>,
    freedom: MarkFreedom,
) -> Similarity {
    let scale = if freedom == MarkFreedom::Rigid {
        1.0
    } else {
        it.scale
    };
    Similarity {
        scale,
        shift: known - it.rotation * found * scale,
        ..it
    }
}

fn is_spread(points: &[Vector3<f64>; 3]) -> bool {
    let (p, q) = (points[1] - points[0], points[2] - points[0]);
    let longest = p
        .norm_squared()
        .max(q.norm_squared())
        .max((p - q).norm_squared());
    p.cross(&q).norm() > LEAST_SPREAD * longest
}

/// Proposals from three clicks of one camera, so that one wrong click does not spoil all of them.
fn from_three_marks(sights: &Sights<'_>) -> Vec<Similarity> {
    let mut proposed = Vec::new();
    for (index, (_, state)) in sights.cameras.iter().enumerate() {
        let clicked = sights.seen.iter().filter_map(|seen| match &seen.what {
            What::Click {
                camera,
                direction,
                known: Known::Place(at),
                ..
            } if *camera == index => {
                let bearing = state.camera_from_world * direction;
                Some((bearing, Vector3::from(*at)))
            }
            _ => None,
        });
        let clicked: Vec<(Vector3<f64>, Vector3<f64>)> = clicked.collect();
        if clicked.len() <= LEAST_CLICKS {
            continue;
        }
        for chosen in triples(&clicked, MOST_TRIPLES_OF_CAMERA) {
            let poses = three_point(&chosen.map(|it| it.0), &chosen.map(|it| it.1));
            proposed.extend(poses.into_iter().map(|(camera_from_venue, center)| {
                let rotation = camera_from_venue.inverse() * state.camera_from_world;
                let it = Similarity {
                    rotation,
                    ..Similarity::identity()
                };
                with_freedom(it, &state.center_w, &center, MarkFreedom::Rigid)
            }));
        }
    }
    proposed
}

/// Triples of `all`; if there are more than `most`, every n-th.
fn triples<T: Copy>(all: &[T], most: usize) -> Vec<[T; 3]> {
    let n = all.len();
    let every = (n * n.saturating_sub(1) * n.saturating_sub(2) / 6)
        .div_ceil(most)
        .max(1);
    let mut chosen = Vec::new();
    let mut count = 0;
    for (i, a) in all.iter().enumerate() {
        for (j, b) in all.iter().enumerate().skip(i + 1) {
            for c in all.iter().skip(j + 1) {
                count += 1;
                if count % every == 0 {
                    chosen.push([*a, *b, *c]);
                }
            }
        }
    }
    chosen
}

/// Proposals from the poses of cameras by their own clicks; two of them give the scale.
fn from_cameras(sights: &Sights<'_>, freedom: MarkFreedom) -> Vec<Similarity> {
    let mut posed: Vec<(&CameraState, UnitQuaternion<f64>, Vector3<f64>)> = Vec::new();
    for (index, (_, state)) in sights.cameras.iter().enumerate() {
        let (mut points, mut pixels) = (Vec::new(), Vec::new());
        for seen in &sights.seen {
            if let What::Click {
                camera,
                px,
                known: Known::Place(at),
                ..
            } = &seen.what
                && *camera == index
            {
                points.push(*at);
                pixels.push(*px);
            }
        }
        if points.len() < LEAST_CLICKS {
            continue;
        }
        let Ok(pose) = pose_from_points(&state.intrinsics, &state.lens(), &points, &pixels) else {
            continue;
        };
        let camera_from_venue = pose.camera_from_world;
        let venue_from_found = camera_from_venue.rotation.inverse() * state.camera_from_world;
        let center = camera_from_venue.inverse().translation.vector;
        posed.push((state, venue_from_found, center));
    }
    let mut proposed = Vec::new();
    for (i, (first, rotation, center)) in posed.iter().enumerate() {
        if freedom == MarkFreedom::Rigid {
            let it = Similarity {
                rotation: *rotation,
                ..Similarity::identity()
            };
            proposed.push(with_freedom(it, &first.center_w, center, freedom));
        }
        for (second, _, other) in posed.iter().skip(i + 1) {
            let scale = (other - center).norm() / (second.center_w - first.center_w).norm();
            if scale.is_finite() && scale > 0.0 {
                let it = Similarity {
                    scale,
                    rotation: *rotation,
                    shift: Vector3::zeros(),
                };
                proposed.push(with_freedom(it, &first.center_w, center, freedom));
            }
        }
    }
    proposed
}
