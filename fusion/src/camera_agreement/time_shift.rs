//! By how many ticks each camera is off: the shift at which what it shows meets what the others show.
//!
//! For two cameras that follow the same people the cost of the distances between their lines of sight is drawn over the
//! time by which one is moved against the other. What of a keypoint's distance stays the same is left out: it is of the
//! calibration, or of what the network takes for the keypoint, and says nothing of time. The shifts of all cameras
//! together are those with the least sum, found from zero by moving one camera at a time; a parabola through the least
//! cost gives the fraction of a tick.

use farfield_proto::order_statistics::upper_median;

pub(super) mod by_burst;
pub(super) mod curves;
pub(super) mod groups;
pub(super) mod jumps;
pub(super) mod met;
pub(super) mod pose_shift;
pub(super) mod silent;

use self::curves::{Curve, CurvePart, ShiftCosts};

/// Longest shift that is looked for, seconds.
const LONGEST_S: f64 = 1.0;
/// So many ticks beside the least cost it must be larger by this factor for the shift to be known.
const SHARP_TICKS: usize = 4;
const SHARP: f64 = 1.03;
/// Shifts this near to the longest are no least cost: it may lie beyond.
const EDGE_TICKS: usize = 2;
/// By which factor most shifts cost more than the least.
const STANDS_OUT: f64 = 1.25;
/// Rounds in which all cameras are moved.
const MAX_ROUNDS: usize = 24;

/// Shift in time that is told of, ticks.
pub(super) const LATE_TICKS: f64 = 0.6;
/// By how much the halves of the keypoints may differ in it, ticks.
const LATE_DIFFERENCE_TICKS: f64 = 0.5;
/// The same as a share of the shift.
const LATE_DIFFERENCE: f64 = 0.05;

/// What is known of a camera's time.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Shift {
    /// By how many ticks its pictures are late: what it shows at a tick happened so many ticks before.
    pub(super) late_ticks: f64,
    /// Mean cost against the others as they are moved: without and with its own shift.
    pub(super) cost_before: f64,
    pub(super) cost_after: f64,
    /// Whether some ticks more or less would be clearly worse: something moved.
    pub(super) is_sharp: bool,
}

/// Which keypoints are compared: the halves have different ones, so that one can confirm the other.
///
/// Networks number left and right keypoints in turn. Each half has both sides of its joints: from where a camera stands one side may
/// be hidden, or stand on the ground. Then it tells nothing of time.
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

/// Per camera its shift; `None` if too little moved before it, or too few others saw the same.
pub(super) fn shifts(costs: &mut ShiftCosts<'_>) -> Vec<Option<Shift>> {
    let unknown = vec![None; costs.n_cameras()];
    let part = CurvePart {
        half: KeypointHalf::All,
        burst: None,
    };
    shifts_of(costs, part, &unknown)
}

/// Per camera its shift, of a part of what was kept; found from those of `all`, where they are known.
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
    let right = taken_for_right(&compared, &ticks).into_iter();
    let right = right.map(|camera| ticks[camera] as f64 + fractions[camera]);
    let right_ticks = upper_median(right.collect()).unwrap_or(0.0);
    for tick in &mut ticks {
        *tick -= right_ticks.round() as isize;
    }
    let beside = right_ticks - right_ticks.round();
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
            let is_sharp = near.all(|sum| sum / sums[at] >= SHARP);
            Some(Shift {
                late_ticks: ticks[camera] as f64 + fractions[camera] - beside,
                cost_before: sums[reach] / n,
                cost_after: sums[at] / n,
                is_sharp: stands_out(&sums, at) && is_sharp,
            })
        })
        .collect()
}

/// Whether the cost at `at` is inside the shifts that were looked at, and clearly less than at most of them.
fn stands_out(sums: &[f64], at: usize) -> bool {
    let known = sums.iter().copied().filter(|sum| sum.is_finite());
    let middle = upper_median(known.collect()).unwrap_or(0.0);
    let is_inside = at >= EDGE_TICKS && at + EDGE_TICKS < sums.len();
    is_inside && middle >= STANDS_OUT * sums[at]
}

