//! Messages about why no people, or not all people, were found.

use std::cmp::Reverse;

use super::report::{AgreementReport, DisagreementCause, SightedReport};
use super::samples::MIN_SCORE;
use crate::sightings::diagnosis::SightingDiagnosis;

/// Bodies outside the field or under its floor are reported if there are at least `MIN_BEYOND`,
/// and at least one in `BEYOND_ONE_IN` bodies is.
const MIN_BEYOND: u64 = 2;
const BEYOND_ONE_IN: u64 = 10;

/// Stature to which the sizes of bodies are compared, metres.
const USUAL_STATURE_M: f64 = 1.7;

/// Largest reach of keypoints, right and down, from pictures of half the calibrated size or less.
/// With the right size, people are not in one corner of all pictures of a venue.
const MAX_HALF_SIZE_REACH: f64 = 0.52;

impl AgreementReport {
    /// Messages about the people of a run with `n_people`. Without people, the reasons. Otherwise
    /// bodies outside the field or under its floor, if nothing else is wrong.
    pub fn lines_on_people(&self, n_people: usize) -> Vec<String> {
        if n_people == 0 {
            // If the scores of all cameras are too low, nothing else is known of their keypoints.
            let mut all = self.disagreements.iter();
            let is_known = all.any(|one| {
                one.cameras.is_empty() && matches!(one.cause, DisagreementCause::LowScores { .. })
            });
            let reasons = self.sighted.reasons_for_no_people().into_iter();
            let reasons = reasons.filter(|_| !is_known);
            let reasons = reasons.map(|reason| format!("  {reason}"));
            return ["no people were found".to_owned()]
                .into_iter()
                .chain(reasons)
                .collect();
        }
        let is_right = self.disagreements.is_empty();
        let beyond = is_right.then(|| [self.sighted.outside_field(), self.sighted.under_floor()]);
        beyond.into_iter().flatten().flatten().collect()
    }
}

impl SightedReport {
    /// A message if many bodies stood outside the field, for a run with people inside.
    pub fn outside_field(&self) -> Option<String> {
        let SightingDiagnosis {
            bodies,
            outside_field,
            ..
        } = self.diagnosis;
        are_many(outside_field, bodies).then(|| {
            format!(
                "{outside_field} of {bodies} bodies that detection passes found stood outside the field, where no new track starts: \
                 if they belong to it, set `[field]` min_m and max_m of the venue"
            )
        })
    }

    /// A message if many bodies were under the floor, for a run with people on it.
    pub fn under_floor(&self) -> Option<String> {
        let SightingDiagnosis {
            bodies,
            under_floor,
            ..
        } = self.diagnosis;
        are_many(under_floor, bodies).then(|| {
            format!(
                "{under_floor} of {bodies} bodies that detection passes found were under the floor, where no new track starts: \
                 if they are people, set lower values of `[field]` floor_m and min_m of the venue"
            )
        })
    }

    /// The likely reasons why a run has no people, the most likely first, each with a remedy.
    pub fn reasons_for_no_people(&self) -> Vec<String> {
        let seeing: Vec<&str> = self
            .by_camera
            .iter()
            .filter(|(_, count)| **count > 0)
            .map(|(name, _)| name.as_str())
            .collect();
        let counts = self
            .by_camera
            .iter()
            .map(|(name, count)| format!("{name} {count}"));
        let counts = counts.collect::<Vec<_>>().join(", ");
        if seeing.is_empty() {
            return vec![
                "no camera sighted anybody. Keypoint files: do their lines contain `persons`? Pictures: are people in them, at least 48 px tall? Is the detector the right one, and do `person_class` and `normalize` of its card match its training?"
                    .to_owned(),
            ];
        }
        let mut reasons = vec![format!("sightings by camera: {counts}")];
        if self.viewpoints < 2 {
            reasons.push(
                "there is only one viewpoint: a person is found only if two viewpoints see them"
                    .to_owned(),
            );
            return reasons;
        }
        if let [only] = seeing[..] {
            reasons.push(format!(
                "only camera {only} sighted anybody: a person is found only if cameras of two viewpoints see them"
            ));
            return reasons;
        }
        let is_corner = |reach: &[f64; 2]| reach.iter().all(|share| *share < MAX_HALF_SIZE_REACH);
        if self.reach.is_none() {
            reasons.push(format!(
                "no sighted keypoint has a score of {MIN_SCORE} or more: do the files have scores from 0 to 1? Is the network the right one, and is `normalize` of its card correct?"
            ));
            return reasons;
        }
        if let Some([right, down]) = self.reach.filter(is_corner) {
            reasons.push(format!(
                "hardly any keypoint is farther right than {:.0} % of the width of its picture or farther down than {:.0} % of its height: were people detected in smaller pictures than were calibrated? Both must have the same size",
                100.0 * right,
                100.0 * down
            ));
        }
        let bodies = &self.diagnosis;
        if bodies.bodies == 0 {
            reasons.push(
                "no lines of sight of two viewpoints meet on a body: do the videos start at the same instant, and does the calibration belong to these cameras, in this order?"
                    .to_owned(),
            );
            return reasons;
        }
        let mut causes = bodies.causes();
        causes.sort_by_key(|(count, _)| Reverse(*count));
        reasons.extend(
            causes
                .into_iter()
                .filter(|(count, _)| *count > 0)
                .map(|(_, text)| text),
        );
        reasons
    }
}

