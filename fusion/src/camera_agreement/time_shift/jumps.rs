//! Cameras that are late for a part of the time only: recordings that lost frames, or that wrote some twice.

use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;

use super::by_burst::BurstShifts;
use super::met::PoseFit;
use super::pose_shift::PoseJump;
use super::{LATE_DIFFERENCE_TICKS, LATE_TICKS};

/// Least change that is told of, ticks; and seconds, of what sightings alone show.
const LEAST_TICKS: f64 = 2.0 * LATE_TICKS;
const LEAST_S: f64 = 0.06;

/// A camera that is late by one time up to some tick, and by another from there on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Jump {
    /// Ticks before and after, against the others.
    pub(in crate::camera_agreement) late_ticks: [f64; 2],
    /// When, nearly.
    pub(in crate::camera_agreement) at: Tick,
    /// When it is again as it was before; `None` where it is not.
    pub(in crate::camera_agreement) until: Option<Tick>,
    /// Whether sightings and poses alone tell it.
    pub(in crate::camera_agreement) is_of_poses: bool,
}

/// Per camera its jump, by what crops show burst by burst, else by that `of` its sightings and poses.
pub(in crate::camera_agreement) fn jumps(
    bursts: &[BurstShifts],
    fits: &[PoseFit],
    of: fn(&PoseFit) -> Option<PoseJump>,
    rate_hz: f64,
) -> Vec<Option<Jump>> {
    let all = fits.iter().enumerate();
    all.map(|(camera, fit)| jump(bursts, of(fit), (camera, rate_hz)))
        .collect()
}

fn jump(
    bursts: &[BurstShifts],
    of_poses: Option<PoseJump>,
    (camera, rate_hz): (usize, f64),
) -> Option<Jump> {
    let told: Vec<([Tick; 2], f64)> = bursts
        .iter()
        .filter_map(|burst| Some((burst.ticks, burst.told(camera)?)))
        .collect();
    // Where bursts know of no change there is one after the last at the most.
    let is_known = |jump: &PoseJump| {
        let last = told.last().filter(|_| told.len() >= 2);
        last.is_some_and(|(ticks, _)| jump.between[0] < ticks[1])
    };
    if let Some((between, late_ticks)) = split(&told) {
        // Passes come more often than bursts.
        let is_inside = |jump: &PoseJump| {
            let [from, to] = jump.between;
            jump.until.is_none() && from >= between[0] && to <= between[1]
        };
        let between = of_poses
            .filter(is_inside)
            .map_or(between, |jump| jump.between);
        return Some(Jump {
            late_ticks,
            at: middle(between),
            until: None,
            is_of_poses: false,
        });
    }
    if let Some(jump) = in_the_middle(&told) {
        return Some(jump);
    }
    let jump = of_poses.filter(|jump| !is_known(jump))?;
    let [before, after] = jump.late_ticks;
    if (after - before).abs() < LEAST_TICKS.max(LEAST_S * rate_hz) {
        return None;
    }
    // Poses are a little before or after what all cameras show: the part that is nearer to them is on time, or that which is so
    // before and again.
    let right = if before.abs() <= after.abs() || jump.until.is_some() {
        before
    } else {
        after
    };
    let late_ticks = [before - right, after - right];
    Some(Jump {
        late_ticks,
        at: middle(jump.between),
        until: jump.until.map(middle),
        is_of_poses: true,
    })
}

fn middle([from, to]: [Tick; 2]) -> Tick {
    from + (to - from) / 2
}

/// Between which two bursts a camera became late, or was no longer, where it is equally late in all before and in all after.
fn split(told: &[([Tick; 2], f64)]) -> Option<([Tick; 2], [f64; 2])> {
    let mut parts = (1..told.len()).filter_map(|at| {
        let (before, after) = told.split_at(at);
        let middle = |part: &[([Tick; 2], f64)]| upper_median(part.iter().map(|it| it.1).collect());
        let late_ticks = [middle(before)?, middle(after)?];
        let is_split = is_steady(before, late_ticks[0])
            && is_steady(after, late_ticks[1])
            && (late_ticks[1] - late_ticks[0]).abs() >= LEAST_TICKS;
        let between = [before.last()?.0[1], after.first()?.0[0]];
        is_split.then_some((between, late_ticks))
    });
    parts.next_back()
}

/// From and until when a camera was late that is on time before and after, by bursts in which it is equally late.
fn in_the_middle(told: &[([Tick; 2], f64)]) -> Option<Jump> {
    let ends = |from: usize| (from + 1..told.len()).map(move |to| [from, to]);
    let mut parts = (1..told.len()).flat_map(ends).filter_map(|[from, to]| {
        let inside = &told[from..to];
        let outside: Vec<_> = told[..from].iter().chain(&told[to..]).copied().collect();
        let middle = |part: &[([Tick; 2], f64)]| upper_median(part.iter().map(|it| it.1).collect());
        let late_ticks = [middle(&outside)?, middle(inside)?];
        let are_steady = is_steady(&outside, late_ticks[0]) && is_steady(inside, late_ticks[1]);
        let is_on_time = late_ticks[0].abs() < LATE_TICKS;
        let is_apart = (late_ticks[1] - late_ticks[0]).abs() >= LEAST_TICKS;
        let is_told = are_steady && is_on_time && is_apart;
        is_told.then(|| Jump {
            late_ticks,
            at: self::middle([told[from - 1].0[1], told[from].0[0]]),
            until: Some(self::middle([told[to - 1].0[1], told[to].0[0]])),
            is_of_poses: false,
        })
    });
    parts.next()
}

/// Whether a camera is equally late in all these bursts.
fn is_steady(part: &[([Tick; 2], f64)], late: f64) -> bool {
    part.iter()
        .all(|it| (it.1 - late).abs() <= LATE_DIFFERENCE_TICKS)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn split_at(late: &[f64]) -> Option<(i64, [f64; 2])> {
        let burst = |(index, late): (usize, &f64)| {
            let first = Tick(600 * index.cast_signed() as i64);
            ([first, first + 120], *late)
        };
        let told: Vec<([Tick; 2], f64)> = late.iter().enumerate().map(burst).collect();
        split(&told).map(|(between, late)| (middle(between).0, late))
    }

    #[test]
    fn a_camera_that_is_late_in_the_middle_is_told_with_both_moments() {
        let burst = |(index, late): (usize, &f64)| {
            let first = Tick(600 * index.cast_signed() as i64);
            ([first, first + 120], *late)
        };
        let found = |late: &[f64]| {
            let told: Vec<_> = late.iter().enumerate().map(burst).collect();
            in_the_middle(&told).map(|jump| (jump.at.0, jump.until.map(|at| at.0), jump.late_ticks))
        };
        let told = Some((360, Some(1560), [0.1, 6.1]));
        assert_eq!(found(&[0.1, 6.0, 6.1, 0.0]), told);
        // Late before and after, too: that is said of all the time.
        assert_eq!(found(&[6.0, 0.0, 0.0, 6.0]), None);
        assert_eq!(found(&[3.0, 6.0, 6.0, 3.0]), None);
        assert_eq!(found(&[0.0, 6.0, 3.0, 0.0]), None);
        assert_eq!(found(&[0.0, 6.0, 6.0]), None);
        assert_eq!(found(&[0.0, 6.0, 0.0, 3.0]), None);
    }

    #[test]
    fn a_camera_that_became_late_between_two_bursts_is_told_and_one_that_drifts_or_is_always_late_is_not()
     {
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
