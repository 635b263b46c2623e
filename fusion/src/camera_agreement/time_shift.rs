//! By how many ticks each camera is late, from what its crops show relative to those of others.
//!
//! For two cameras that follow the same people, a curve gives the cost of the distances between
//! their lines of sight over the time shift between the cameras. The constant part of each
//! keypoint's distance is left out. It comes from the calibration or from the network, not from
//! time. The shifts of all cameras minimise the sum of the curves. The search starts at zero and
//! moves one camera at a time. A parabola through the least cost gives the fraction of a tick.

use farfield_proto::order_statistics::upper_median;

pub(super) mod by_burst;
pub(super) mod curves;
pub(super) mod groups;
pub(super) mod pose_fit;
pub(super) mod pose_shift;
pub(super) mod silent;

use self::curves::{Curve, CurvePart, ShiftCosts};

/// Longest shift of the search, seconds.
const MAX_SHIFT_S: f64 = 1.0;
/// A minimum is sharp if the cost this many ticks away is larger by `MIN_SHARPNESS_RATIO`.
const SHARP_TICKS: usize = 4;
const MIN_SHARPNESS_RATIO: f64 = 1.03;
/// A minimum this near to the longest shift does not count: the true one may lie beyond.
const EDGE_TICKS: usize = 2;
/// Least ratio of the median cost of all shifts to the least cost.
const MIN_MEDIAN_RATIO: f64 = 1.25;
/// Rounds in which all cameras are moved.
const MAX_ROUNDS: usize = 24;

/// Least shift that is reported, ticks.
pub(super) const LATE_TICKS: f64 = 0.6;
/// Largest difference between the shifts of the two halves of the keypoints, ticks.
const MAX_LATE_DIFFERENCE_TICKS: f64 = 0.5;
/// The same as a share of the shift.
const MAX_LATE_DIFFERENCE_RATIO: f64 = 0.05;

/// The time shift of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Shift {
    /// By how many ticks its pictures are late: they show what happened so many ticks before.
    pub(super) late_ticks: f64,
    /// Mean cost against the shifted other cameras, without and with its own shift.
    pub(super) cost_before: f64,
    pub(super) cost_after: f64,
    /// Whether a few ticks more or less cost clearly more, so that people moved enough.
    pub(super) is_sharp: bool,
}

/// Which keypoints are compared. The two halves share none, so that one can confirm the other.
///
/// Networks number left and right keypoints in turn. Each half has both sides of its joints,
/// because one side may be hidden or stand on the ground. Such a side shows no shift in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KeypointHalf {
    All,
    OddPairs,
    EvenPairs,
}

impl KeypointHalf {
    pub(super) fn has(self, keypoint: usize) -> bool {
        match self {
            Self::All => true,
            Self::OddPairs => keypoint.div_ceil(2) % 2 == 1,
            Self::EvenPairs => keypoint.div_ceil(2).is_multiple_of(2),
        }
    }
}

/// The shift per camera; `None` if too little moved before it, or too few others saw the same.
pub(super) fn shifts(costs: &mut ShiftCosts<'_>) -> Vec<Option<Shift>> {
    let unknown = vec![None; costs.n_cameras()];
    let part = CurvePart {
        half: KeypointHalf::All,
        burst: None,
    };
    shifts_of(costs, part, &unknown)
}

