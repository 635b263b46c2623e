//! Joins pairs of cameras to all of them: pairs that contradict others get less weight, then rotations are averaged, then
//! positions.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};

use super::ground::Ground;
use super::pair::Pair;

/// Three pairs agree if the rotation around the loop is smaller than this.
const LOOP_RAD: f64 = 0.12;
/// And if the shift around the loop is smaller than this share of its length.
const LOOP_SHARE: f64 = 0.3;
/// Pairs farther than this from the average are left out of it.
const FAR_RAD: f64 = 0.2;
/// Rounds of averaging.
const ROUNDS: usize = 30;

/// A camera relative to the common floor: world axes to camera axes, and the pinhole, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::people) struct Placed {
    pub(in crate::people) camera_from_world: UnitQuaternion<f64>,
    pub(in crate::people) center_m: Vector3<f64>,
}

/// Poses of connected cameras in the world over the floor (z up) of the best connected one.
pub(in crate::people) fn places(grounds: &[Option<Ground>], pairs: &[Pair]) -> Vec<Option<Placed>> {
    let sound: Vec<&Pair> = pairs.iter().filter(|pair| pair.is_sound()).collect();
    let worth: Vec<f64> = sound.iter().map(|pair| weight(pair, &sound)).collect();
    let mut places = vec![None; grounds.len()];
    let mut sums = vec![0.0; grounds.len()];
    for (pair, worth) in sound.iter().zip(&worth) {
        sums[pair.first] += worth;
        sums[pair.second] += worth;
    }
    let root = (0..grounds.len())
        .filter(|i| grounds[*i].is_some() && sums[*i] > 0.0)
        .max_by(|a, b| sums[*a].total_cmp(&sums[*b]));
    let Some((root, ground)) = root.and_then(|root| Some((root, grounds[root]?))) else {
        return places;
    };
    places[root] = Some(Placed {
        camera_from_world: ground.ground_from_camera.inverse(),
        center_m: Vector3::new(0.0, 0.0, ground.height_m),
    });
    // Prim's tree, the pair with the largest weight first.
    loop {
        let open = sound.iter().zip(&worth);
        let open =
            open.filter(|(pair, _)| places[pair.first].is_some() != places[pair.second].is_some());
        let Some((pair, _)) = open.max_by(|a, b| a.1.total_cmp(b.1)) else {
            break;
        };
        if let Some(first) = places[pair.first] {
            places[pair.second] = Some(after(&first, pair));
        } else if let Some(second) = places[pair.second] {
            places[pair.first] = Some(before(&second, pair));
        }
    }
    average_rotations(&mut places, &sound, &worth, root);
    average_places(&mut places, &sound, &worth, root);
    places
}

fn after(first: &Placed, pair: &Pair) -> Placed {
    let camera_from_world = pair.rotation * first.camera_from_world;
    Placed {
        camera_from_world,
        center_m: first.center_m - camera_from_world.inverse() * pair.shift_m,
    }
}

fn before(second: &Placed, pair: &Pair) -> Placed {
    Placed {
        camera_from_world: pair.rotation.inverse() * second.camera_from_world,
        center_m: second.center_m + second.camera_from_world.inverse() * pair.shift_m,
    }
}

/// The worth of a pair, raised by triples that agree with it and lowered by those that do not.
fn weight(pair: &Pair, all: &[&Pair]) -> f64 {
    let by_ends: BTreeMap<(usize, usize), &Pair> =
        all.iter().map(|it| ((it.first, it.second), *it)).collect();
    let most = all.iter().map(|it| it.second).max().unwrap_or(0);
    let (mut good, mut bad) = (0, 0);
    for third in 0..=most {
        let mut ends = [pair.first, pair.second, third];
        ends.sort_unstable();
        let [a, b, c] = ends;
        let edge = |x: usize, y: usize| by_ends.get(&(x, y));
        if let (Some(ab), Some(bc), Some(ac)) = (edge(a, b), edge(b, c), edge(a, c)) {
            if agree(ab, bc, ac) {
                good += 1;
            } else {
                bad += 1;
            }
        }
    }
    pair.worth() * f64::from(1 + good) / f64::from(1 + good + 4 * bad)
}

