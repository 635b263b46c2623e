//! The shift of a group of cameras that are late by the same time, such as those of one recorder.
//!
//! Half of the cameras that each is compared with are as late as it is. So one camera alone may
//! give too little evidence. All pairs across the two groups together give one shift.

use farfield_proto::order_statistics::upper_median;

use super::curves::{Curve, CurvePart, ShiftCosts};
use super::{
    KeypointHalf, MIN_MEDIAN_RATIO, MIN_SHARPNESS_RATIO, SHARP_TICKS, Shift, index,
    is_clear_minimum, least, vertex,
};

/// Least number of bursts, that of ten seconds. In three or four seconds of the Shelf people
/// hardly move, and right cameras seem to belong to two recorders.
const MIN_BURSTS: usize = 3;
/// Least number of cameras of either group.
const MIN_CAMERAS: usize = 2;
/// Largest lateness of a camera that is on time, ticks.
const MAX_ON_TIME_TICKS: f64 = 1.0;
/// Largest difference between the halves of the keypoints, as a share of the shift. Two of the
/// forty shifts that were examined on the Shelf are as near to each other by chance.
const MAX_DIFFERENCE_RATIO: f64 = 0.1;

/// Cameras that are late by the same time.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::camera_agreement) struct LateGroup {
    pub(in crate::camera_agreement) cameras: Vec<usize>,
    pub(in crate::camera_agreement) late_ticks: f64,
    /// Cost between the group and the others with the shift, over that without.
    pub(in crate::camera_agreement) ratio: f64,
}

/// The cameras that are late by about the same time while others are on time, if all pairs of the
/// two groups together confirm it.
pub(in crate::camera_agreement) fn late_group(
    costs: &mut ShiftCosts<'_>,
    shifts: &[Option<Shift>],
) -> Option<LateGroup> {
    if costs.bursts().len() < MIN_BURSTS {
        return None;
    }
    let cameras = late_cameras(shifts)?;
    let reach = costs.reach;
    let mut by_half = |half| {
        let curves = costs.curves(CurvePart { half, burst: None });
        group_shift(&cameras, &curves, reach)
    };
    let (late_ticks, ratio) = by_half(KeypointHalf::All)?;
    let halves = [
        by_half(KeypointHalf::OddPairs)?.0,
        by_half(KeypointHalf::EvenPairs)?.0,
    ];
    let is_same = |half: &f64| (half - late_ticks).abs() <= MAX_DIFFERENCE_RATIO * late_ticks.abs();
    halves.iter().all(is_same).then_some(LateGroup {
        cameras,
        late_ticks,
        ratio,
    })
}

/// The cameras that are late, or early, by about the same time, if enough others are on time.
fn late_cameras(shifts: &[Option<Shift>]) -> Option<Vec<usize>> {
    let known = shifts.iter().enumerate();
    let known = known.filter_map(|(camera, shift)| Some((camera, shift.as_ref()?.late_ticks)));
    let (on_time, late): (Vec<_>, Vec<_>) =
        known.partition(|(_, late)| late.abs() <= MAX_ON_TIME_TICKS);
    let middle = upper_median(late.iter().map(|(_, late)| *late).collect())?;
    let is_near = |(_, late): &(usize, f64)| (late - middle).abs() <= SHARP_TICKS as f64;
    let are_enough = on_time.len() >= MIN_CAMERAS && late.len() >= MIN_CAMERAS;
    let are_groups = are_enough && middle.abs() > SHARP_TICKS as f64 && late.iter().all(is_near);
    are_groups.then(|| late.into_iter().map(|(camera, _)| camera).collect())
}

/// By how many ticks these cameras are late against all others, and the cost ratio. `None` unless
/// one shift costs clearly less than most others, than its neighbours, and than no shift.
fn group_shift(cameras: &[usize], curves: &[Curve], reach: usize) -> Option<(f64, f64)> {
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
    let near = [at.checked_sub(SHARP_TICKS), Some(at + SHARP_TICKS)];
    let near = near.into_iter().flatten().filter_map(|at| sums.get(at));
    let mut near = near.filter(|cost| cost.is_finite());
    let now = sums[index(0, reach)];
    let is_sure = is_clear_minimum(&sums, at)
        && near.all(|near| *near >= MIN_SHARPNESS_RATIO * cost)
        && now >= MIN_MEDIAN_RATIO * cost;
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
    fn cameras_that_are_equally_late_are_a_group() {
        let group = |late: &[Option<f64>]| late_cameras(&shifts(late));
        let late = [Some(0.0), Some(-16.0), Some(-0.1), None, Some(-18.6)];
        assert_eq!(group(&late), Some(vec![1, 4]));
        // One camera alone, two different shifts, and a shift of a few ticks.
        assert_eq!(group(&[Some(0.0), Some(-16.0), Some(0.2)]), None);
        assert_eq!(group(&[Some(0.0), Some(20.0), Some(0.2), Some(11.0)]), None);
        assert_eq!(group(&[Some(0.0), Some(3.0), Some(0.2), Some(3.1)]), None);
    }

    /// The curve of two cameras, the second of which is `late` ticks late.
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
    fn all_pairs_of_two_groups_give_the_shift_between_them() {
        // The third and the fourth are late against the first two.
        let mut curves = vec![curve([0, 1], 0.0, 0.5), curve([2, 3], 0.0, 0.5)];
        for (pair, late) in [
            ([0, 2], 15.0),
            ([0, 3], 15.5),
            ([1, 2], 14.5),
            ([1, 3], 15.0),
        ] {
            curves.push(curve(pair, late, 0.4));
        }
        let (late, ratio) = group_shift(&[2, 3], &curves, REACH).unwrap();
        assert!((late - 15.0).abs() < 0.2, "{late}");
        assert!(ratio < 0.75, "{ratio}");
        let (late, _) = group_shift(&[0, 1], &curves, REACH).unwrap();
        assert!((late + 15.0).abs() < 0.2, "{late}");
    }

    #[test]
    fn a_shift_that_fits_hardly_better_is_not_reported() {
        let flat = [curve([0, 2], 15.0, 0.1), curve([1, 3], 15.0, 0.1)];
        assert_eq!(group_shift(&[2, 3], &flat, REACH), None);
    }
}
