//! How tall each person is, by link lengths: what tells the scale of a calibration, since nothing else does.
//!
//! Nobody knows of one person whether they are tall or the world is large; of several who are all taller than nearly
//! anybody is, the world is the likelier. Children are short, and all of a team may be tall: so it is a doubt.

use farfield_proto::id::PersonId;
use farfield_proto::order_statistics::{mean_median, percentile};
use farfield_proto::venue::{KnownBy, VenueSubject};

use crate::body::skeleton::Joints;
use crate::body::stature::stature_m;
use crate::camera_agreement::report::DisagreementCause;

/// People who are kept, the newest.
const MAX_PEOPLE: usize = 64;
/// Instants at which somebody must have been measured to count.
const MIN_INSTANTS: u32 = 8;
/// Statures between which one person may be, metres; beyond them are young children, and of adults one in a million.
const OF_ONE_M: [f64; 2] = [1.3, 2.1];
/// Statures between which one of several people is, metres: of adults one in a hundred is shorter, and one in ten thousand
/// taller.
const OF_SEVERAL_M: [f64; 2] = [1.5, 2.05];
/// From how many on the mean and those at the near quarter tell as well, of the short (of two, one may be a child) and of the
/// tall, and between what these are: gymnasts are 1.5 m tall on average and teams of basketball 2.0, their bounds 1.6 and 1.9.
const MANY: [usize; 2] = [4, 2];
const MEAN_OF_MANY_M: [f64; 2] = [1.44, 2.06];
const QUARTER_OF_MANY_M: [f64; 2] = [1.55, 1.97];
/// The tallest and the shortest of several whose mean tells, metres: a grown-up among children says that the scale is right.
const FARTHEST_M: [f64; 2] = [1.65, 1.8];
/// How far beyond the statures of those whom the venue expects people may seem to be, as a share.
const OF_SUBJECTS: f64 = 0.1;

/// Those who were measured.
#[derive(Debug, Clone)]
pub(super) struct Statures {
    people: Vec<Measured>,
    /// Instants so far.
    instants: u64,
    /// The shortest and the tallest whom the venue names, metres, where it gives the statures of all.
    expected_m: Option<[f64; 2]>,
}

/// Somebody who was measured.
#[derive(Debug, Clone, Copy)]
struct Measured {
    id: PersonId,
    /// The newest: links are measured anew as somebody is seen for longer.
    stature_m: f64,
    instants: u32,
    newest: u64,
}

