//! The bars that a suite's figures should reach. The limits that no change may exceed are looser ([`super::limits`]).

use std::fmt;

use farfield_score::MeanScore;
use serde::Serialize;

use crate::suite::people::recovery::{Recovery, slowest_s};
use crate::suite::report::SceneReport;

/// The bound of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Bound {
    /// At least.
    AtLeast(f64),
    /// At most.
    AtMost(f64),
    /// Less than.
    Below(f64),
}

impl Bound {
    pub(super) fn holds(self, value: f64) -> bool {
        match self {
            Self::AtLeast(bound) => value >= bound,
            Self::AtMost(bound) => value <= bound,
            Self::Below(bound) => value < bound,
        }
    }
}

/// A figure with its bar.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BarVerdict {
    /// The scenes of the mean.
    pub scenes: String,
    /// What was measured, with its unit.
    pub measure: &'static str,
    /// The figure; `None` without data, which reaches no bar.
    pub value: Option<f64>,
    /// The bar.
    pub bound: Bound,
    /// Whether the figure reaches it.
    pub reached: bool,
}

impl BarVerdict {
    fn new(scenes: &str, measure: &'static str, value: Option<f64>, bound: Bound) -> Self {
        Self {
            scenes: scenes.to_owned(),
            measure,
            value,
            bound,
            reached: value.is_some_and(|value| bound.holds(value)),
        }
    }
}

impl fmt::Display for BarVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let value = self
            .value
            .map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
        let (relation, bound) = match self.bound {
            Bound::AtLeast(bound) => (">=", bound),
            Bound::AtMost(bound) => ("<=", bound),
            Bound::Below(bound) => ("< ", bound),
        };
        let word = if self.reached { "reached" } else { "MISSED" };
        write!(
            f,
            "{:>22}  {:<28} {value:>8} {relation} {bound:>7.2}  {word}",
            self.scenes, self.measure
        )
    }
}

/// A bar on the mean over scenes.
struct Group {
    scenes: &'static [&'static str],
    measure: &'static str,
    figure: fn(&MeanScore) -> Option<f64>,
    from_maps: Bound,
    /// `None`: there is no bar from pixels.
    from_pixels: Option<Bound>,
}

/// Five people who move fast, touch, or stand on their hands.
const FIVE: &[&str] = &["e", "f", "g"];

const GROUPS: [Group; 7] = [
    Group {
        scenes: FIVE,
        measure: "success@150, %",
        figure: |m| m.success_150,
        from_maps: Bound::AtLeast(99.95),
        from_pixels: Some(Bound::AtLeast(99.9)),
    },
    Group {
        scenes: FIVE,
        measure: "MPJPE, mm",
        figure: |m| m.mpjpe_mm,
        from_maps: Bound::AtMost(22.5),
        from_pixels: Some(Bound::AtMost(26.0)),
    },
    Group {
        scenes: FIVE,
        measure: "MPJPE to sites, mm",
        figure: |m| m.mpjpe_sites_mm,
        from_maps: Bound::AtMost(22.0),
        from_pixels: None,
    },
    Group {
        scenes: FIVE,
        measure: "PCP both ends, %",
        figure: |m| m.pcp_both_ends,
        from_maps: Bound::AtLeast(99.7),
        from_pixels: Some(Bound::AtLeast(99.5)),
    },
    Group {
        scenes: FIVE,
        measure: "PCK@50, %",
        figure: |m| m.pck_50,
        from_maps: Bound::AtLeast(96.0),
        from_pixels: Some(Bound::AtLeast(93.0)),
    },
    Group {
        scenes: &["b", "d", "h"],
        measure: "MPJPE, mm",
        figure: |m| m.mpjpe_mm,
        from_maps: Bound::AtMost(30.0),
        from_pixels: Some(Bound::AtMost(35.0)),
    },
    Group {
        scenes: &["futsal"],
        measure: "MPJPE, mm",
        figure: |m| m.mpjpe_mm,
        from_maps: Bound::AtMost(30.0),
        from_pixels: None,
    },
];

/// MPJPE of two people in a hug, millimetres.
const HUG_MPJPE_MM: f64 = 45.0;
/// Longest time until a person in the images of two viewpoints has a pose, seconds.
const BIRTH_S: f64 = 1.0;
/// Longest time until the skeleton of a lost person fits again, seconds.
const RECOVERY_S: f64 = 0.2;
/// The same after all links were cut for longer than [`SHORT_S`].
const LONG_RECOVERY_S: f64 = 1.5;
/// Longest cut that counts as a hiccup, seconds.
const SHORT_S: f64 = 0.9;
/// Least number of crossings in the scene that tests them.
const CROSSINGS: f64 = 20.0;

/// Largest cost of range of motion, millimetres.
const RANGE_OF_MOTION_COSTS_MM: f64 = 1.0;
/// Share of the baseline's foot slide.
const SLIDE_SHARE: f64 = 0.5;