/// The shift per camera from one part of the samples. The search starts at the shifts of `all`.
fn shifts_of(
    costs: &mut ShiftCosts<'_>,
    part: CurvePart,
    all: &[Option<Shift>],
) -> Vec<Option<Shift>> {
    let (reach, n_cameras) = (costs.reach, costs.n_cameras());
    let curves = costs.curves(part);
    let known = all
        .iter()
        .map(|shift| shift.map_or(0.0, |it| it.late_ticks.round()) as isize);
    let mut ticks: Vec<isize> = known.collect();
    for _ in 0..MAX_ROUNDS {
        let moves = (0..n_cameras).filter_map(|camera| {
            let sums = sums(&curves, &ticks, camera, reach)?;
            let now = sums[index(ticks[camera], reach)];
            let (at, least) = least(&sums)?;
            let gain = now - least;
            (gain > 1e-6).then_some((camera, at.cast_signed() - reach.cast_signed(), gain))
        });
        let Some((camera, to, _)) = moves.max_by(|a, b| a.2.total_cmp(&b.2)) else {
            break;
        };
        ticks[camera] = to;
    }
    let is_compared = |camera: &usize| curves.iter().any(|c| c.a == *camera || c.b == *camera);
    let compared: Vec<usize> = (0..n_cameras).filter(is_compared).collect();
    let fractions = fractions(&curves, &ticks, reach);
    let references = reference_cameras(&compared, &ticks).into_iter();
    let references = references.map(|camera| ticks[camera] as f64 + fractions[camera]);
    let reference_ticks = upper_median(references.collect()).unwrap_or(0.0);
    for tick in &mut ticks {
        *tick -= reference_ticks.round() as isize;
    }
    let reference_fraction = reference_ticks - reference_ticks.round();
    (0..n_cameras)
        .map(|camera| {
            let sums = sums(&curves, &ticks, camera, reach)?;
            let n = curves
                .iter()
                .filter(|c| c.a == camera || c.b == camera)
                .count() as f64;
            let at = index(ticks[camera], reach);
            let near = [at.checked_sub(SHARP_TICKS), Some(at + SHARP_TICKS)];
            let mut near = near.into_iter().flatten().filter_map(|at| sums.get(at));
            let is_sharp = near.all(|sum| sum / sums[at] >= MIN_SHARPNESS_RATIO);
            Some(Shift {
                late_ticks: ticks[camera] as f64 + fractions[camera] - reference_fraction,
                cost_before: sums[reach] / n,
                cost_after: sums[at] / n,
                is_sharp: is_clear_minimum(&sums, at) && is_sharp,
            })
        })
        .collect()
}

/// Whether `at` is not at the edge of the searched shifts, and costs clearly less than most.
fn is_clear_minimum(sums: &[f64], at: usize) -> bool {
    let known = sums.iter().copied().filter(|sum| sum.is_finite());
    let middle = upper_median(known.collect()).unwrap_or(0.0);
    let is_inside = at >= EDGE_TICKS && at + EDGE_TICKS < sums.len();
    is_inside && middle >= MIN_MEDIAN_RATIO * sums[at]
}

/// The fraction of a tick per camera with which the vertices of all curves agree best.
/// Each vertex is weighted by the bend of its curve.
fn fractions(curves: &[Curve], ticks: &[isize], reach: usize) -> Vec<f64> {
    let vertices = curves.iter().filter_map(|curve| {
        let at = index(ticks[curve.b] - ticks[curve.a], reach);
        let costs = curve.costs.get(at.checked_sub(1)?..at + 2)?;
        let vertex = vertex(costs[0], costs[1], costs[2]);
        let bend = costs[0] + costs[2] - 2.0 * costs[1];
        (bend > 0.0).then_some((curve.a, curve.b, vertex, bend))
    });
    let vertices: Vec<(usize, usize, f64, f64)> = vertices.collect();
    let mut fractions = vec![0.0_f64; ticks.len()];
    for _ in 0..MAX_ROUNDS {
        for camera in 0..ticks.len() {
            let own = vertices.iter().filter_map(|&(a, b, vertex, bend)| {
                let fraction = match camera {
                    _ if camera == a => fractions[b] - vertex,
                    _ if camera == b => fractions[a] + vertex,
                    _ => return None,
                };
                Some((fraction * bend, bend))
            });
            let (sum, weight) = own.fold((0.0, 0.0), |all, own| (all.0 + own.0, all.1 + own.1));
            if weight > 0.0 {
                fractions[camera] = sum / weight;
            }
        }
    }
    fractions
}

/// The `compared` cameras whose time is taken as right, because most cameras have it, to a tick.
///
/// Only differences between cameras are observable. Two groups can be equally large, if each of
/// two recorders has half of the cameras. Then the group of the first camera is the reference, so
/// that both halves of the keypoints and all bursts have the same reference.
fn reference_cameras(compared: &[usize], ticks: &[isize]) -> Vec<usize> {
    let near = |of: isize| {
        let near = compared.iter().copied();
        near.filter(move |&camera| (ticks[camera] - of).abs() <= 1)
    };
    let all = compared.iter().map(|&camera| ticks[camera]);
    let most = all.clone().map(|of| near(of).count()).max().unwrap_or(0);
    let mut largest = all.filter(|&of| near(of).count() == most);
    largest.next().map_or(Vec::new(), |of| near(of).collect())
}

fn index(ticks: isize, reach: usize) -> usize {
    (ticks + reach.cast_signed())
        .clamp(0, 2 * reach.cast_signed())
        .cast_unsigned()
}

