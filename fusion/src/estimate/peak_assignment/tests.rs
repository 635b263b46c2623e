//! Two people side by side, 24 cm apart across the first camera's line of sight: their wrists are in
//! each other's lattices.

use nalgebra::Vector3;
use proptest::prelude::*;

use super::super::meeting_fixture::{Drawn, LEFT_WRIST, MeetingFixture, RIGHT_WRIST};
use super::*;

/// Remainder of a peak of 0.9 that is surely lost, with a tolerance for the grid.
const LOST: f64 = 0.9 * 0.25;
/// Remainder of a peak of 0.9 that is not lost, with a tolerance for the grid.
const KEPT: f64 = 0.9 * 0.9;

/// Two people who face away from the first camera, at (-5, -4).
const SIDE_BY_SIDE: [[f64; 3]; 2] = [[0.075, -0.094, 0.675], [-0.075, 0.094, 0.675]];

fn place_and_settle(meeting: &mut MeetingFixture) -> PeakAssignment {
    let bodies = meeting.place();
    let mut assignments =
        PeakAssignment::new(&meeting.method.keypoints, meeting.hall.cameras.len());
    assignments.decide(&meeting.tracks, &bodies, &meeting.method);
    for (index, track) in meeting.tracks.iter_mut().enumerate() {
        assignments.carve(index, track);
    }
    assignments
}

fn two() -> MeetingFixture {
    let mut meeting = MeetingFixture::at(&SIDE_BY_SIDE);
    meeting.begin();
    meeting
}

fn keypoint(meeting: &MeetingFixture, person: usize, keypoint: usize) -> Vector3<f64> {
    meeting.tracks[person].keypoints_m()[keypoint]
}

/// The drawing with the peaks of one keypoint replaced.
fn with(mut drawn: Vec<Drawn>, keypoint: usize, peaks: &[(Vector3<f64>, f64)]) -> Vec<Drawn> {
    drawn.retain(|(k, _, _)| *k != keypoint);
    drawn.extend(peaks.iter().map(|&(at_m, height)| (keypoint, at_m, height)));
    drawn
}

/// The first person's map of the left wrist shows `shown` of the second, in the view of `camera`: the
/// first loses that peak and the second keeps it.
fn goes_to_its_owner(mut meeting: MeetingFixture, shown: usize, camera: usize) {
    let theirs = keypoint(&meeting, 1, shown);
    let leaked = with(meeting.true_peaks(0), LEFT_WRIST, &[(theirs, 0.9)]);
    let clean = meeting.true_peaks(1);
    meeting.show(0, 0, &leaked);
    meeting.show(1, camera, &clean);
    place_and_settle(&mut meeting);
    assert!(meeting.value(0, 0, LEFT_WRIST, theirs) < LOST);
    assert!(meeting.value(1, 0, shown, theirs) > KEPT);
}

#[test]
fn a_leaked_peak_is_removed_and_the_own_one_stays() {
    let mut meeting = two();
    let wrists = [0, 1].map(|person| keypoint(&meeting, person, LEFT_WRIST));
    let leaked = with(
        meeting.true_peaks(0),
        LEFT_WRIST,
        &[(wrists[0], 0.5), (wrists[1], 0.9)],
    );
    let clean = meeting.true_peaks(1);
    meeting.show(0, 0, &leaked);
    meeting.show(1, 0, &clean);
    let assignments = place_and_settle(&mut meeting);
    assert!(assignments.n_lost() > 0);
    assert!(meeting.value(0, 0, LEFT_WRIST, wrists[1]) < LOST);
    assert!(meeting.value(0, 0, LEFT_WRIST, wrists[0]) > 0.9 * 0.5);
    assert!(meeting.value(1, 0, LEFT_WRIST, wrists[1]) > KEPT);
}

#[test]
fn a_leaked_peak_is_removed_without_an_own_one() {
    goes_to_its_owner(two(), LEFT_WRIST, 0);
}

#[test]
fn the_order_of_persons_does_not_matter() {
    let leak = |meeting: &mut MeetingFixture, from: usize, to: usize| {
        let theirs = keypoint(meeting, from, LEFT_WRIST);
        let leaked = with(meeting.true_peaks(to), LEFT_WRIST, &[(theirs, 0.9)]);
        let clean = meeting.true_peaks(from);
        meeting.show(to, 0, &leaked);
        meeting.show(from, 0, &clean);
        place_and_settle(meeting);
        meeting.value(to, 0, LEFT_WRIST, theirs)
    };
    let mut meeting = two();
    let first = leak(&mut meeting, 0, 1);
    let mut meeting = MeetingFixture::at(&[SIDE_BY_SIDE[1], SIDE_BY_SIDE[0]]);
    meeting.begin();
    let second = leak(&mut meeting, 1, 0);
    assert!((first - second).abs() < 1e-12);
}

