//! Statures of people, from link lengths. Nothing else reveals a wrong scale of a calibration.
//!
//! If one person seems tall, the person may be tall or the world too large. If several people are
//! all taller than nearly anyone is, a large world is more likely. Children are short, and a whole
//! team may be tall, so the result is only a warning.

use farfield_proto::id::PersonId;
use farfield_proto::order_statistics::{mean_median, percentile};
use farfield_proto::venue::{KnownBy, VenueSubject};

use crate::body::skeleton::Joints;
use crate::body::stature::stature_m;
use crate::camera_agreement::report::DisagreementCause;

/// Number of people that are kept.
const MAX_PEOPLE: usize = 64;
/// Least number of instants at which a person must have been measured to count.
const MIN_INSTANTS: u32 = 8;
/// Plausible statures of one person, metres. Beyond them are young children and one in a million
/// adults.
const ONE_PERSON_M: [f64; 2] = [1.3, 2.1];
/// At least one of several people has a stature between these, metres. One in a hundred adults is
/// shorter, and one in ten thousand is taller.
const SEVERAL_PEOPLE_M: [f64; 2] = [1.5, 2.05];
/// Least number of people for the tests of mean and near quartile: of short people (one of two may
/// be a child) and of tall ones. Gymnasts are 1.5 m tall on average, up to 1.6; basketball teams
/// are 2.0 m tall, at least 1.9.
const MIN_PEOPLE_FOR_MEAN: [usize; 2] = [4, 2];
const MEAN_BOUNDS_M: [f64; 2] = [1.44, 2.06];
const QUARTILE_BOUNDS_M: [f64; 2] = [1.55, 1.97];
/// With these tests, bounds of the tallest of short people and of the shortest of tall people,
/// metres. An adult among children shows that the scale is right.
const EXTREME_BOUNDS_M: [f64; 2] = [1.65, 1.8];
/// Least deviation of the mean from the statures of the venue's subjects, as a share.
const MIN_SUBJECT_DEVIATION: f64 = 0.1;

/// The statures of the measured people.
#[derive(Debug, Clone)]
pub(super) struct Statures {
    people: Vec<Measured>,
    /// Number of instants so far.
    instants: u64,
    /// The least and the largest stature of the venue's subjects, metres, if it has those of all.
    expected_m: Option<[f64; 2]>,
}

/// A measured person.
#[derive(Debug, Clone, Copy)]
struct Measured {
    id: PersonId,
    /// The newest value: links are measured again when a person has been seen for longer.
    stature_m: f64,
    instants: u32,
    newest: u64,
}

impl Statures {
    /// No people yet in a venue with these subjects.
    pub(super) fn expecting(subjects: &[VenueSubject]) -> Self {
        let are_all_known = subjects
            .iter()
            .all(|subject| matches!(subject.known_by, KnownBy::Stature { .. }));
        let known = subjects
            .iter()
            .filter(|_| are_all_known)
            .filter_map(|subject| match &subject.known_by {
                KnownBy::Stature { stature_m, .. } => Some([*stature_m; 2]),
                KnownBy::Profile(_) => None,
            });
        Self {
            people: Vec::with_capacity(MAX_PEOPLE),
            instants: 0,
            expected_m: known.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]),
        }
    }

    /// People of these statures.
    #[cfg(test)]
    pub(in crate::camera_agreement) fn from_metres(statures_m: &[f64]) -> Self {
        let mut all = Self::expecting(&[]);
        for (id, stature_m) in (1..).zip(statures_m) {
            all.people.push(Measured {
                id: PersonId(id),
                stature_m: *stature_m,
                instants: MIN_INSTANTS,
                newest: 0,
            });
        }
        all
    }

    pub(super) fn begin_instant(&mut self) {
        self.instants += 1;
    }

    /// Adds the stature of a person at this instant.
    pub(super) fn note(&mut self, id: PersonId, joints_m: &Joints) {
        let joints_m = joints_m.map(|m| [m.x as f32, m.y as f32, m.z as f32]);
        let Some(stature_m) = stature_m(&joints_m) else {
            return;
        };
        let newest = self.instants;
        if let Some(known) = self.people.iter_mut().find(|known| known.id == id) {
            known.stature_m = stature_m;
            known.instants = known.instants.saturating_add(1);
            known.newest = newest;
            return;
        }
        if self.people.len() == MAX_PEOPLE {
            let people = self.people.iter().enumerate();
            let oldest = people.min_by_key(|(_, known)| known.newest);
            if let Some((oldest, _)) = oldest {
                self.people.remove(oldest);
            }
        }
        self.people.push(Measured {
            id,
            stature_m,
            instants: 1,
            newest,
        });
    }

    /// A wrong scale, if people have implausible statures.
    pub(super) fn suspect_scale(&self) -> Option<DisagreementCause> {
        let known = self.people.iter();
        let known = known.filter(|known| known.instants >= MIN_INSTANTS);
        let mut sorted_m: Vec<f64> = known.map(|known| known.stature_m).collect();
        sorted_m.sort_by(f64::total_cmp);
        let median_m = mean_median(&sorted_m).filter(|_| self.are_implausible(&sorted_m))?;
        Some(DisagreementCause::WorldScale {
            stature_m: rounded(median_m),
            people: sorted_m.len(),
            range_m: [*sorted_m.first()?, *sorted_m.last()?].map(rounded),
            expected_m: self.expected_m,
        })
    }

    /// Whether these people are all too short or all too tall.
    fn are_implausible(&self, sorted_m: &[f64]) -> bool {
        let (Some(&lowest_m), Some(&highest_m)) = (sorted_m.first(), sorted_m.last()) else {
            return false;
        };
        let mean_m = sorted_m.iter().sum::<f64>() / sorted_m.len() as f64;
        let quarter_m = |share| percentile(sorted_m, share).unwrap_or(mean_m);
        let [low_quarter_m, high_quarter_m] = [0.25, 0.75].map(quarter_m);
        let all_m = if sorted_m.len() == 1 {
            ONE_PERSON_M
        } else {
            SEVERAL_PEOPLE_M
        };
        let are_many = MIN_PEOPLE_FOR_MEAN.map(|many| sorted_m.len() >= many);
        let most_are_short = mean_m < MEAN_BOUNDS_M[0]
            && high_quarter_m < QUARTILE_BOUNDS_M[0]
            && highest_m < EXTREME_BOUNDS_M[0];
        let most_are_tall = mean_m > MEAN_BOUNDS_M[1]
            && low_quarter_m > QUARTILE_BOUNDS_M[1]
            && lowest_m > EXTREME_BOUNDS_M[1];
        let is_short = highest_m < all_m[0] || are_many[0] && most_are_short;
        let is_tall = lowest_m > all_m[1] || are_many[1] && most_are_tall;
        let (is_short, is_tall) = match self.expected_m {
            Some([shortest_m, tallest_m]) => {
                // At least one of several people is a subject; a single person may be a guest.
                let are_several = sorted_m.len() > 1;
                let are_shorter = highest_m < shortest_m && are_several;
                let are_taller = lowest_m > tallest_m && are_several;
                (
                    (is_short || are_shorter)
                        && mean_m < (1.0 - MIN_SUBJECT_DEVIATION) * shortest_m,
                    (is_tall || are_taller) && mean_m > (1.0 + MIN_SUBJECT_DEVIATION) * tallest_m,
                )
            }
            None => (is_short, is_tall),
        };
        is_short || is_tall
    }
}