fn are_many(beyond: u64, bodies: u64) -> bool {
    beyond >= MIN_BEYOND && beyond * BEYOND_ONE_IN >= bodies
}

impl SightingDiagnosis {
    /// Reasons against bodies, each with their number.
    fn causes(&self) -> [(u64, String); 6] {
        let bodies = self;
        let wrong = bodies.too_small + bodies.too_large;
        let of_all = |count: u64| format!("{count} of {} bodies", bodies.bodies);
        let mean_m = bodies.wrong_statures_m / wrong.max(1) as f64;
        let times = mean_m / USUAL_STATURE_M;
        let [x, y, z] = bodies.outside_at_m;
        [
            (
                wrong,
                format!(
                    "{} on which lines of sight meet have implausible sizes ({mean_m:.2} m on average, {times:.2} times a usual stature): is the calibration in metres (a foot is 0.305, an inch 0.0254), and are the keypoints in the order of the network's card?",
                    of_all(wrong)
                ),
            ),
            (
                bodies.outside_field,
                format!(
                    "{} stand outside the field, around ({x:.1}, {y:.1}, {z:.1}) m: set `[field]` min_m and max_m of the venue",
                    of_all(bodies.outside_field)
                ),
            ),
            (
                bodies.under_floor,
                format!(
                    "{} are under the floor: does z point up in the calibration, and is `[field] floor_m` correct?",
                    of_all(bodies.under_floor)
                ),
            ),
            (
                bodies.upside_down,
                format!(
                    "{} are upside down: z must point up in the calibration",
                    of_all(bodies.upside_down)
                ),
            ),
            (
                bodies.misshapen,
                format!(
                    "{} have limbs that fit no person: are the keypoints in the order of the network's card, and do the videos start at the same instant?",
                    of_all(bodies.misshapen)
                ),
            ),
            (
                bodies.people,
                format!(
                    "{} are people in the field, but were not seen for long enough to be confirmed: give the run more ticks (`--ticks`), or record for longer; is `rate_hz` that of the recordings?",
                    of_all(bodies.people)
                ),
            ),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::super::report::Disagreement;
    use super::*;

    #[test]
    fn many_bodies_outside_the_field_are_reported() {
        let sighted = |bodies, outside_field| SightedReport {
            diagnosis: SightingDiagnosis {
                bodies,
                outside_field,
                ..SightingDiagnosis::default()
            },
            ..SightedReport::default()
        };
        let message = sighted(14, 12).outside_field().unwrap();
        assert!(message.starts_with("12 of 14 bodies"), "{message}");
        for (bodies, outside) in [(0, 0), (14, 0), (14, 1), (60, 5)] {
            assert_eq!(sighted(bodies, outside).outside_field(), None, "{bodies}");
        }
    }

    #[test]
    fn a_run_without_people_has_indented_reasons() {
        let report = AgreementReport::default();
        let lines = report.lines_on_people(0);
        let reasons = report.sighted.reasons_for_no_people();
        assert!(!reasons.is_empty());
        assert!(!lines[0].starts_with(' '), "{lines:?}");
        let indented: Vec<String> = reasons.iter().map(|reason| format!("  {reason}")).collect();
        assert_eq!(lines[1..], indented);
        assert!(report.lines_on_people(2).is_empty());
    }

    #[test]
    fn low_scores_suppress_other_reasons_only_if_all_cameras_have_them() {
        for (cameras, n_lines) in [(vec![], 1), (vec!["a".to_owned()], 2)] {
            let low_scores = Disagreement {
                cameras,
                cause: DisagreementCause::LowScores { share: 0.9 },
                part_ticks: None,
                found: String::new(),
                remedy: String::new(),
            };
            let report = AgreementReport {
                disagreements: vec![low_scores],
                ..AgreementReport::default()
            };
            assert_eq!(report.lines_on_people(0).len(), n_lines);
        }
    }

    #[test]
    fn keypoints_of_half_the_size_are_a_reason_for_no_people() {
        let sighted = |reach| SightedReport {
            by_camera: [("a".to_owned(), 9), ("b".to_owned(), 9)].into(),
            viewpoints: 2,
            reach,
            ..SightedReport::default()
        };
        // The sightings, the reach, and that no lines of sight meet.
        let has_reach = |reach| sighted(reach).reasons_for_no_people().len() == 3;
        assert!(has_reach(Some([0.5, 0.45])));
        assert!(has_reach(Some([0.33, 0.3])));
        for reach in [None, Some([0.5, 0.7]), Some([0.9, 0.4])] {
            assert!(!has_reach(reach), "{reach:?}");
        }
    }
}
