//! By how much a part of the cameras is late that has one time: what one of two recorders has.
//!
//! Half of those with whom each of them is compared are as late as it is, so that each by itself may tell too little. All that
//! one group shows beside the other tells of one shift.

use farfield_proto::order_statistics::upper_median;

use super::curves::{Curve, CurvePart, ShiftCosts};
use super::{
    KeypointHalf, SHARP, SHARP_TICKS, STANDS_OUT, Shift, index, least, stands_out, vertex,
};

/// Fewest bursts, as many as ten seconds have: in three or four seconds of the Shelf in which people hardly move, right cameras seem
/// to be of two recorders.
const MIN_BURSTS: usize = 3;
/// Fewest cameras of either group.
const MIN_CAMERAS: usize = 2;
/// Up to so many ticks a camera is on time.
const ON_TIME_TICKS: f64 = 1.0;
/// By how much the halves of the keypoints may differ, as a share of the shift. Two of the forty shifts that are looked at on the
/// Shelf are as near to each other by chance.
const DIFFERENCE: f64 = 0.1;

/// Cameras that are late by the same time.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::camera_agreement) struct LateGroup {
    pub(in crate::camera_agreement) cameras: Vec<usize>,
    pub(in crate::camera_agreement) late_ticks: f64,
    /// What the shift leaves of the cost between the group and the others.
    pub(in crate::camera_agreement) ratio: f64,
}

/// The cameras that seem late by about as much beside others that are on time, where all of them together tell it.
pub(in crate::camera_agreement) fn late_group(
    costs: &mut ShiftCosts<'_>,
    shifts: &[Option<Shift>],
) -> Option<LateGroup> {
    if costs.bursts().len() < MIN_BURSTS {
        return None;
    }
    let cameras = beside_the_right(shifts)?;
    let reach = costs.reach;
    let mut of = |half| {
        let curves = costs.curves(CurvePart { half, burst: None });
        shift_of(&cameras, &curves, reach)
    };
    let (late_ticks, ratio) = of(KeypointHalf::All)?;
    let halves = [
        of(KeypointHalf::OddPairs)?.0,
        of(KeypointHalf::EvenPairs)?.0,
    ];
    let is_same = |half: &f64| (half - late_ticks).abs() <= DIFFERENCE * late_ticks.abs();
    halves.iter().all(is_same).then_some(LateGroup {
        cameras,
        late_ticks,
        ratio,
    })
}

/// Those of the cameras that are late, or early, by some ticks, all about as much, where enough others are on time.
fn beside_the_right(shifts: &[Option<Shift>]) -> Option<Vec<usize>> {
    let known = shifts.iter().enumerate();
    let known = known.filter_map(|(camera, shift)| Some((camera, shift.as_ref()?.late_ticks)));
    let (right, late): (Vec<_>, Vec<_>) = known.partition(|(_, late)| late.abs() <= ON_TIME_TICKS);
    let middle = upper_median(late.iter().map(|(_, late)| *late).collect())?;
    let is_near = |(_, late): &(usize, f64)| (late - middle).abs() <= SHARP_TICKS as f64;
    let are_enough = right.len() >= MIN_CAMERAS && late.len() >= MIN_CAMERAS;
    let are_groups = are_enough && middle.abs() > SHARP_TICKS as f64 && late.iter().all(is_near);
    are_groups.then(|| late.into_iter().map(|(camera, _)| camera).collect())
}

/// By how many ticks these cameras are late against all others, and what that leaves of the cost; `None` where no shift costs
/// clearly less than most, those beside it, and none.
fn shift_of(cameras: &[usize], curves: &[Curve], reach: usize) -> Option<(f64, f64)> {
    let mut sums = vec![0.0; 2 * reach + 1];
    let mut n = 0;
    for curve in curves {
        let own = [curve.a, curve.b].map(|camera| cameras.contains(&camera));
        if own[0] == own[1] {
            continue;
        }
        n += 1;
        for (at, sum) in sums.iter_mut().enumerate() {
            let at = if own[1] { at } else { 2 * reach - at };
            *sum += curve.costs.get(at).copied().unwrap_or(f64::NAN);
        }
    }
    let (at, cost) = least(&sums).filter(|_| n > 0)?;
    let beside = [at.checked_sub(SHARP_TICKS), Some(at + SHARP_TICKS)];
    let beside = beside.into_iter().flatten().filter_map(|at| sums.get(at));
    let mut beside = beside.filter(|cost| cost.is_finite());
    let now = sums[index(0, reach)];
    let is_sure = stands_out(&sums, at)
        && beside.all(|beside| *beside >= SHARP * cost)
        && now >= STANDS_OUT * cost;
    let fraction = vertex(
        sums.get(at.checked_sub(1)?).copied()?,
        cost,
        *sums.get(at + 1)?,
    );
    let ticks = at.cast_signed() - reach.cast_signed();
    is_sure.then(|| (ticks as f64 + fraction, cost / now))
}

#[cfg(test)]
mod tests {
    use super::*;

    const REACH: usize = 20;

    fn shifts(late: &[Option<f64>]) -> Vec<Option<Shift>> {
        let shift = |late_ticks: f64| Shift {
            late_ticks,
            ..Shift::default()
        };
        late.iter().map(|late| late.map(shift)).collect()
    }

    #[test]
    fn cameras_that_seem_late_by_about_as_much_are_a_group() {
        let of = |late: &[Option<f64>]| beside_the_right(&shifts(late));
        let late = [Some(0.0), Some(-16.0), Some(-0.1), None, Some(-18.6)];
        assert_eq!(of(&late), Some(vec![1, 4]));
        // One alone, two that differ, and a few ticks.
        assert_eq!(of(&[Some(0.0), Some(-16.0), Some(0.2)]), None);
        assert_eq!(of(&[Some(0.0), Some(20.0), Some(0.2), Some(11.0)]), None);
        assert_eq!(of(&[Some(0.0), Some(3.0), Some(0.2), Some(3.1)]), None);
    }

    /// What two cameras of different groups cost, of which the second is late by so many ticks.
    fn curve([a, b]: [usize; 2], late: f64, deep: f64) -> Curve {
        let shift = |at: usize| at as f64 - REACH as f64 - late;
        let cost = |at: usize| 1.0 - deep / (1.0 + (shift(at) / 3.0).powi(2));
        Curve {
            a,
            b,
            costs: (0..=2 * REACH).map(cost).collect(),
        }
    }

    #[test]
    fn all_that_two_groups_show_tells_by_how_much_the_one_is_late() {
        // The third and the fourth are late; between the first two, and between those, nothing is.
        let mut curves = vec![curve([0, 1], 0.0, 0.5), curve([2, 3], 0.0, 0.5)];
        for (pair, late) in [
            ([0, 2], 15.0),
            ([0, 3], 15.5),
            ([1, 2], 14.5),
            ([1, 3], 15.0),
        ] {
            curves.push(curve(pair, late, 0.4));
        }
        let (late, ratio) = shift_of(&[2, 3], &curves, REACH).unwrap();
        assert!((late - 15.0).abs() < 0.2, "{late}");
        assert!(ratio < 0.75, "{ratio}");
        let (late, _) = shift_of(&[0, 1], &curves, REACH).unwrap();
        assert!((late + 15.0).abs() < 0.2, "{late}");
    }

    #[test]
    fn groups_that_fit_another_shift_hardly_better_are_told_of_none() {
        let flat = [curve([0, 2], 15.0, 0.1), curve([1, 3], 15.0, 0.1)];
        assert_eq!(shift_of(&[2, 3], &flat, REACH), None);
    }
}