#[test]
fn a_peak_in_two_cameras_of_a_viewpoint_is_one() {
    let mut meeting = two();
    // The second camera of the viewpoint stands 20 cm from the first.
    let eye = meeting.hall.cameras[0].1.center().coordinates_m() + Vector3::new(0.1, -0.17, 0.0);
    let second = crate::sightings::fixture::looking_at_the_middle("second", eye);
    meeting.hall.cameras.push((ViewpointIndex(0), second));
    goes_to_its_owner(meeting, LEFT_WRIST, 4);
}

#[test]
fn the_other_side_of_another_person_competes() {
    goes_to_its_owner(two(), RIGHT_WRIST, 0);
}

#[test]
fn two_hands_in_one_place_share_a_peak() {
    // Both predictions are one spot: no claim is better.
    let mut meeting = MeetingFixture::at(&[[0.0, 0.0, 0.3], [0.0, 0.0, 0.3]]);
    meeting.begin();
    let at_m = keypoint(&meeting, 0, LEFT_WRIST);
    for person in 0..2 {
        let drawn = meeting.true_peaks(person);
        meeting.show(person, 0, &drawn);
    }
    place_and_settle(&mut meeting);
    for person in 0..2 {
        assert!(meeting.value(person, 0, LEFT_WRIST, at_m) > KEPT);
    }
}

#[test]
fn distant_people_and_clean_maps_do_not_change() {
    for places in [[[0.0, -1.2, 0.3], [0.0, 1.2, 0.3]], SIDE_BY_SIDE] {
        let mut meeting = MeetingFixture::at(&places);
        meeting.begin();
        for camera in 0..4 {
            for person in 0..2 {
                let drawn = meeting.true_peaks(person);
                meeting.show(person, camera, &drawn);
            }
        }
        assert_eq!(place_and_settle(&mut meeting).n_lost(), 0);
    }
}

#[test]
fn a_disabled_assignment_changes_nothing() {
    let mut meeting = two();
    meeting.method.parameters.contact.yield_share = 0.0;
    let theirs = keypoint(&meeting, 1, LEFT_WRIST);
    let leaked = with(meeting.true_peaks(0), LEFT_WRIST, &[(theirs, 0.9)]);
    let clean = meeting.true_peaks(1);
    meeting.show(0, 0, &leaked);
    meeting.show(1, 0, &clean);
    assert_eq!(place_and_settle(&mut meeting).n_lost(), 0);
    assert!(meeting.value(0, 0, LEFT_WRIST, theirs) > KEPT);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// For any drawing, no value grows or goes below the share that stays. A person whose map alone
    /// shows a peak keeps it.
    #[test]
    fn maps_lose_a_bounded_share(
        shifts in prop::array::uniform4(prop::array::uniform3(-0.2f64..0.2)), camera in 0usize..4,
    ) {
        let mut meeting = two();
        for person in 0..2 {
            let mut drawn = meeting.true_peaks(person);
            for (shift, k) in shifts.iter().zip([5, 6, LEFT_WRIST, RIGHT_WRIST]) {
                let at_m = keypoint(&meeting, 1 - person, k) + Vector3::from(*shift);
                drawn.push((k, at_m, 0.8));
            }
            meeting.show(person, camera, &drawn);
        }
        let before: Vec<Vec<u8>> = cells(&meeting);
        place_and_settle(&mut meeting);
        let least = 1.0 - meeting.method.parameters.contact.yield_share;
        for (before, after) in before.iter().flatten().zip(cells(&meeting).iter().flatten()) {
            prop_assert!(after <= before);
            // A cell may lie in the notches of several peaks.
            prop_assert!(f64::from(*after) + 0.5 >= least.powi(4) * f64::from(*before) - 0.5);
        }
    }
}

fn cells(meeting: &MeetingFixture) -> Vec<Vec<u8>> {
    let views = meeting.tracks.iter().flat_map(Estimator::views);
    views
        .flat_map(|view| (0..view.n_keypoints()).map(|k| view.cells_for_test(k)))
        .collect()
}
