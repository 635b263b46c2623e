//! Whether left and right are exchanged in the keypoints of all cameras: a network's card, or a program that wrote keypoints,
//! in another order, for all of the time or at times. All lines of sight meet as well as before, so only the people themselves
//! tell: with the left shoulder taken for the right one everybody has the nose behind the shoulders.

use super::super::report::DisagreementCause;
use super::exchanged::ExchangeVotes;
use crate::sightings::diagnosis::SightingDiagnosis;

/// Least bodies that tell, and in how many detection passes.
const MIN_BODIES: u64 = 10;
const MIN_PASSES: u64 = 5;
/// Which share of them must have the nose behind. Of right cameras (the sample, the Shelf, the treadmill) it was ahead in 98
/// to 100 %.
const BEHIND: f64 = 0.85;
/// Passes all of whose people have sides exchanged, and passes of nobody so, that there must be for it to come and go, and bodies
/// in them. Of right cameras (the sample, the Shelf, four simulated scenes) no pass was so.
const MIN_OF_EITHER: usize = 2;
const MIN_BODIES_OF_EITHER: usize = 4;
/// Which share of all of them may have both: a network that errs does so for one person, and a file for all of them.
const MIXED: f64 = 0.2;
/// Which share of those that are one or the other must be exchanged: of right cameras 2 % of the noses were behind.
const AT_TIMES: f64 = 0.15;

/// Whether left and right are exchanged in what all cameras sighted.
pub(in crate::camera_agreement) fn are_exchanged(sighted: &SightingDiagnosis) -> bool {
    let all = sighted.noses_ahead + sighted.noses_behind;
    all >= MIN_BODIES
        && sighted.nose_passes >= MIN_PASSES
        && sighted.noses_behind as f64 >= BEHIND * all as f64
}

/// That left and right are exchanged in what all cameras sighted in some detection passes, and not in the others.
pub(in crate::camera_agreement) fn are_exchanged_at_times(
    votes: &ExchangeVotes,
) -> Option<DisagreementCause> {
    let passes = votes.sides_of_passes().iter();
    let telling: Vec<&[usize; 2]> = passes.filter(|[a, b]| a + b > 0).collect();
    let whole = |of: usize| {
        let own = telling.iter().filter(|pass| pass[1 - of] == 0);
        own.fold((0, 0), |(n, bodies), pass| (n + 1, bodies + pass[of]))
    };
    let (exchanged, right) = (whole(0), whole(1));
    let mixed = telling.len() - exchanged.0 - right.0;
    let share = exchanged.0 as f64 / (exchanged.0 + right.0).max(1) as f64;
    let are_enough = |(n, bodies)| n >= MIN_OF_EITHER && bodies >= MIN_BODIES_OF_EITHER;
    let is_told = are_enough(exchanged)
        && are_enough(right)
        && share >= AT_TIMES
        && mixed as f64 <= MIXED * telling.len() as f64;
    is_told.then(|| DisagreementCause::SidesAtTimes {
        share: (100.0 * share).round() / 100.0,
    })
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake, names};
    use super::*;

    const EXCHANGED: [usize; 17] = [0, 2, 1, 4, 3, 6, 5, 8, 7, 10, 9, 12, 11, 14, 13, 16, 15];

    fn with_exchanged_sides(cameras: &[usize]) -> Vec<(Vec<String>, DisagreementCause)> {
        let mut hall = Hall::default();
        for &camera in cameras {
            hall.shows[camera].1 = Mistake {
                order: Some(EXCHANGED.map(|k: usize| k as u8)),
                ..Mistake::default()
            };
        }
        hall.causes()
    }

    #[test]
    fn left_and_right_exchanged_in_all_cameras_are_told_by_where_noses_are() {
        let of_sides = DisagreementCause::KeypointOrder {
            moved: 16,
            sides: true,
        };
        assert_eq!(
            with_exchanged_sides(&[0, 1, 2, 3]),
            [(Vec::new(), of_sides)]
        );
    }

    #[test]
    fn of_one_camera_it_is_said_of_that_camera_and_of_right_ones_nothing() {
        assert_eq!(with_exchanged_sides(&[]), []);
        let told = with_exchanged_sides(&[2]);
        assert_eq!(told.len(), 1, "{told:?}");
        assert_eq!(told[0].0, names(&[2]));
    }

    #[test]
    fn sides_that_are_exchanged_in_all_cameras_at_times_are_told_with_the_share() {
        let exchanged_in = |bursts: [usize; 2], cameras: &[usize]| {
            let mut hall = Hall {
                bursts: 3,
                ..Hall::default()
            };
            for &camera in cameras {
                hall.shows[camera].1 = Mistake {
                    order: Some(EXCHANGED.map(|k: usize| k as u8)),
                    in_bursts: Some(bursts),
                    ..Mistake::default()
                };
            }
            hall.causes()
        };
        let told = DisagreementCause::SidesAtTimes { share: 0.33 };
        assert_eq!(exchanged_in([1, 1], &[0, 1, 2, 3]), [(Vec::new(), told)]);
        // One camera that errs so for some of the time is outvoted by the others.
        let of_one = exchanged_in([1, 1], &[2]);
        assert!(
            !of_one.iter().any(|(_, cause)| *cause == told),
            "{of_one:?}"
        );
    }
}
