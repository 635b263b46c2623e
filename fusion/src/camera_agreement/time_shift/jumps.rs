//! Cameras that are late from some tick on, or until then: recordings that lost frames, or that hold some twice.

use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;

use super::by_burst::BurstShifts;
use super::{LATE_DIFFERENCE_TICKS, LATE_TICKS};

/// Least change that is reported, ticks.
const MIN_CHANGE_TICKS: f64 = 2.0 * LATE_TICKS;

/// A camera that is late by one time up to some tick, and by another from there on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Jump {
    /// Ticks before and after, against the others.
    pub(in crate::camera_agreement) late_ticks: [f64; 2],
    /// When, nearly.
    pub(in crate::camera_agreement) at: Tick,
}

/// The ticks of a burst, first and one after the last, and the lateness of a camera in it, ticks.
type KnownBurst = ([Tick; 2], f64);

/// The jump of a camera, by what its crops show burst by burst.
pub(in crate::camera_agreement) fn jump(bursts: &[BurstShifts], camera: usize) -> Option<Jump> {
    let known = bursts
        .iter()
        .filter_map(|burst| Some((burst.ticks, burst.told(camera)?)));
    split(&known.collect::<Vec<KnownBurst>>())
}

/// The last place between two bursts where a camera is equally late in all before, and in all after.
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

/// Whether a camera is equally late in all these bursts.
fn is_steady(bursts: &[KnownBurst], late_ticks: f64) -> bool {
    let is_same = |(_, late): &KnownBurst| (late - late_ticks).abs() <= LATE_DIFFERENCE_TICKS;
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
    fn a_jump_is_found_between_two_bursts_and_a_drift_or_a_constant_is_none() {
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
