//! Truths that count other ticks from some time on.

use super::*;

fn said_of(truth: &PoseLines) -> String {
    let found = doubted(&poses(2, GOOD_SIGMA_M), truth, TruthExtent::Whole);
    let of_ticks = |doubt: &&Doubt| doubt.cause == DoubtCause::OtherTicks;
    let said = found.iter().find(of_ticks);
    said.map_or_else(String::new, |doubt| doubt.found.clone())
}

#[test]
fn a_truth_that_lost_frames_half_way_is_told_with_how_many_and_when() {
    let lost = truth(2, |tick, person| {
        walker(tick + if tick < 50 { 0 } else { 6 }, person)
    });
    let said = said_of(&lost);
    assert!(said.contains("6 ticks earlier at ticks 50 to 99"), "{said}");
    assert!(!said.contains("0 to 49"), "{said}");
}

#[test]
fn a_truth_of_a_rate_that_is_a_little_other_is_told_by_both_halves() {
    let slow = truth(2, |tick, person| {
        walker((1.06 * tick as f64).round() as i64, person)
    });
    let said = said_of(&slow);
    assert!(said.contains("at ticks 50 to 99"), "{said}");
    assert!(said.contains("counts at another rate"), "{said}");
}

#[test]
fn poses_that_stand_still_for_half_of_the_time_make_no_truth_lose_frames() {
    let mut noise = Noise(3);
    let stuck = lines(0..100, 11..13, |tick, person| {
        noise.on(&walker(tick.min(50), person - 11), GOOD_SIGMA_M)
    });
    let found = doubted(&stuck, &truth(2, walker), TruthExtent::Whole);
    assert!(found.is_empty(), "{found:?}");
}
