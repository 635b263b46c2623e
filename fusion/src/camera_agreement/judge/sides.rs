//! Whether left and right are exchanged in the keypoints of all cameras: a network's card, or a program that wrote keypoints,
//! in another order. All lines of sight meet as well as before, so only the people themselves
//! tell: with the left shoulder taken for the right one everybody has the nose behind the shoulders.

use crate::sightings::diagnosis::SightingDiagnosis;

/// Least bodies that tell, and in how many detection passes.
const MIN_BODIES: u64 = 10;
const MIN_PASSES: u64 = 5;
/// Which share of them must have the nose behind. Of right cameras (the sample, the Shelf, the treadmill) it was ahead in 98
/// to 100 %.
const BEHIND: f64 = 0.85;

/// Whether left and right are exchanged in what all cameras sighted.
pub(in crate::camera_agreement) fn are_exchanged(sighted: &SightingDiagnosis) -> bool {
    let all = sighted.noses_ahead + sighted.noses_behind;
    all >= MIN_BODIES
        && sighted.nose_passes >= MIN_PASSES
        && sighted.noses_behind as f64 >= BEHIND * all as f64
}

#[cfg(test)]
mod tests {
    use super::super::super::fixture::{Hall, Mistake, names};
    use super::super::super::report::DisagreementCause;

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
}