/// To a centimetre.
fn rounded(metres: f64) -> f64 {
    (100.0 * metres).round() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_suspect(statures_m: &[f64]) -> bool {
        Statures::from_metres(statures_m).suspect_scale().is_some()
    }

    /// These people in a world that is `factor` times as large.
    fn scaled(statures_m: &[f64], factor: f64) -> Vec<f64> {
        statures_m.iter().map(|m| m * factor).collect()
    }

    #[test]
    fn a_scale_that_is_a_fifth_off_is_suspect() {
        for people in [
            // The two of the sample.
            &[1.67, 1.80][..],
            &[1.72, 1.78, 1.84],
            &[1.66, 1.72, 1.78, 1.92],
            &[1.62, 1.66, 1.68, 1.72, 1.75, 1.78, 1.8, 1.83, 1.85, 1.93],
        ] {
            assert!(!is_suspect(people), "{people:?}");
            for factor in [0.8, 1.2] {
                assert!(is_suspect(&scaled(people, factor)), "{people:?} {factor}");
            }
        }
        assert!(is_suspect(&[1.85 * 1.2]));
        assert!(is_suspect(&[1.6 * 0.8]));
    }

    #[test]
    fn people_a_tenth_beyond_all_subjects_are_suspect() {
        let are_suspect = |statures_m: &[f64]| {
            let mut all = Statures::from_metres(statures_m);
            all.expected_m = Some([1.62, 1.71]);
            all.suspect_scale().is_some()
        };
        assert!(!are_suspect(&[1.62, 1.71]));
        assert!(!are_suspect(&scaled(&[1.62, 1.71], 1.05)));
        for factor in [0.85, 1.18] {
            assert!(are_suspect(&scaled(&[1.62, 1.71], factor)), "{factor}");
        }
        // Guests are present, too; or one alone.
        assert!(!are_suspect(&[1.7, 1.95, 1.98]));
        assert!(!are_suspect(&[1.95]));
    }

    #[test]
    fn plausible_groups_such_as_gymnasts_are_not_suspect() {
        for people in [
            &[][..],
            &[1.45],
            &[2.08],
            &[1.15, 1.7],
            &[1.3, 1.54],
            &[1.2, 1.25, 1.3, 1.82],
            &[1.48, 1.52, 1.58],
            &[1.44, 1.48, 1.5, 1.52, 1.55, 1.6],
            &[1.85, 1.93, 1.98, 2.03, 2.11],
            &[1.98, 2.12],
        ] {
            assert!(!is_suspect(people), "{people:?}");
        }
    }

    #[test]
    fn children_are_not_suspect_if_the_venue_expects_them() {
        let mut children = Statures::from_metres(&[1.3, 1.4]);
        assert!(children.suspect_scale().is_some());
        children.expected_m = Some([1.28, 1.75]);
        assert_eq!(children.suspect_scale(), None);
        children.expected_m = Some([1.7, 1.75]);
        assert!(children.suspect_scale().is_some());
    }

    #[test]
    fn the_newest_people_are_kept() {
        let mut all = Statures::expecting(&[]);
        let joints_m = Joints::from([nalgebra::Vector3::zeros(); crate::body::skeleton::N_JOINTS]);
        for id in 0..200 {
            all.begin_instant();
            all.note(PersonId(id), &joints_m);
            all.note(PersonId(0), &joints_m);
        }
        assert_eq!(all.people.len(), MAX_PEOPLE);
        let has = |id: u32| all.people.iter().any(|known| known.id == PersonId(id));
        assert!(has(0) && has(199) && !has(1));
    }
}
