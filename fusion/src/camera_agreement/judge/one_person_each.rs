//! Whether every camera shows one person at a time, and not the same one as the others: keypoints of a program that follows one
//! person in each recording, of a field with several.

use super::super::pairs::{PairAgreement, SAME_PERSON_COST};
use super::super::report::{AgreementReport, DisagreementCause};
use super::Judge;

/// Detection passes in which two cameras show somebody, of which some tell.
const MIN_PASSES: usize = 6;
/// Mean cost of two sightings that are of two people.
const OTHER_PERSON_COST: f64 = 0.8;
/// Which share of them must be of one person, and which of two.
const SOME: f64 = 0.2;
/// Of so large a share of all pairs.
const MANY_PAIRS: f64 = 0.5;

impl Judge<'_> {
    /// That they do so, where nothing else is known of them.
    pub(in crate::camera_agreement) fn one_person_each(
        &self,
        report: &AgreementReport,
    ) -> Option<DisagreementCause> {
        let mut others = report.disagreements.iter();
        let is_unexplained = others.all(|told| told.cause == DisagreementCause::Unexplained);
        let mut shown = self.passes.iter().flat_map(|pass| &pass.of_camera);
        if !is_unexplained || shown.any(|bodies| bodies.len() > 1) {
            return None;
        }
        let (mut pairs, mut mixed) = (0, Vec::new());
        for (a, b) in self.pairs_of(&self.showing()) {
            let costs = PairAgreement::of_single(&self.as_it_is[a], &self.as_it_is[b]);
            if costs.len() >= MIN_PASSES {
                let some = |n: usize| n as f64 >= SOME * costs.len() as f64;
                let same = costs.iter().filter(|cost| **cost < SAME_PERSON_COST);
                let other = costs.iter().filter(|cost| **cost > OTHER_PERSON_COST);
                pairs += 1;
                if some(same.count()) && some(other.count()) {
                    mixed.push((a, b));
                }
            }
        }
        // One camera that is in all of them is late, or was moved.
        let is_in_all = |camera: usize| mixed.iter().all(|&(a, b)| a == camera || b == camera);
        let are_several = !(0..self.cameras.len()).any(is_in_all);
        let are_many = mixed.len() as f64 >= MANY_PAIRS * f64::from(pairs);
        (are_several && are_many).then_some(DisagreementCause::OnePersonEach)
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake};
    use super::*;

    #[test]
    fn cameras_that_show_one_of_two_people_in_turn_are_told_of() {
        let mut hall = Hall {
            bursts: 4,
            ..Hall::default()
        };
        for (camera, (_, mistake)) in hall.shows.iter_mut().enumerate() {
            mistake.one_of_two = Some(camera);
        }
        let told = (Vec::new(), DisagreementCause::OnePersonEach);
        assert_eq!(hall.causes(), [told]);
    }

    #[test]
    fn one_person_whom_all_show_is_one_person() {
        let mut hall = Hall {
            bursts: 4,
            ..Hall::default()
        };
        for (_, mistake) in &mut hall.shows {
            mistake.sees_only = Some(0);
        }
        assert_eq!(hall.causes(), []);
    }

    #[test]
    fn a_camera_that_alone_shows_somebody_else_is_not_all_of_them() {
        let mistake = Mistake {
            one_of_two: Some(1),
            ..Mistake::default()
        };
        let mut hall = Hall {
            bursts: 4,
            ..Hall::with(2, mistake)
        };
        for camera in [0, 1, 3] {
            hall.shows[camera].1.sees_only = Some(0);
        }
        let causes = hall.causes();
        let is_told = |cause: &DisagreementCause| *cause == DisagreementCause::OnePersonEach;
        assert!(
            !causes.iter().any(|(_, cause)| is_told(cause)),
            "{causes:?}"
        );
    }
}