impl Statures {
    /// Nobody yet, where these people may come.
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
    pub(in crate::camera_agreement) fn of(statures_m: &[f64]) -> Self {
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

    /// Begins another instant.
    pub(super) fn begin(&mut self) {
        self.instants += 1;
    }

    /// Keeps how tall somebody is.
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

    /// That people have sizes which people do not have.
    pub(super) fn doubtful_scale(&self) -> Option<DisagreementCause> {
        let known = self.people.iter();
        let known = known.filter(|known| known.instants >= MIN_INSTANTS);
        let mut sorted_m: Vec<f64> = known.map(|known| known.stature_m).collect();
        sorted_m.sort_by(f64::total_cmp);
        let median_m = mean_median(&sorted_m).filter(|_| self.are_doubtful(&sorted_m))?;
        Some(DisagreementCause::WorldScale {
            stature_m: rounded(median_m),
            people: sorted_m.len(),
            range_m: [*sorted_m.first()?, *sorted_m.last()?].map(rounded),
            expected_m: self.expected_m,
        })
    }

    /// Whether these people are all too short or all too tall.
    fn are_doubtful(&self, sorted_m: &[f64]) -> bool {
        let (Some(&lowest_m), Some(&highest_m)) = (sorted_m.first(), sorted_m.last()) else {
            return false;
        };
        let mean_m = sorted_m.iter().sum::<f64>() / sorted_m.len() as f64;
        let quarter_m = |share| percentile(sorted_m, share).unwrap_or(mean_m);
        let [low_quarter_m, high_quarter_m] = [0.25, 0.75].map(quarter_m);
        let all_m = if sorted_m.len() == 1 {
            OF_ONE_M
        } else {
            OF_SEVERAL_M
        };
        let are_many = MANY.map(|many| sorted_m.len() >= many);
        let most_are_short = mean_m < MEAN_OF_MANY_M[0]
            && high_quarter_m < QUARTER_OF_MANY_M[0]
            && highest_m < FARTHEST_M[0];
        let most_are_tall = mean_m > MEAN_OF_MANY_M[1]
            && low_quarter_m > QUARTER_OF_MANY_M[1]
            && lowest_m > FARTHEST_M[1];
        let is_short = highest_m < all_m[0] || are_many[0] && most_are_short;
        let is_tall = lowest_m > all_m[1] || are_many[1] && most_are_tall;
        let (is_short, is_tall) = match self.expected_m {
            Some([shortest_m, tallest_m]) => {
                // Of several one at least is named; one alone may be a guest.
                let are_several = sorted_m.len() > 1;
                let are_shorter = highest_m < shortest_m && are_several;
                let are_taller = lowest_m > tallest_m && are_several;
                (
                    (is_short || are_shorter) && mean_m < (1.0 - OF_SUBJECTS) * shortest_m,
                    (is_tall || are_taller) && mean_m > (1.0 + OF_SUBJECTS) * tallest_m,
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

    fn is_doubted(statures_m: &[f64]) -> bool {
        Statures::of(statures_m).doubtful_scale().is_some()
    }

    /// These people in a world that is so many times as large.
    fn scaled(statures_m: &[f64], factor: f64) -> Vec<f64> {
        statures_m.iter().map(|m| m * factor).collect()
    }

    #[test]
    fn a_scale_that_is_a_fifth_off_is_doubted_by_the_statures_of_everybody() {
        for people in [
            // The two of the sample.
            &[1.67, 1.80][..],
            &[1.72, 1.78, 1.84],
            &[1.66, 1.72, 1.78, 1.92],
            &[1.62, 1.66, 1.68, 1.72, 1.75, 1.78, 1.8, 1.83, 1.85, 1.93],
        ] {
            assert!(!is_doubted(people), "{people:?}");
            for factor in [0.8, 1.2] {
                assert!(is_doubted(&scaled(people, factor)), "{people:?} {factor}");
            }
        }
        assert!(is_doubted(&[1.85 * 1.2]));
        assert!(is_doubted(&[1.6 * 0.8]));
    }

    #[test]
    fn where_it_is_known_who_comes_all_who_are_a_tenth_beyond_them_are_doubted() {
        let are_doubted = |statures_m: &[f64]| {
            let mut all = Statures::of(statures_m);
            all.expected_m = Some([1.62, 1.71]);
            all.doubtful_scale().is_some()
        };
        assert!(!are_doubted(&[1.62, 1.71]));
        assert!(!are_doubted(&scaled(&[1.62, 1.71], 1.05)));
        for factor in [0.85, 1.18] {
            assert!(are_doubted(&scaled(&[1.62, 1.71], factor)), "{factor}");
        }
        // Others are there, too; or one of them alone.
        assert!(!are_doubted(&[1.7, 1.95, 1.98]));
        assert!(!are_doubted(&[1.95]));
    }

    #[test]
    fn nothing_is_said_of_teams_of_gymnasts_and_of_a_child_among_adults() {
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
            assert!(!is_doubted(people), "{people:?}");
        }
    }

    #[test]
    fn people_are_doubted_beside_those_whom_the_venue_expects() {
        let mut children = Statures::of(&[1.3, 1.4]);
        assert!(children.doubtful_scale().is_some());
        children.expected_m = Some([1.28, 1.75]);
        assert_eq!(children.doubtful_scale(), None);
        children.expected_m = Some([1.7, 1.75]);
        assert!(children.doubtful_scale().is_some());
    }

    #[test]
    fn of_many_people_the_newest_are_kept() {
        let mut all = Statures::expecting(&[]);
        let joints_m = Joints::from([nalgebra::Vector3::zeros(); crate::body::skeleton::N_JOINTS]);
        for id in 0..200 {
            all.begin();
            all.note(PersonId(id), &joints_m);
            all.note(PersonId(0), &joints_m);
        }
        assert_eq!(all.people.len(), MAX_PEOPLE);
        let has = |id: u32| all.people.iter().any(|known| known.id == PersonId(id));
        assert!(has(0) && has(199) && !has(1));
    }
}
