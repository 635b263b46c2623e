//! Errors of the poses of a run: mean and worst.

use std::collections::BTreeMap;

use farfield_proto::order_statistics::value_after;
use farfield_score::lines::PoseLines;
use farfield_score::matches_at;
use farfield_score::points::ScoredBody;
use serde::Serialize;

/// Errors of single points over a run, millimetres.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Default)]
pub struct Errors {
    /// Mean over all points, people and ticks.
    pub mpjpe_mm: f64,
    /// 99th percentile.
    pub p99_mm: f64,
    /// The largest.
    pub worst_mm: f64,
    /// Truths without a pose.
    pub gaps: u64,
    /// Times that the id of a person's pose changed.
    pub switches: u64,
}

impl Errors {
    /// Errors of `poses` relative to `truth`.
    pub fn measure(poses: &PoseLines, truth: &PoseLines) -> Self {
        let mut all = Vec::new();
        let (mut gaps, mut switches) = (0, 0);
        let mut ids: BTreeMap<u32, u32> = BTreeMap::new();
        for tick in truth.ticks() {
            let matches = matches_at(tick, poses, truth);
            let Some(people) = truth.people_at(tick) else {
                continue;
            };
            for (actor, body) in people {
                let id = matches.get(actor);
                let pose = id.and_then(|id| poses.people_at(tick)?.get(id));
                let (Some(id), Some(pose)) = (id, pose) else {
                    gaps += 1;
                    continue;
                };
                let before = ids.insert(*actor, *id);
                switches += u64::from(before.is_some_and(|before| before != *id));
                all.extend(distances_mm(body, pose));
            }
        }
        all.sort_by(f64::total_cmp);
        Self {
            mpjpe_mm: all.iter().sum::<f64>() / all.len().max(1) as f64,
            p99_mm: value_after(&all, 0.99).unwrap_or(0.0),
            worst_mm: all.last().copied().unwrap_or(0.0),
            gaps,
            switches,
        }
    }
}

fn distances_mm<'a>(truth: &'a ScoredBody, pose: &'a ScoredBody) -> impl Iterator<Item = f64> + 'a {
    let pairs = truth.points_m.iter().zip(&pose.points_m);
    pairs.filter_map(|(truth, pose)| Some(1000.0 * ((*truth)? - (*pose)?).norm()))
}
