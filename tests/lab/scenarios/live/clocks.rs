//! Edges whose clocks are wrong.

use super::stage::{LiveStage, heard};

/// How far from the truth an offset may be measured, microseconds: half of what a loaded machine may take
/// longer one way than the other, at its best moment in some seconds.
const MEASURED_WITHIN_US: i32 = 10_000;

#[test]
fn a_clock_that_is_20_ms_off_is_shown_and_corrected() {
    let mut stage = LiveStage::prepare(&[], "");
    stage
        .live
        .start_edge(0, None, &["--clock-shift-ms", "20"])
        .unwrap();
    let viewpoint = stage.live.edges[0].as_ref().unwrap().name().to_owned();
    stage.start();
    stage.wait("the offset is shown", |seen| {
        let offset_us = heard(seen, &viewpoint).and_then(|edge| edge.clock_offset_us);
        offset_us.is_some_and(|us| (us - 20_000).abs() < MEASURED_WITHIN_US)
    });
    stage.wait("the edge corrects it", |seen| {
        let live = seen.live(&viewpoint);
        live.is_some_and(|l| (l.clock_correction_us + 20_000).abs() < MEASURED_WITHIN_US)
    });
    stage.go_on(1.0);
    let seen = stage.seen();
    assert!(heard(&seen, &viewpoint).unwrap().live);
}

#[test]
fn a_clock_that_is_500_ms_off_is_refused_by_name_and_the_others_go_on() {
    let mut stage = LiveStage::prepare(&[], "");
    stage
        .live
        .start_edge(0, None, &["--clock-shift-ms", "500"])
        .unwrap();
    let viewpoint = stage.live.edges[0].as_ref().unwrap().name().to_owned();
    stage.start();
    stage.wait("the edge is refused", |seen| {
        let refused = heard(seen, &viewpoint).and_then(|edge| edge.refused.as_ref());
        refused.is_some_and(|why| why.contains("clock"))
    });
    stage.go_on(1.0);
}
