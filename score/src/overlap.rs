//! Checks that poses and a truth are of the same people at the same time. A score without this is meaningless.

use std::fmt;
use std::ops::RangeInclusive;

use farfield_proto::tick::Tick;

use super::lines::PoseLines;
use super::pairing::{Distances, GATE_M};

/// Share of ticks below which two files barely overlap.
const BARELY: f64 = 0.1;

/// How poses and a truth overlap.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlap {
    /// First and last tick of the poses.
    poses: Option<RangeInclusive<Tick>>,
    /// First and last tick of the truth.
    truth: Option<RangeInclusive<Tick>>,
    /// Ticks at which the truth contains people.
    true_ticks: usize,
    /// Ticks at which both contain people.
    shared_ticks: usize,
    /// Of these, ticks with a pose near enough to match a true person.
    near_ticks: usize,
    /// The least mean distance between the points of a pose and of a true person, metres; `None` if no pose shares a point
    /// with a true person of its tick.
    nearest_m: Option<f64>,
    /// The compared points that the poses have.
    pose_points: Vec<&'static str>,
    /// The compared points that the truth has.
    true_points: Vec<&'static str>,
}

impl Overlap {
    /// Compares two files.
    pub fn of(poses: &PoseLines, truth: &PoseLines) -> Self {
        let mut overlap = Self {
            poses: span(poses),
            truth: span(truth),
            true_ticks: truth.ticks().count(),
            shared_ticks: 0,
            near_ticks: 0,
            nearest_m: None,
            pose_points: poses.known_points(),
            true_points: truth.known_points(),
        };
        for tick in truth.ticks() {
            if let (Some(truths), Some(poses)) = (truth.people_at(tick), poses.people_at(tick)) {
                overlap.shared_ticks += 1;
                let nearest_m = Distances::new(truths, poses).nearest_m();
                overlap.near_ticks += usize::from(nearest_m <= GATE_M);
                let least_m = overlap.nearest_m.unwrap_or(f64::INFINITY).min(nearest_m);
                overlap.nearest_m = least_m.is_finite().then_some(least_m);
            }
        }
        overlap
    }

    /// The reason why scoring is impossible, if any. Empty poses are scored: the whole truth is missing then.
    pub fn refusal(&self) -> Option<String> {
        let poses = self.poses.as_ref()?;
        if self.shared_ticks == 0 {
            return Some(format!(
                "no tick in common: the poses have {}, the truth has {}; expected poses of the people and time of the truth",
                Span(poses),
                self.true_span()
            ));
        }
        if self.near_ticks > 0 {
            return None;
        }
        let shared = self.shared_ticks;
        let Some(nearest_m) = self.nearest_m else {
            return Some(format!(
                "no point in common at the {shared} ticks that both have: of the compared points the poses have {}, the truth \
                 has {}; expected the same names in both, such as `left_hip` and `right_knee`",
                named(&self.pose_points),
                named(&self.true_points)
            ));
        };
        Some(format!(
            "no place in common at the {shared} ticks that both have: the nearest pose is {nearest_m:.2} m from a true person, \
             and a match is at most {GATE_M} m apart; expected poses of the same people, in the same coordinates"
        ))
    }

    /// A reason to distrust the score, if any.
    pub fn warning(&self) -> Option<String> {
        let Some(poses) = &self.poses else {
            return Some(format!(
                "the poses contain no people; the truth has {}",
                self.true_span()
            ));
        };
        let is_barely = |part: usize, of: usize| (part as f64) < BARELY * of as f64;
        if is_barely(self.shared_ticks, self.true_ticks) {
            return Some(format!(
                "only {} of the truth's {} ticks have poses: the poses have {}, the truth has {}",
                self.shared_ticks,
                self.true_ticks,
                Span(poses),
                self.true_span()
            ));
        }
        is_barely(self.near_ticks, self.shared_ticks).then(|| {
            format!(
                "a pose is within {GATE_M} m of a true person at only {} of {} ticks",
                self.near_ticks, self.shared_ticks
            )
        })
    }