fn agree(ab: &Pair, bc: &Pair, ac: &Pair) -> bool {
    let around = bc.rotation * ab.rotation;
    let shift_m = bc.rotation * ab.shift_m + bc.shift_m;
    let way_m = ab.shift_m.norm() + bc.shift_m.norm() + ac.shift_m.norm();
    around.angle_to(&ac.rotation) < LOOP_RAD && (shift_m - ac.shift_m).norm() < LOOP_SHARE * way_m
}

/// Each rotation in turn becomes the mean of the predictions by its neighbours; the root stays fixed.
fn average_rotations(places: &mut [Option<Placed>], pairs: &[&Pair], worth: &[f64], root: usize) {
    for _ in 0..ROUNDS {
        for index in 0..places.len() {
            let Some(own) = places[index].filter(|_| index != root) else {
                continue;
            };
            let (mut step, mut total) = (Vector3::zeros(), 0.0);
            for (pair, worth) in pairs.iter().zip(worth) {
                let predicted = if pair.second == index {
                    places[pair.first].map(|it| after(&it, pair))
                } else if pair.first == index {
                    places[pair.second].map(|it| before(&it, pair))
                } else {
                    None
                };
                let Some(predicted) = predicted else { continue };
                let turn =
                    (predicted.camera_from_world * own.camera_from_world.inverse()).scaled_axis();
                if turn.norm() < FAR_RAD {
                    step += turn * *worth;
                    total += worth;
                }
            }
            if total > 0.0 {
                let turned = UnitQuaternion::from_scaled_axis(step / total) * own.camera_from_world;
                places[index] = Some(Placed {
                    camera_from_world: turned,
                    ..own
                });
            }
        }
    }
}

/// Positions by weighted least squares over all pairs; large residuals lose weight in each round.
fn average_places(places: &mut [Option<Placed>], pairs: &[&Pair], worth: &[f64], root: usize) {
    let free: Vec<usize> = (0..places.len())
        .filter(|i| *i != root && places[*i].is_some())
        .collect();
    let column: BTreeMap<usize, usize> = free.iter().copied().zip(0..).collect();
    let count = 3 * free.len();
    for _ in 0..ROUNDS {
        let mut matrix = DMatrix::<f64>::zeros(count, count);
        let mut right = DVector::<f64>::zeros(count);
        for (pair, worth) in pairs.iter().zip(worth) {
            let (Some(a), Some(b)) = (places[pair.first], places[pair.second]) else {
                continue;
            };
            let predicted = pair.rotation * a.camera_from_world;
            if predicted.angle_to(&b.camera_from_world) > FAR_RAD {
                continue;
            }
            // The shift from the first to the second camera in the world.
            let step_m = -(b.camera_from_world.inverse() * pair.shift_m);
            let missed_m = (b.center_m - a.center_m - step_m).norm();
            let length_m = pair.shift_m.norm().max(0.1);
            let share = missed_m / (0.1 * length_m);
            let weight = worth / (length_m * length_m) / (1.0 + share * share);
            let (i, j) = (column.get(&pair.first), column.get(&pair.second));
            for axis in 0..3 {
                if let Some(i) = i {
                    matrix[(3 * i + axis, 3 * i + axis)] += weight;
                    right[3 * i + axis] += weight * (fixed_center(j, &b) - step_m)[axis];
                }
                if let Some(j) = j {
                    matrix[(3 * j + axis, 3 * j + axis)] += weight;
                    right[3 * j + axis] += weight * (fixed_center(i, &a) + step_m)[axis];
                }
                if let (Some(i), Some(j)) = (i, j) {
                    matrix[(3 * i + axis, 3 * j + axis)] -= weight;
                    matrix[(3 * j + axis, 3 * i + axis)] -= weight;
                }
            }
        }
        let Some(cholesky) = matrix.cholesky() else {
            return;
        };
        let solved = cholesky.solve(&right);
        for (k, index) in free.iter().enumerate() {
            if let Some(place) = &mut places[*index] {
                place.center_m = Vector3::new(solved[3 * k], solved[3 * k + 1], solved[3 * k + 2]);
            }
        }
    }
}

/// The position of a camera that is fixed, or zero if it is an unknown.
fn fixed_center(column: Option<&usize>, place: &Placed) -> Vector3<f64> {
    column.map_or(place.center_m, |_| Vector3::zeros())
}
