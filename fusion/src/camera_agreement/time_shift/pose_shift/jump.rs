//! Whether the sightings of a camera fit the poses of one shift up to some detection pass, and those of another from there on.

use farfield_proto::tick::Tick;

use super::super::KeypointHalf;
use super::Search;
use crate::camera_agreement::samples::PassSample;

/// Longest shift that is looked for, seconds.
const LONGEST_S: f64 = 1.0;
/// Fewest passes and keypoints of either part.
const MIN_PASSES: usize = 3;
const MIN_COMPARED: usize = 50;
/// What the shift of a part must leave of the cost that the other's has there, and the cost up to which it fits at all.
const EXPLAINS: f64 = 0.7;
const FITS: f64 = 0.45;

/// Two parts of the time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct PoseJump {
    /// Between which two passes.
    pub(in crate::camera_agreement) between: [Tick; 2],
    /// By how many ticks the sightings before and after are late against the poses.
    pub(in crate::camera_agreement) late_ticks: [f64; 2],
}

/// Of a pass, per shift the summed cost; and of how many keypoints.
type PassCosts = (Tick, Vec<(f64, usize)>);

impl Search<'_> {
    /// The two parts of the time that fit best, where either fits much better with a shift of its own.
    pub(in crate::camera_agreement::time_shift) fn jump(&self, rate_hz: f64) -> Option<PoseJump> {
        let per_pose_s = self.every as f64 / rate_hz;
        let reach = (LONGEST_S / per_pose_s).round() as isize;
        let costs = self.costs_of_passes(reach);
        let n_shifts = 2 * reach.cast_unsigned() + 1;
        let sum = |passes: &[PassCosts]| {
            let mut all = vec![(0.0, 0); n_shifts];
            for (_, costs) in passes {
                for (all, (cost, n)) in all.iter_mut().zip(costs) {
                    *all = (all.0 + cost, all.1 + n);
                }
            }
            all
        };
        let mean = |(cost, n): (f64, usize)| {
            if n >= MIN_COMPARED {
                cost / n as f64
            } else {
                f64::NAN
            }
        };
        let least = |all: &[(f64, usize)]| {
            let known = all.iter().map(|it| mean(*it)).enumerate();
            let known = known.filter(|(_, cost)| cost.is_finite());
            known.min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let splits = MIN_PASSES..costs.len().saturating_sub(MIN_PASSES - 1);
        let weighed = splits.filter_map(|at| {
            let (before, after) = (sum(&costs[..at]), sum(&costs[at..]));
            let (own, cost) = least(&before)?;
            let (other, other_cost) = least(&after)?;
            let n = [before[own].1, after[other].1].map(|n| n as f64);
            let all = (cost * n[0] + other_cost * n[1]) / (n[0] + n[1]);
            let explains = |there: f64, here: f64| there < FITS && there < EXPLAINS * here;
            let is_sure =
                explains(cost, mean(before[other])) && explains(other_cost, mean(after[own]));
            Some((all, at, [own, other], is_sure))
        });
        let (_, at, shifts, is_sure) = weighed.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let late_ticks = shifts.map(|index| {
            let shift = index.cast_signed() - reach;
            self.ticks(shift as f64)
        });
        is_sure.then(|| PoseJump {
            between: [costs[at - 1].0, costs[at].0],
            late_ticks,
        })
    }

    fn costs_of_passes(&self, reach: isize) -> Vec<PassCosts> {
        let mut all: Vec<PassCosts> = Vec::new();
        for pass in self.passes {
            let of: [&PassSample; 1] = [pass];
            let seen = self.sighted(KeypointHalf::All, &of);
            if !seen.is_empty() {
                let costs = (-reach..=reach).map(|shift| self.cost_at(&seen, shift));
                all.push((pass.tick, costs.collect()));
            }
        }
        all
    }
}