/// What each camera is off beyond whole ticks: those with which the vertices of all curves agree best, weighted by how
/// sharp they are.
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
                let said = match camera {
                    _ if camera == a => fractions[b] - vertex,
                    _ if camera == b => fractions[a] + vertex,
                    _ => return None,
                };
                Some((said * bend, bend))
            });
            let (sum, weight) = own.fold((0.0, 0.0), |all, own| (all.0 + own.0, all.1 + own.1));
            if weight > 0.0 {
                fractions[camera] = sum / weight;
            }
        }
    }
    fractions
}

/// Only differences between cameras are seen: of those that are `compared` the ones that have the time which most have, to a tick.
///
/// Where two groups are as large (of two recorders each has half of the cameras) it is that of the first camera, so that both
/// halves of the keypoints say so, and all bursts.
fn taken_for_right(compared: &[usize], ticks: &[isize]) -> Vec<usize> {
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

/// Where between two neighbours the parabola through three costs is least, -0.5 to 0.5.
pub(super) fn vertex(before: f64, at: f64, after: f64) -> f64 {
    let bend = before + after - 2.0 * at;
    let shift = 0.5 * (before - after) / bend;
    if bend > 0.0 && shift.is_finite() {
        shift.clamp(-0.5, 0.5)
    } else {
        0.0
    }
}

/// The cost against all others, over the shift of one `camera` while the others have those of `ticks`; `None` without
/// others.
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

/// Puts shifts that were found of a part of what is known in the place that `others` have for most cameras: only differences
/// between cameras are seen, and of two groups of cameras each part may take the other for right.
fn put_beside(shifts: &mut [Option<Shift>], others: &[Option<Shift>]) {
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

/// Whether the halves of the keypoints tell the same shift.
pub(super) fn is_same(first: f64, second: f64) -> bool {
    let most = LATE_DIFFERENCE_TICKS.max(LATE_DIFFERENCE * first.abs());
    (first - second).abs() <= most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_recorders_that_of_the_first_camera_is_right_whichever_was_moved() {
        for late in [[0, 0, -5, -5], [5, 5, 0, 0]] {
            assert_eq!(taken_for_right(&[0, 1, 2, 3], &late), [0, 1]);
        }
    }

    #[test]
    fn the_time_that_most_cameras_have_is_right_whoever_is_first() {
        for late in [[7, 0, 0, 1], [0, 4, 4, 4]] {
            assert_eq!(taken_for_right(&[0, 1, 2, 3], &late), [1, 2, 3]);
        }
    }

    #[test]
    fn cameras_that_were_not_compared_say_nothing_of_the_right_time() {
        assert_eq!(taken_for_right(&[0, 1, 4], &[6, 6, 0, 0, 0]), [0, 1]);
    }

    fn shifts(late_ticks: &[f64]) -> Vec<Option<Shift>> {
        let shift = |late_ticks: &f64| Shift {
            late_ticks: *late_ticks,
            ..Shift::default()
        };
        late_ticks.iter().map(|late| Some(shift(late))).collect()
    }

    #[test]
    fn halves_that_take_either_of_two_recorders_for_right_say_the_same() {
        let all = shifts(&[0.0, 0.1, -15.0, -15.2]);
        let mut half = shifts(&[15.1, 15.2, 0.1, -0.3]);
        put_beside(&mut half, &all);
        for (own, other) in half.iter().zip(&all) {
            assert!(is_same(own.unwrap().late_ticks, other.unwrap().late_ticks));
        }
    }

    #[test]
    fn a_half_that_says_otherwise_of_one_camera_says_so() {
        let all = shifts(&[0.0, 0.1, -3.3]);
        let mut half = shifts(&[0.0, 0.1, -0.5]);
        put_beside(&mut half, &all);
        assert_eq!(half, shifts(&[0.0, 0.1, -0.5]));
    }
}
