//! The loose limits that no change may exceed. They hold for scenes of a few seconds as well, for which the bars
//! ([`super::bars`]) are too strict.

use farfield_score::Scores;

use crate::suite::people::recovery::{Recovery, slowest_s};
use crate::suite::report::SceneReport;
use crate::suite::report::bars::Bound;

/// Largest MPJPE of a scene in which all people stay in sight, millimetres: half as much again as the bars.
pub const LIMIT_MPJPE_MM: f64 = 35.0;
/// Least success rate of such a scene, percent.
pub const LIMIT_SUCCESS: f64 = 98.0;
/// Most unexcused gaps of a scene, percent of its frames.
pub const LIMIT_GAPS: f64 = 1.0;
/// Most ticks until a person who counts is found.
pub const LIMIT_FOUND_TICKS: i64 = 60;
/// Longest time until a person who returns is found again, seconds: twice the bar.
pub const LIMIT_RETURN_S: f64 = 2.0;
/// Longest time until the skeleton of a lost person fits again, seconds.
pub const LIMIT_RECOVERY_S: f64 = 1.0;

/// A figure with its name and limit.
type LimitedFigure = (&'static str, f64, Bound);

/// Figures worse than the limits, as text.
pub fn behind_limits(reports: &[SceneReport]) -> Vec<String> {
    let mut behind = Vec::new();
    for report in reports {
        let scores = &report.with_range_of_motion;
        let late = report.found_after_ticks.values();
        let late = late.filter(|after| after.is_none_or(|ticks| ticks > LIMIT_FOUND_TICKS));
        let late = ("people found late or never", late.count() as f64);
        let all_in_sight = report.recoveries.is_empty() && scores.lives.return_worst_s.is_none();
        let mut figures = of_gaps(scores, report.gaps_to_answer_for);
        if all_in_sight {
            figures.extend(of_poses(scores));
        }
        figures.push((late.0, late.1, Bound::AtMost(0.0)));
        figures.extend(of_identity(scores, &report.recoveries));
        let missed = figures
            .into_iter()
            .filter(|(_, value, bound)| !bound.holds(*value));
        behind.extend(missed.map(|(measure, value, bound)| {
            format!("[{}] {measure}: {value:.2}, limit {bound:?}", report.scene)
        }));
    }
    behind
}

fn of_gaps(scores: &Scores, gaps: u64) -> Vec<LimitedFigure> {
    let frames: u64 = scores.actors.values().map(|a| a.frames).sum();
    let gaps = 100.0 * gaps as f64 / frames.max(1) as f64;
    vec![("unexcused gaps, %", gaps, Bound::AtMost(LIMIT_GAPS))]
}

/// Poses of people out of sight are extrapolated by the model, so these figures would measure their motion.
fn of_poses(scores: &Scores) -> Vec<LimitedFigure> {
    let mpjpe_mm = scores.mean.mpjpe_mm.unwrap_or(f64::NAN);
    let success = scores.mean.success_150.unwrap_or(f64::NAN);
    vec![
        ("MPJPE, mm", mpjpe_mm, Bound::AtMost(LIMIT_MPJPE_MM)),
        ("success@150, %", success, Bound::AtLeast(LIMIT_SUCCESS)),
    ]
}

fn of_identity(scores: &Scores, recoveries: &[Recovery]) -> Vec<LimitedFigure> {
    let none = Bound::AtMost(0.0);
    let count = |measure, n: u64| (measure, n as f64, none);
    let (identity, lives) = (&scores.identity, &scores.lives);
    let not_kept = recoveries.iter().filter(|lost| !lost.is_fair()).count();
    let mut figures = vec![
        count("id switches", identity.switches),
        count("false births", identity.false_births),
        count("returns with another id", lives.returns_other_id),
        count("ids not kept while lost", not_kept as u64),
    ];
    if let Some(worst_s) = lives.return_worst_s {
        let bound = Bound::AtMost(LIMIT_RETURN_S);
        figures.push(("until found again, s", worst_s, bound));
    }
    if let Some(slowest) = slowest_s(recoveries) {
        let bound = Bound::AtMost(LIMIT_RECOVERY_S);
        figures.push(("until below 50 mm, s", slowest, bound));
    }
    figures
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use farfield_proto::tick::Tick;
    use farfield_score::lines::{PoseLines, TruthExtent};
    use farfield_score::points::{PointSet, ScoredBody};
    use farfield_score::score;
    use nalgebra::Vector3;

    use super::*;

    /// A person with this id at these ticks.
    fn recording(id: u32, ticks: impl Iterator<Item = i64>) -> PoseLines {
        let mut body = ScoredBody::default();
        body.points_m[0] = Some(Vector3::zeros());
        let people = ticks.map(|tick| (Tick(tick), BTreeMap::from([(id, body.clone())])));
        PoseLines::from_people(PointSet::Joints, people.collect())
    }

    fn missed(figures: Vec<LimitedFigure>) -> Vec<&'static str> {
        let missed = figures
            .into_iter()
            .filter(|(_, value, bound)| !bound.holds(*value));
        missed.map(|(measure, ..)| measure).collect()
    }

    #[test]
    fn a_person_never_found_again_is_behind_the_limit() {
        let truth = recording(1, (0..60).chain(120..300));
        let scores_until = |until: i64| {
            score(
                &recording(7, 0..until),
                &truth,
                TruthExtent::Whole,
                Some(60.0),
            )
        };
        assert_eq!(missed(of_identity(&scores_until(300), &[])), [""; 0]);
        let never = of_identity(&scores_until(60), &[]);
        assert_eq!(missed(never), ["until found again, s"]);
    }

    #[test]
    fn an_id_lost_by_a_loss_is_behind_the_limit() {
        let truth = recording(1, 0..60);
        let scores = score(&truth, &truth, TruthExtent::Whole, Some(60.0));
        let lost = |same_id| Recovery {
            actor: 1,
            lost_s: [0.2, 0.4],
            same_id,
            others_id: false,
            gaps: 0,
            worst_mm: None,
            seconds: Some(0.0),
        };
        assert_eq!(missed(of_identity(&scores, &[lost(true)])), [""; 0]);
        let lost = of_identity(&scores, &[lost(true), lost(false)]);
        assert_eq!(missed(lost), ["ids not kept while lost"]);
    }
}
