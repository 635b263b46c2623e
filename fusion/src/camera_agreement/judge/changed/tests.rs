//! A camera that is right in a part of the time.

use super::super::super::fixture::{Hall, Mistake};
use super::*;

/// Four bursts of ten seconds, in which the second camera has `mistake`.
fn hall(mistake: Mistake) -> Hall {
    let mut hall = Hall::with(1, mistake);
    hall.bursts = 4;
    hall
}

fn turned(in_bursts: [usize; 2]) -> Mistake {
    Mistake {
        turned_deg: [0.0, 2.5, 0.0],
        in_bursts: Some(in_bursts),
        ..Mistake::default()
    }
}

#[test]
fn a_camera_that_is_turned_while_people_walk_is_named_with_its_part_of_the_time() {
    for (in_bursts, part_ticks, words) in [
        (
            [2, 3],
            [1200, 1890],
            "in the second half of what is judged (ticks 1200 to 1890), and not in the first, camera cam1",
        ),
        (
            [0, 1],
            [0, 690],
            "in the first half of what is judged (ticks 0 to 690), and not in the second, camera cam1",
        ),
    ] {
        let report = hall(turned(in_bursts)).report();
        let [told] = &report.disagreements[..] else {
            panic!("{:?}", report.disagreements);
        };
        assert_eq!(told.cameras, ["cam1"]);
        assert!(
            matches!(told.cause, DisagreementCause::Turned { degrees } if (1.5..3.5).contains(&degrees)),
            "{told:?}"
        );
        assert_eq!(told.part_ticks, Some(part_ticks));
        assert!(told.found.starts_with(words), "{}", told.found);
        assert!(report.cameras["cam1"].distance_mm > report.cameras["cam0"].distance_mm);
    }
}

#[test]
fn a_camera_that_zooms_while_people_walk_is_named_with_its_half_of_the_time() {
    let zoomed = Mistake {
        focal_factor: 1.08,
        in_bursts: Some([2, 3]),
        ..Mistake::default()
    };
    let report = hall(zoomed).report();
    let [told] = &report.disagreements[..] else {
        panic!("{:?}", report.disagreements);
    };
    assert_eq!(told.cameras, ["cam1"]);
    assert_eq!(told.part_ticks, Some([1200, 1890]));
}

#[test]
fn what_is_wrong_all_the_time_or_never_is_told_of_no_part() {
    let always = hall(turned([0, 3])).report();
    assert!(!always.disagreements.is_empty());
    assert!(always.disagreements.iter().all(|d| d.part_ticks.is_none()));
    assert_eq!(hall(Mistake::default()).report().disagreements, []);
}

#[test]
fn of_five_detection_passes_a_part_is_told_even_where_no_crops_say_what_changed() {
    let zoomed = Mistake {
        focal_factor: 1.1,
        in_bursts: Some([2, 3]),
        ..Mistake::default()
    };
    for mistake in [turned([2, 3]), zoomed] {
        let mut kept = hall(mistake).samples();
        kept.samples.passes.truncate(13);
        kept.samples.bursts.truncate(2);
        let report = kept.report();
        let [told] = &report.disagreements[..] else {
            panic!("{:?}", report.disagreements);
        };
        assert_eq!(told.cameras, ["cam1"]);
        assert_eq!(told.part_ticks, Some([1200, 1800]), "{told:?}");
    }
}

#[test]
fn two_cameras_that_were_exchanged_meanwhile_are_named_with_their_half_of_the_time() {
    let shows = |of_camera| Mistake {
        of_camera: Some(of_camera),
        in_bursts: Some([2, 3]),
        ..Mistake::default()
    };
    let mut hall = hall(shows(2));
    hall.shows[2].1 = shows(1);
    let report = hall.report();
    let [told] = &report.disagreements[..] else {
        panic!("{:?}", report.disagreements);
    };
    assert_eq!(told.cause, DisagreementCause::Swapped);
    assert_eq!(told.cameras, ["cam1", "cam2"]);
    assert_eq!(told.part_ticks, Some([1200, 1890]));
    assert!(told.remedy.contains("put together each one's own pieces"));
}

#[test]
fn of_few_detection_passes_no_part_is_told() {
    let mut few = hall(turned([1, 1]));
    few.bursts = 2;
    let report = few.report();
    assert!(report.disagreements.iter().all(|d| d.part_ticks.is_none()));
}
