//! Two worlds of two cameras each.

use super::super::super::AgreementSamples;
use super::super::super::fixture::{Hall, Mistake};
use super::super::before::JudgedBefore;
use super::*;

/// A hall of which the last two cameras were calibrated with an origin so far from that of the others.
fn hall(apart_m: [f64; 3]) -> Hall {
    let mut hall = Hall {
        bursts: 4,
        ..Hall::default()
    };
    for (_, mistake) in &mut hall.shows[2..] {
        *mistake = Mistake {
            moved_m: apart_m,
            ..Mistake::default()
        };
    }
    hall
}

/// What is kept where everybody is followed twice: where the first two cameras show them, and so far from there.
fn followed_twice(hall: &Hall, apart_m: [f64; 3]) -> AgreementSamples {
    let mut samples = hall.samples();
    let poses: Vec<PosedTick> = samples
        .samples
        .poses
        .iter()
        .map(|p| (**p).clone())
        .collect();
    samples.samples.poses.clear();
    for mut posed in poses {
        let moved = |m: &[f32; 3]| [0, 1, 2].map(|axis| m[axis] - apart_m[axis] as f32);
        let again = posed
            .people
            .iter()
            .map(|(id, body)| (id + 10, body.iter().map(moved).collect()));
        let again: Vec<(u32, Vec<[f32; 3]>)> = again.collect();
        posed.people.extend(again);
        samples.samples.poses.push_back(std::sync::Arc::new(posed));
    }
    samples
}

#[test]
fn people_whom_two_cameras_show_here_and_two_there_are_one() {
    for apart_m in [[0.5, 0.3, 0.0], [0.0, 0.3, 0.1]] {
        // Two origins are told of as such, so nothing but this rule is asked.
        let samples = followed_twice(&hall(apart_m), apart_m);
        let before = &mut JudgedBefore::default();
        let judge = Judge::new(&samples.cameras, &samples.samples, before);
        let mut report = judge.report();
        judge.tell_of_doubled(&mut report);
        let [told] = &report.disagreements[..] else {
            panic!("{:?}", report.disagreements);
        };
        let far_m = Vector3::from(apart_m).norm();
        let DisagreementCause::Doubled { apart_m } = told.cause else {
            panic!("{told:?}");
        };
        assert!((apart_m - far_m).abs() < 0.03, "{apart_m} {far_m}");
        assert!(told.cameras == ["cam0", "cam1"] || told.cameras == ["cam2", "cam3"]);
    }
}

#[test]
fn two_who_move_alike_are_two_where_a_camera_shows_both_or_few_tell() {
    let samples = hall([0.0; 3]).samples();
    let judge = Judge::new(
        &samples.cameras,
        &samples.samples,
        &mut JudgedBefore::default(),
    );
    let telling = |shown: [[usize; 2]; 4], [both, neither]: [usize; 2]| Telling {
        shown: shown.into_iter().enumerate().collect(),
        both,
        neither,
    };
    let apart = [[6, 0], [6, 1], [0, 6], [0, 6]];
    assert!(telling(apart, [1, 8]).is_one_person(&judge));
    assert!(
        !telling(apart, [4, 0]).is_one_person(&judge),
        "both are shown"
    );
    assert!(
        !telling(apart, [0, 20]).is_one_person(&judge),
        "hidden from most"
    );
    assert!(!telling([[6, 0], [6, 0], [6, 0], [0, 6]], [0; 2]).is_one_person(&judge));
    assert!(!telling([[2, 0], [2, 0], [0, 2], [0, 2]], [0; 2]).is_one_person(&judge));
}

#[test]
fn bodies_of_two_postures_are_not_alike() {
    let body = |bent: f32| -> Vec<[f32; 3]> {
        (0..17_u8)
            .map(|k| [f32::from(k) * bent, 0.0, 0.1 * f32::from(k)])
            .collect()
    };
    let moved = |body: &[[f32; 3]]| -> Vec<[f32; 3]> {
        body.iter()
            .map(|m| [m[0] + 0.3, m[1] + 0.4, m[2]])
            .collect()
    };
    let apart_m = apart_if_alike_m(&body(0.05), &moved(&body(0.05))).unwrap();
    assert!((apart_m - 0.5).abs() < 1e-6);
    assert_eq!(apart_if_alike_m(&body(0.05), &moved(&body(-0.02))), None);
    assert_eq!(
        apart_if_alike_m(&body(0.05), &body(0.05)),
        None,
        "one place"
    );
}