fn least(sums: &[f64]) -> Option<(usize, f64)> {
    let known = sums
        .iter()
        .copied()
        .enumerate()
        .filter(|(_, sum)| sum.is_finite());
    known.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The place of the minimum of the parabola through three costs, -0.5 to 0.5.
pub(super) fn vertex(before: f64, at: f64, after: f64) -> f64 {
    let bend = before + after - 2.0 * at;
    let shift = 0.5 * (before - after) / bend;
    if bend > 0.0 && shift.is_finite() {
        shift.clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

/// The cost against all others over the shift of one `camera`, while the others keep their `ticks`.
/// `None` without others.
fn sums(curves: &[Curve], ticks: &[isize], camera: usize, reach: usize) -> Option<Vec<f64>> {
    let mut sums = vec![0.0; 2 * reach + 1];
    let mut n = 0;
    for curve in curves.iter().filter(|c| c.a == camera || c.b == camera) {
        n += 1;
        for (at, sum) in sums.iter_mut().enumerate() {
            let own = at.cast_signed() - reach.cast_signed();
            let shift = if curve.a == camera {
                ticks[curve.b] - own
            } else {
                own - ticks[curve.a]
            };
            let is_inside = shift.unsigned_abs() <= reach;
            *sum += if is_inside {
                curve.costs[index(shift, reach)]
            } else {
                f64::NAN
            };
        }
    }
    (n > 0).then_some(sums)
}

/// Moves all `shifts` of one part of the samples by the offset to `others` that most cameras have.
///
/// Only differences between cameras are observable, so each part may have taken another group of
/// cameras as its reference.
fn align_reference(shifts: &mut [Option<Shift>], others: &[Option<Shift>]) {
    let pairs = shifts.iter().zip(others);
    let apart = pairs
        .filter_map(|(own, other)| Some(own.as_ref()?.late_ticks - other.as_ref()?.late_ticks));
    let apart: Vec<f64> = apart.collect();
    let alike = |of: f64| {
        let alike = apart.iter().filter(|apart| is_same(of, **apart));
        alike.count()
    };
    let most = apart.iter().copied().max_by_key(|&of| alike(of));
    if let Some(most) = most.filter(|&most| alike(most) > alike(0.0)) {
        for shift in shifts.iter_mut().flatten() {
            shift.late_ticks -= most;
        }
    }
}

/// Whether two halves of the keypoints give the same shift, ticks.
fn is_same(first: f64, second: f64) -> bool {
    let most = MAX_LATE_DIFFERENCE_TICKS.max(MAX_LATE_DIFFERENCE_RATIO * first.abs());
    (first - second).abs() <= most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_camera_decides_between_two_equal_groups() {
        for late in [[0, 0, -5, -5], [5, 5, 0, 0]] {
            assert_eq!(reference_cameras(&[0, 1, 2, 3], &late), [0, 1]);
        }
    }

    #[test]
    fn the_largest_group_is_the_reference() {
        for late in [[7, 0, 0, 1], [0, 4, 4, 4]] {
            assert_eq!(reference_cameras(&[0, 1, 2, 3], &late), [1, 2, 3]);
        }
    }

    #[test]
    fn cameras_that_were_not_compared_are_no_reference() {
        assert_eq!(reference_cameras(&[0, 1, 4], &[6, 6, 0, 0, 0]), [0, 1]);
    }

    fn shifts(late_ticks: &[f64]) -> Vec<Option<Shift>> {
        let shift = |late_ticks: &f64| Shift {
            late_ticks: *late_ticks,
            ..Shift::default()
        };
        late_ticks.iter().map(|late| Some(shift(late))).collect()
    }

    #[test]
    fn halves_with_different_references_are_aligned() {
        let all = shifts(&[0.0, 0.1, -15.0, -15.2]);
        let mut half = shifts(&[15.1, 15.2, 0.1, -0.3]);
        align_reference(&mut half, &all);
        for (own, other) in half.iter().zip(&all) {
            assert!(is_same(own.unwrap().late_ticks, other.unwrap().late_ticks));
        }
    }

    #[test]
    fn a_half_that_differs_in_one_camera_is_not_changed() {
        let all = shifts(&[0.0, 0.1, -3.3]);
        let mut half = shifts(&[0.0, 0.1, -0.5]);
        align_reference(&mut half, &all);
        assert_eq!(half, shifts(&[0.0, 0.1, -0.5]));
    }
}
