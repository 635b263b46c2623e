//! Whether the sightings of a camera fit the poses of one shift up to some detection pass, and those of another from there on, or
//! for some passes in the middle: where every recording lost frames at a moment of its own, the others follow.

use farfield_proto::tick::Tick;

use super::super::KeypointHalf;
use super::Search;
use crate::camera_agreement::samples::PassSample;

/// Longest shift that is looked for, seconds.
const LONGEST_S: f64 = 1.0;
/// Fewest moments, apart from each other, at which passes must tell, and keypoints of either part.
pub(super) const MIN_MOMENTS: usize = 3;
const MIN_COMPARED: usize = 50;
/// Passes tell of a moment each where there are so many kept poses from one to the next: half a second.
const MOMENT_POSES: i64 = 12;
/// What the shift of a part must leave of the cost that the other's has there, and the cost up to which it fits at all.
pub(super) const EXPLAINS: f64 = 0.7;
pub(super) const FITS: f64 = 0.45;

/// Two parts of the time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct PoseJump {
    /// Between which two passes.
    pub(in crate::camera_agreement) between: [Tick; 2],
    /// Between which two it is again as it was before; `None` where it is not.
    pub(in crate::camera_agreement) until: Option<[Tick; 2]>,
    /// By how many ticks the sightings before and after are late against the poses.
    pub(in crate::camera_agreement) late_ticks: [f64; 2],
}

/// Per shift, from the most to the one side to the most to the other, the summed cost, and of how many keypoints.
pub(super) type ShiftSums = Vec<(f64, usize)>;

/// What passes that show anybody cost, each.
pub(in crate::camera_agreement::time_shift) type PassCosts = Vec<(Tick, ShiftSums)>;

/// Passes from the one number on, and before the other, that fit a shift of their own, and what all cost then.
struct Stretch {
    passes: [usize; 2],
    /// The shift of the others, and of these.
    shifts: [usize; 2],
    cost: f64,
    is_sure: bool,
}

impl Search<'_> {
    /// The two parts of the time that fit best, where either fits much better with a shift of its own.
    pub(in crate::camera_agreement::time_shift) fn jump(
        &self,
        costs: &PassCosts,
    ) -> Option<PoseJump> {
        let reach = (costs.first()?.1.len() / 2).cast_signed();
        let ticks: Vec<Tick> = costs.iter().map(|(tick, _)| *tick).collect();
        let sums = sums(costs);
        let n = ticks.len();
        let is_part = |[from, to]: &[usize; 2]| {
            let outside = ticks[..*from].iter().chain(&ticks[*to..]);
            let inside = ticks[*from..*to].iter();
            self.moments(outside) >= MIN_MOMENTS && self.moments(inside) >= MIN_MOMENTS
        };
        let best = |parts: &mut dyn Iterator<Item = [usize; 2]>| {
            let all = parts
                .filter(is_part)
                .filter_map(|part| stretch(&sums, part));
            let best = all.min_by(|a, b| a.cost.total_cmp(&b.cost));
            best.filter(|it| it.is_sure)
        };
        let to_the_end = best(&mut (1..n).map(|from| [from, n]));
        let in_the_middle = || {
            let ends = |from: usize| (from + 1..n).map(move |to| [from, to]);
            let found = best(&mut (1..n).flat_map(ends))?;
            let [outside, inside] = found
                .shifts
                .map(|index| index.abs_diff(reach.cast_unsigned()));
            (outside < inside).then_some(found)
        };
        let found = match (to_the_end, in_the_middle()) {
            (Some(end), Some(middle)) if middle.cost < EXPLAINS * end.cost => middle,
            (end, middle) => end.or(middle)?,
        };
        let between = |at: usize| [ticks[at - 1], ticks[at]];
        let [from, to] = found.passes;
        Some(PoseJump {
            between: between(from),
            until: (to < n).then(|| between(to)),
            late_ticks: found.shifts.map(|index| {
                let shift = index.cast_signed() - reach;
                self.ticks(shift as f64)
            }),
        })
    }

    /// How many of these ticks are so far from each other that poses between them tell more than one of them.
    pub(super) fn moments<'t>(&self, ticks: impl Iterator<Item = &'t Tick>) -> usize {
        let mut moments: Vec<Tick> = Vec::new();
        for &tick in ticks {
            if moments
                .last()
                .is_none_or(|last| tick - *last >= MOMENT_POSES * self.every)
            {
                moments.push(tick);
            }
        }
        moments.len()
    }

    /// What each pass costs by shift.
    pub(in crate::camera_agreement::time_shift) fn pass_costs(&self, rate_hz: f64) -> PassCosts {
        let per_pose_s = self.every as f64 / rate_hz;
        let reach = (LONGEST_S / per_pose_s).round() as isize;
        let of = |pass: &&PassSample| {
            let seen = self.sighted(KeypointHalf::All, &[*pass]);
            let costs = (-reach..=reach).map(|shift| self.cost_at(&seen, shift));
            (!seen.is_empty()).then(|| (pass.tick, costs.collect()))
        };
        self.passes.iter().filter_map(of).collect()
    }
}

/// Of the first so many passes what they cost together.
fn sums(costs: &PassCosts) -> Vec<ShiftSums> {
    let n_shifts = costs.first().map_or(0, |(_, costs)| costs.len());
    let mut all: Vec<ShiftSums> = vec![vec![(0.0, 0); n_shifts]];
    for (_, own) in costs {
        if let Some(before) = all.last() {
            let sums = before.iter().zip(own);
            let sums = sums.map(|((sum, n), (cost, own))| (sum + cost, n + own));
            let sums = sums.collect();
            all.push(sums);
        }
    }
    all
}

/// How passes fit that have a shift of their own, where enough is known of either part.
fn stretch(sums: &[ShiftSums], passes: [usize; 2]) -> Option<Stretch> {
    let [from, to] = passes;
    let (before, up_to, all) = (sums.get(from)?, sums.get(to)?, sums.last()?);
    let inside = || {
        let both = up_to.iter().zip(before);
        both.map(|(up_to, before)| (up_to.0 - before.0, up_to.1 - before.1))
    };
    let outside = || {
        let both = all.iter().zip(inside());
        both.map(|(all, inside)| (all.0 - inside.0, all.1 - inside.1))
    };
    let means = |sums: &mut dyn Iterator<Item = (f64, usize)>| -> Vec<(f64, usize)> {
        let known = sums.map(|(sum, n)| {
            let is_known = n >= MIN_COMPARED;
            (if is_known { sum / n as f64 } else { f64::NAN }, n)
        });
        known.collect()
    };
    let least = |means: &[(f64, usize)]| {
        let known = means.iter().enumerate().filter(|(_, it)| it.0.is_finite());
        known.min_by(|a, b| a.1.0.total_cmp(&b.1.0)).map(|it| it.0)
    };
    let (outside, inside) = (means(&mut outside()), means(&mut inside()));
    let shifts = [least(&outside)?, least(&inside)?];
    let [own, other] = shifts;
    let parts = [outside[own], inside[other]];
    let n: usize = parts.iter().map(|(_, n)| n).sum();
    let cost = parts.iter().map(|(mean, n)| mean * *n as f64).sum::<f64>() / n as f64;
    let explains = |there: f64, here: f64| there < FITS && there < EXPLAINS * here;
    let is_sure =
        explains(outside[own].0, outside[other].0) && explains(inside[other].0, inside[own].0);
    Some(Stretch {
        passes,
        shifts,
        cost,
        is_sure,
    })
}
