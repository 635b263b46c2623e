//! The shifts of cameras burst by burst: drifts and jumps. A recording jumps if frames are lost or
//! doubled in it.

use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;

use super::super::samples::Burst;
use super::curves::{CurvePart, ShiftCosts};
use super::{
    KeypointHalf, LATE_TICKS, MAX_LATE_DIFFERENCE_TICKS, Shift, align_reference, is_same, shifts_of,
};

/// Least time between the first and the last burst of a drift, minutes.
const MIN_DRIFT_MINUTES: f64 = 0.08;
/// Least change between two bursts that is reported as a jump, ticks.
const MIN_CHANGE_TICKS: f64 = 2.0 * LATE_TICKS;

/// The shifts of all cameras in one burst, for both halves of the keypoints.
pub(in crate::camera_agreement) struct BurstShifts {
    /// From its first tick to the one after its last.
    pub(in crate::camera_agreement) ticks: [Tick; 2],
    odd: Vec<Option<Shift>>,
    even: Vec<Option<Shift>>,
}

impl BurstShifts {
    /// By how many ticks a camera is late, if both halves are sharp and agree.
    fn late_ticks(&self, camera: usize) -> Option<f64> {
        let (odd, even) = (self.odd[camera]?, self.even[camera]?);
        let is_known = odd.is_sharp && even.is_sharp && is_same(odd.late_ticks, even.late_ticks);
        is_known.then_some(0.5 * (odd.late_ticks + even.late_ticks))
    }
}

/// The shifts of each burst, with the reference of `all`, the shifts over the whole time.
pub(in crate::camera_agreement) fn shifts_by_burst(
    costs: &mut ShiftCosts<'_>,
    all: &[Option<Shift>],
) -> Vec<BurstShifts> {
    let bursts: Vec<_> = costs.bursts().enumerate().collect();
    let in_burst = |(index, burst): (usize, &Burst)| {
        let mut half = |half| {
            let burst = Some(index);
            let mut shifts = shifts_of(costs, CurvePart { half, burst }, all);
            align_reference(&mut shifts, all);
            shifts
        };
        BurstShifts {
            ticks: [
                burst.first,
                burst.first + burst.n_ticks().cast_signed() as i64,
            ],
            odd: half(KeypointHalf::OddPairs),
            even: half(KeypointHalf::EvenPairs),
        }
    };
    bursts.into_iter().map(in_burst).collect()
}

/// The drift of a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Drift {
    /// Increase of its lateness per minute, ticks.
    pub(in crate::camera_agreement) ticks_per_minute: f64,
    /// Whether the bursts lie on a line that is steep enough.
    pub(in crate::camera_agreement) is_significant: bool,
}

/// The drift per camera; `None` if its lateness is known in fewer than three bursts, or if these lie too near together.
pub(in crate::camera_agreement) fn drifts(
    bursts: &[BurstShifts],
    n_cameras: usize,
    rate_hz: f64,
) -> Vec<Option<Drift>> {
    let minutes_at = |burst: &BurstShifts| burst.ticks[0].0 as f64 / rate_hz / 60.0;
    let drift = |camera: usize| {
        let known = bursts
            .iter()
            .filter_map(|burst| Some((minutes_at(burst), burst.late_ticks(camera)?)));
        let known: Vec<(f64, f64)> = known.collect();
        let (&(from, before), &(to, after)) = (known.first()?, known.last()?);
        let minutes = to - from;
        if known.len() < 3 || minutes < MIN_DRIFT_MINUTES {
            return None;
        }
        let rate = (after - before) / minutes;
        let is_on_line = |&(at, late): &(f64, f64)| {
            let expected = before + rate * (at - from);
            (late - expected).abs() <= MAX_LATE_DIFFERENCE_TICKS
        };
        let is_steep = (after - before).abs() >= 2.0 * LATE_TICKS;
        Some(Drift {
            ticks_per_minute: rate,
            is_significant: is_steep && known.iter().all(is_on_line),
        })
    };
    (0..n_cameras).map(drift).collect()
}

/// A change of a camera's lateness from one constant value to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Jump {
    /// Lateness against the others before and after, ticks.
    pub(in crate::camera_agreement) late_ticks: [f64; 2],
    /// Middle of the gap between the two bursts around the change.
    pub(in crate::camera_agreement) at: Tick,
}

/// The first tick of a burst, the one after its last, and the lateness of a camera in it, ticks.
type KnownBurst = ([Tick; 2], f64);

/// The jump of a camera between two bursts.
pub(in crate::camera_agreement) fn jump(bursts: &[BurstShifts], camera: usize) -> Option<Jump> {
    let known = bursts
        .iter()
        .filter_map(|burst| Some((burst.ticks, burst.late_ticks(camera)?)));
    split(&known.collect::<Vec<KnownBurst>>())
}

/// The last gap between bursts with a constant lateness before it, and another one after it.
fn split(bursts: &[KnownBurst]) -> Option<Jump> {
    let mut parts = (1..bursts.len()).filter_map(|index| {
        let (before, after) = bursts.split_at(index);
        let late_ticks = [median(before)?, median(after)?];
        let is_split = is_steady(before, late_ticks[0])
            && is_steady(after, late_ticks[1])
            && (late_ticks[1] - late_ticks[0]).abs() >= MIN_CHANGE_TICKS;
        let (from, to) = (before.last()?.0[1], after.first()?.0[0]);
        let at = from + (to - from) / 2;
        is_split.then_some(Jump { late_ticks, at })
    });
    parts.next_back()
}

fn median(bursts: &[KnownBurst]) -> Option<f64> {
    upper_median(bursts.iter().map(|(_, late)| *late).collect())
}

fn is_steady(bursts: &[KnownBurst], late_ticks: f64) -> bool {
    let is_same = |(_, late): &KnownBurst| (late - late_ticks).abs() <= MAX_LATE_DIFFERENCE_TICKS;
    bursts.iter().all(is_same)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split_at(late: &[f64]) -> Option<(i64, [f64; 2])> {
        let burst = |(index, late): (usize, &f64)| {
            let first = Tick(600 * index.cast_signed() as i64);
            ([first, first + 120], *late)
        };
        let known: Vec<KnownBurst> = late.iter().enumerate().map(burst).collect();
        split(&known).map(|jump| (jump.at.0, jump.late_ticks))
    }

    #[test]
    fn a_jump_lies_between_constant_parts_and_a_drift_is_none() {
        assert_eq!(split_at(&[0.0, 0.1, 5.0]), Some((960, [0.1, 5.0])));
        assert_eq!(split_at(&[-3.0, 0.0]), Some((360, [-3.0, 0.0])));
        for late in [
            &[5.0, 5.1, 5.0][..],
            &[0.0, 2.0, 4.0],
            &[0.0, 1.0, 1.0],
            &[0.0],
        ] {
            assert_eq!(split_at(late), None, "{late:?}");
        }
    }
}
