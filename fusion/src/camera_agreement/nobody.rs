//! Why nobody was found, or not all, in words.

use std::cmp::Reverse;

use super::report::{AgreementReport, DisagreementCause, SightedReport};
use super::samples::MIN_SCORE;
use crate::sightings::diagnosis::SightingDiagnosis;

/// Bodies outside the field or under its floor that are told of where somebody was found inside: so many, and one of so many
/// of all.
const MIN_BEYOND: u64 = 2;
const BEYOND_ONE_IN: u64 = 10;

/// What people are tall, metres: a scale that is wrong is told by it.
const USUAL_STATURE_M: f64 = 1.7;

/// Keypoints of pictures of half the size or less reach no farther, right and down, in those that were calibrated. People in
/// all pictures of a venue are not in one corner of them.
const HALF_REACH: f64 = 0.52;

impl AgreementReport {
    /// What there is to say of the `found` people of a run, for people: that there were none, and why; or that others stood outside
    /// the field or under its floor, where nothing else is wrong.
    pub fn lines_on_people(&self, found: usize) -> Vec<String> {
        if found == 0 {
            // Where it is told of the keypoints of all that they do not count, nothing else is known of them.
            let mut told = self.disagreements.iter();
            let is_known = told.any(|told| {
                told.cameras.is_empty() && matches!(told.cause, DisagreementCause::LowScores { .. })
            });
            let reasons = self.sighted.why_nobody().into_iter();
            let reasons = reasons.filter(|_| !is_known);
            let reasons = reasons.map(|reason| format!("  {reason}"));
            return ["nobody was found".to_owned()]
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
    /// That bodies stood outside the field, where these are not few: a line for a run that found somebody inside.
    pub fn outside_field(&self) -> Option<String> {
        let SightingDiagnosis {
            bodies,
            outside_field,
            ..
        } = self.diagnosis;
        are_many(outside_field, bodies).then(|| {
            format!(
                "{outside_field} of {bodies} bodies that detection passes found stood outside the field, where nobody new is followed: \
                 if they belong to it, set `[field]` min_m and max_m of the venue"
            )
        })
    }

    /// That bodies were under the floor, where these are not few: a line for a run that found somebody on it.
    pub fn under_floor(&self) -> Option<String> {
        let SightingDiagnosis {
            bodies,
            under_floor,
            ..
        } = self.diagnosis;
        are_many(under_floor, bodies).then(|| {
            format!(
                "{under_floor} of {bodies} bodies that detection passes found were under the floor, where nobody new is followed: \
                 if they are people, set `[field]` floor_m and min_m of the venue lower"
            )
        })
    }

    /// The likely reasons why a run without people has none, the likeliest first; each with what to do.
    pub fn why_nobody(&self) -> Vec<String> {
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
                "no camera sighted anybody: of files of keypoints, do their lines hold `persons`; of pictures, is the detector the right one, with the `person_class` and the `normalize` of its card as it was trained, are people in the pictures, and at least 48 px tall there?"
                    .to_owned(),
            ];
        }
        let mut reasons = vec![format!("sightings by camera: {counts}")];
        if self.viewpoints < 2 {
            reasons.push(
                "there is only one viewpoint: people are found where two viewpoints see them"
                    .to_owned(),
            );
            return reasons;
        }
        if let [only] = seeing[..] {
            reasons.push(format!(
                "only camera {only} sighted anybody: people are found where cameras of two viewpoints see them"
            ));
            return reasons;
        }
        let is_corner = |reach: &[f64; 2]| reach.iter().all(|share| *share < HALF_REACH);
        if self.reach.is_none() {
            reasons.push(format!(
                "no keypoint that was sighted has a score of {MIN_SCORE} or more: do the files give scores from 0 to 1, and are network and `normalize` of its card right?"
            ));
            return reasons;
        }
        if let Some([right, down]) = self.reach.filter(is_corner) {
            reasons.push(format!(
                "hardly any keypoint is farther right than {:.0} % of the width of its picture or farther down than {:.0} % of its height: were people detected in smaller pictures than were calibrated? Both must be of one size",
                100.0 * right,
                100.0 * down
            ));
        }
        let bodies = &self.diagnosis;
        if bodies.bodies == 0 {
            reasons.push(
                "the lines of sight of no two viewpoints met on a body: do the videos begin at the same instant, and does the calibration belong to these cameras, in this order?"
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
    /// What spoke against bodies, each with how many it was.
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
                    "{} on which lines of sight met have sizes that people do not have ({mean_m:.2} m on average, {times:.2} times those of people): is the calibration in metres (a foot is 0.305, an inch 0.0254), and are the keypoints in the order of the network's card?",
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
                    "{} are under the floor: is z up in the calibration, and `[field] floor_m` right?",
                    of_all(bodies.under_floor)
                ),
            ),
            (
                bodies.upside_down,
                format!(
                    "{} stand on their heads: z must point up in the calibration",
                    of_all(bodies.upside_down)
                ),
            ),
            (
                bodies.misshapen,
                format!(
                    "{} have limbs that fit no person: do the keypoints come in the order of the network's card, and the videos begin at the same instant?",
                    of_all(bodies.misshapen)
                ),
            ),
            (
                bodies.people,
                format!(
                    "{} are people in the field, but were not seen for long enough to be sure: give the run more ticks (`--ticks`), or record for longer; is `rate_hz` that of the recordings?",
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
    fn bodies_outside_the_field_are_told_of_where_they_are_not_few() {
        let sighted = |bodies, outside_field| SightedReport {
            diagnosis: SightingDiagnosis {
                bodies,
                outside_field,
                ..SightingDiagnosis::default()
            },
            ..SightedReport::default()
        };
        let told = sighted(14, 12).outside_field().unwrap();
        assert!(told.starts_with("12 of 14 bodies"), "{told}");
        for (bodies, outside) in [(0, 0), (14, 0), (14, 1), (60, 5)] {
            assert_eq!(sighted(bodies, outside).outside_field(), None, "{bodies}");
        }
    }

    #[test]
    fn why_nobody_was_found_stands_under_the_word_that_there_was_nobody() {
        let report = AgreementReport::default();
        let lines = report.lines_on_people(0);
        assert_eq!(lines[0], "nobody was found");
        assert!(
            lines[1].starts_with("  no camera sighted anybody"),
            "{lines:?}"
        );
        assert!(report.lines_on_people(2).is_empty());
    }

    #[test]
    fn where_the_keypoints_of_all_do_not_count_no_other_reason_is_given_and_where_those_of_one_do_not_others_are()
     {
        for (cameras, n_lines) in [(vec![], 1), (vec!["a".to_owned()], 2)] {
            let told = Disagreement {
                cameras,
                cause: DisagreementCause::LowScores { share: 0.9 },
                part_ticks: None,
                found: String::new(),
                remedy: String::new(),
            };
            let report = AgreementReport {
                disagreements: vec![told],
                ..AgreementReport::default()
            };
            assert_eq!(report.lines_on_people(0).len(), n_lines);
        }
    }

    #[test]
    fn keypoints_of_half_the_size_are_told_of_where_nobody_was_found() {
        let sighted = |reach| SightedReport {
            by_camera: [("a".to_owned(), 9), ("b".to_owned(), 9)].into(),
            viewpoints: 2,
            reach,
            ..SightedReport::default()
        };
        let is_told = |reach| {
            let reasons = sighted(reach).why_nobody();
            reasons
                .iter()
                .any(|reason| reason.contains("smaller pictures"))
        };
        assert!(is_told(Some([0.5, 0.45])));
        assert!(is_told(Some([0.33, 0.3])));
        for reach in [None, Some([0.5, 0.7]), Some([0.9, 0.4])] {
            assert!(!is_told(reach), "{reach:?}");
        }
    }
}
