//! Fusion goes and comes.

use super::stage::{PEOPLE, RATE_HZ, Stage};

/// Tracks must be back so soon after the first patches, seconds.
const BACK_WITHIN_S: f64 = 2.0;

#[test]
fn a_fusion_that_is_killed_and_started_again_has_its_tracks_back_within_two_seconds_of_data() {
    let mut stage = Stage::open();
    let before = stage.takes();
    let first = stage.watch.seen().newest.as_ref().unwrap().session;
    stage.live.fusion.take().unwrap().kill().unwrap();
    let out = stage.out("second");
    stage.live.start_fusion(&out, &[]).unwrap();
    stage.wait("everybody is tracked again", |seen| {
        let again = seen.newest.as_ref().is_some_and(|set| set.session != first);
        again && seen.tracked() == PEOPLE
    });
    let seen = stage.watch.seen().clone();
    let mut again = seen.arrivals.iter().filter(|a| a.session != first);
    let tracked = again.clone().find(|a| a.tracked == PEOPLE).unwrap();
    let from = again.next().unwrap();
    let took_s = (tracked.tick - from.tick) as f64 / RATE_HZ;
    println!("tracks were back {took_s:.2} s after the first poses, by ticks");
    assert!(took_s <= BACK_WITHIN_S, "{took_s} s");
    stage.go_on(1.0);
    // The edges went on all the while.
    before.assert_flat(&stage.takes());
}
