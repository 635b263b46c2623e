//! Truths that are many ticks late, and right ones that something makes look so.

use super::*;

#[test]
fn a_truth_that_is_many_ticks_late_is_told_with_how_many() {
    for (late, words) in [
        (30, "to be 30 ticks later"),
        (-42, "to be 42 ticks earlier"),
        (11, "to be 11 ticks later"),
    ] {
        check(DoubtCause::OtherTicks, words, |tick, person| {
            walker(tick - late, person)
        });
    }
    // Of so many ticks a longer file leaves enough.
    let (late, mut noise) = (110, Noise(3));
    let poses = lines(0..300, 11..13, |tick, person| {
        noise.on(&walker(tick, person - 11), GOOD_SIGMA_M)
    });
    let truth = lines(0..300, 0..2, |tick, person| walker(tick - late, person));
    let doubt = misread(&poses, &truth, Some(400.0)).unwrap();
    assert!(doubt.found.contains("to be 110 ticks later"), "{doubt:?}");
}

/// Who walks on a treadmill: a step is 31 ticks, and nothing but the limbs tells time.
fn on_a_treadmill(tick: i64, _person: u32) -> ScoredBody {
    let stride = 0.3 * (std::f64::consts::TAU * tick as f64 / 31.0).sin();
    let mut body = standing(0, 0);
    for (slot, point) in body.points_m.iter_mut().enumerate() {
        let side = if slot % 2 == 0 { stride } else { -stride };
        *point = point.map(|at_m| at_m + Vector3::new(side, 0.0, 0.0));
    }
    body
}

#[test]
fn of_what_recurs_the_fewest_ticks_are_told() {
    for late in [5, 36, -26] {
        let truth = truth(1, |tick, person| on_a_treadmill(tick - late, person));
        let mut noise = Noise(3);
        let poses = lines(0..100, 0..1, |tick, person| {
            noise.on(&on_a_treadmill(tick, person), GOOD_SIGMA_M)
        });
        let found = misread(&poses, &truth, Some(200.0)).unwrap().found;
        assert!(found.contains("to be 5 ticks later:"), "{found}");
    }
}

#[test]
fn poses_that_are_bad_for_a_while_make_no_late_truth_of_one_that_is_right() {
    // Who stands for two thirds of the time, and jumps on the spot in the last: no pose follows there, or none does anywhere else.
    let jumping = |tick: i64, person: u32| {
        let up_m = if tick < 60 {
            0.0
        } else {
            0.4 * (0.3 * tick as f64).sin().abs()
        };
        moved(&standing(0, person), |at_m| {
            at_m + Vector3::new(0.0, 0.0, up_m)
        })
    };
    let right = truth(2, jumping);
    for bad in [0..30, 20..60, 60..100] {
        let mut noise = Noise(7);
        let found = lines(0..100, 0..2, |tick, person| {
            let aside_m = if bad.contains(&tick) { 0.4 } else { 0.0 };
            let body = moved(&jumping(tick, person), |at_m| {
                at_m + Vector3::new(aside_m, 0.0, 0.0)
            });
            noise.on(&body, 0.02)
        });
        check_silent(&found, &right);
        assert_eq!(misread(&found, &right, None), None, "{bad:?}");
    }
}

#[test]
fn who_follows_somebody_on_the_same_path_makes_no_truth_late() {
    // Thirty ticks behind the first; the poses hold both, one of the two, or take each for the other.
    let queue = |tick: i64, person: u32| walker(tick - 30 * i64::from(person), 0);
    let right = truth(2, queue);
    for people in [0..2, 0..1, 1..2] {
        for sigma_m in [0.02, 0.03] {
            let mut noise = Noise(11);
            let found = lines(0..100, people.clone(), |tick, person| {
                noise.on(&queue(tick, person), sigma_m)
            });
            check_silent(&found, &right);
            assert_eq!(misread(&found, &right, None), None);
        }
    }
}