    fn true_span(&self) -> String {
        let span = self.truth.as_ref();
        span.map_or_else(|| "none".to_owned(), |span| Span(span).to_string())
    }
}

fn named(points: &[&str]) -> String {
    if points.is_empty() {
        return "none".to_owned();
    }
    format!("`{}`", points.join("`, `"))
}

fn span(lines: &PoseLines) -> Option<RangeInclusive<Tick>> {
    let first = lines.ticks().next()?;
    Some(first..=lines.ticks().last().unwrap_or(first))
}

struct Span<'a>(&'a RangeInclusive<Tick>);

impl fmt::Display for Span<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "ticks {} to {}", self.0.start(), self.0.end())
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;
    use std::path::Path;

    use super::*;
    use crate::lines::LinesRole;
    use crate::points::PointSet;

    fn lines(ticks: Range<i64>, x_m: impl Fn(i64) -> f64, joint: &str) -> PoseLines {
        let line = |tick: i64| {
            let x_m = x_m(tick);
            format!(
                "{{\"tick\": {tick}, \"person\": 1, \"joints\": {{\"{joint}\": [{x_m}, 0, 1]}}}}\n"
            )
        };
        let text: String = ticks.map(line).collect();
        let path = Path::new("x.jsonl");
        PoseLines::read(
            text.as_bytes(),
            path,
            LinesRole::Poses,
            PointSet::Joints,
            None,
        )
        .unwrap()
    }

    fn standing(ticks: Range<i64>, x_m: f64) -> PoseLines {
        lines(ticks, |_| x_m, "left_hip")
    }

    fn overlap(poses: &PoseLines) -> Overlap {
        Overlap::of(poses, &standing(0..100, 0.0))
    }

    #[test]
    fn overlapping_files_cause_no_refusal_and_no_warning() {
        let overlap = overlap(&standing(5..90, 0.1));
        assert_eq!((overlap.refusal(), overlap.warning()), (None, None));
    }

    #[test]
    fn a_refusal_for_other_ticks_has_the_ticks_of_both() {
        let refusal = overlap(&standing(100..200, 0.0)).refusal().unwrap();
        for words in ["poses have ticks 100 to 199", "truth has ticks 0 to 99"] {
            assert!(refusal.contains(words), "{refusal}");
        }
    }

    #[test]
    fn a_refusal_for_another_place_has_the_nearest_distance() {
        let refusal = overlap(&standing(0..100, 3.25)).refusal().unwrap();
        assert!(refusal.contains("3.25 m"), "{refusal}");
    }

    #[test]
    fn a_refusal_for_other_points_has_the_points_of_both() {
        let refusal = |joint: &str| {
            let poses = lines(0..100, |_| 0.0, joint);
            overlap(&poses).refusal().unwrap()
        };
        for (joint, words) in [
            (
                "left_knee",
                "the poses have `left_knee`, the truth has `left_hip`",
            ),
            ("hip_l", "the poses have none, the truth has `left_hip`"),
        ] {
            let message = refusal(joint);
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn a_small_overlap_is_scored_with_a_warning() {
        let warning = overlap(&standing(95..400, 0.0)).warning().unwrap();
        assert!(warning.contains("5 of the truth's 100 ticks"), "{warning}");
        let passing = lines(0..100, |tick| 0.2 * tick as f64 - 10.05, "left_hip");
        let warning = overlap(&passing).warning().unwrap();
        assert!(warning.contains("at only 5 of 100 ticks"), "{warning}");
        assert_eq!(overlap(&standing(90..400, 0.0)).warning(), None);
    }

    #[test]
    fn poses_without_people_cause_a_warning_only() {
        let overlap = overlap(&standing(0..0, 0.0));
        assert_eq!(overlap.refusal(), None);
        assert!(overlap.warning().unwrap().contains("ticks 0 to 99"));
    }
}