/// The bars of `reports`; those of a group only if all its scenes are present.
pub fn verdicts(reports: &[SceneReport]) -> Vec<BarVerdict> {
    let mut verdicts = Vec::new();
    for bar in GROUPS {
        let group: Vec<&SceneReport> = bar
            .scenes
            .iter()
            .filter_map(|name| reports.iter().find(|r| r.scene == *name))
            .collect();
        let pixels = group.iter().any(|r| r.input == "pixels");
        let bound = if pixels {
            bar.from_pixels
        } else {
            Some(bar.from_maps)
        };
        if let Some(bound) = bound.filter(|_| group.len() == bar.scenes.len()) {
            let figures = group
                .iter()
                .map(|r| (bar.figure)(&r.with_range_of_motion.mean));
            let sum: Option<f64> = figures.sum();
            let value = sum.map(|sum| sum / group.len() as f64);
            let scenes = bar.scenes.join(",");
            verdicts.push(BarVerdict::new(&scenes, bar.measure, value, bound));
        }
    }
    for report in reports {
        verdicts.extend(of_scene(report));
    }
    verdicts
}

fn of_scene(report: &SceneReport) -> Vec<BarVerdict> {
    let (with, without) = (
        &report.with_range_of_motion,
        &report.without_range_of_motion,
    );
    let baseline = &report.baseline.scores;
    let verdict = |measure, value, bound| BarVerdict::new(&report.scene, measure, value, bound);
    let gaps = report.gaps_to_answer_for as f64;
    let switches = with.identity.switches as f64;
    let mut verdicts = vec![
        verdict("unexcused gaps", Some(gaps), Bound::AtMost(0.0)),
        verdict("id switches", Some(switches), Bound::AtMost(0.0)),
    ];
    verdicts.extend(of_identity(report));
    if let Some(theirs) = baseline.mean.mpjpe_mm {
        let ours = with.mean.mpjpe_mm;
        verdicts.push(verdict("MPJPE below DLT's, mm", ours, Bound::Below(theirs)));
    }
    // Triangulation has no heel and no toe: its ankle stands for them.
    if let Some(theirs) = baseline.mean.ankle_slide_mm_s {
        let bound = Bound::AtMost(SLIDE_SHARE * theirs);
        for (measure, ours) in [
            ("foot slide, half DLT's, mm/s", with.mean.foot_slide_mm_s),
            ("ankle slide, half DLT's", with.mean.ankle_slide_mm_s),
        ] {
            verdicts.push(verdict(measure, ours, bound));
        }
    }
    if let (Some(with), Some(without)) = (with.mean.mpjpe_mm, without.mean.mpjpe_mm) {
        let bound = Bound::AtMost(RANGE_OF_MOTION_COSTS_MM);
        verdicts.push(verdict("cost of RoM, mm", Some(with - without), bound));
    }
    verdicts
}

/// Bars on births, returns and ids.
fn of_identity(report: &SceneReport) -> Vec<BarVerdict> {
    let scores = &report.with_range_of_motion;
    let verdict = |measure, value, bound| BarVerdict::new(&report.scene, measure, value, bound);
    let none = Bound::AtMost(0.0);
    let false_births = scores.identity.false_births as f64;
    let lives = &scores.lives;
    let born_s = lives
        .time_to_birth_worst_s
        .filter(|_| lives.never_born == 0);
    let mut verdicts = vec![
        verdict("false births", Some(false_births), none),
        verdict("time to birth, worst, s", born_s, Bound::AtMost(BIRTH_S)),
    ];
    if lives.returns > 0 {
        let return_s = lives.return_worst_s;
        let not_kept = (lives.returns - lives.returns_same_id) as f64;
        verdicts.push(verdict(
            "until found again, worst, s",
            return_s,
            Bound::AtMost(BIRTH_S),
        ));
        verdicts.push(verdict("returns without the old id", Some(not_kept), none));
    }
    if !report.recoveries.is_empty() {
        let not_kept = report.recoveries.iter().filter(|r| !r.is_fair()).count() as f64;
        let slowest = slowest_s(&report.recoveries);
        let lost_s = |r: &Recovery| r.lost_s[1] - r.lost_s[0];
        let longest_s = report.recoveries.iter().map(lost_s).fold(0.0, f64::max);
        let is_long = longest_s > SHORT_S && report.cut;
        let bound_s = if is_long { LONG_RECOVERY_S } else { RECOVERY_S };
        verdicts.push(verdict("ids not kept while lost", Some(not_kept), none));
        verdicts.push(verdict(
            "until below 50 mm, worst, s",
            slowest,
            Bound::AtMost(bound_s),
        ));
    }
    match report.scene.as_str() {
        "hug" => {
            let mpjpe_mm = scores.mean.mpjpe_mm;
            verdicts.push(verdict("MPJPE, mm", mpjpe_mm, Bound::AtMost(HUG_MPJPE_MM)));
        }
        "cross" => {
            let crossings = Some(report.meetings as f64);
            verdicts.push(verdict(
                "crossings in the truth",
                crossings,
                Bound::AtLeast(CROSSINGS),
            ));
        }
        _ => {}
    }
    verdicts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_measured_reaches_no_bar() {
        assert!(!BarVerdict::new("a", "x", None, Bound::AtMost(1.0)).reached);
        assert!(!BarVerdict::new("a", "x", Some(f64::NAN), Bound::AtMost(1.0)).reached);
        assert!(BarVerdict::new("a", "x", Some(1.0), Bound::AtMost(1.0)).reached);
        assert!(!BarVerdict::new("a", "x", Some(1.0), Bound::Below(1.0)).reached);
        assert!(BarVerdict::new("a", "x", Some(2.0), Bound::AtLeast(1.0)).reached);
    }
}
