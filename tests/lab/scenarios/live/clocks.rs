//! Edges whose clocks are wrong.

use farfield_lab::relay::{Direction, Impairment};
use farfield_proto::message::health::LinkHealth;

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

#[test]
fn a_clock_that_ntp_keeps_right_is_left_alone_on_a_lopsided_link_and_is_let_in_once_it_is_set() {
    let mut stage = LiveStage::prepare(&[], "");
    // Both are kept right; the second starts 2 s wrong and is set soon after.
    let late = [
        "--clock-synchronised",
        "--clock-shift-ms",
        "-2000",
        "--clock-set-after-s",
        "12",
        "--clock-set-by-ms",
        "2000",
    ];
    for (i, arguments) in [&["--clock-synchronised"][..], &late]
        .into_iter()
        .enumerate()
    {
        stage.live.start_edge(i, None, arguments).unwrap();
    }
    let names = [0, 1].map(|i| stage.live.edges[i].as_ref().unwrap().name().to_owned());
    for relay in &stage.live.relays[..2] {
        for (direction, delay_us) in [(Direction::Up, 30_000), (Direction::Down, 10_000)] {
            relay.set(
                direction,
                Impairment {
                    delay_us,
                    ..Impairment::default()
                },
            );
        }
    }
    stage.start();
    stage.wait("the edge that is 2 s wrong is refused", |seen| {
        let refused = heard(seen, &names[1]).and_then(|edge| edge.refused.as_ref());
        refused.is_some_and(|why| why.contains("clock"))
    });
    stage.wait("it is let in once it is set", |seen| {
        heard(seen, &names[1]).is_some_and(|edge| edge.live && edge.refused.is_none())
    });
    stage.go_on(2.0);
    let seen = stage.seen();
    let health = |name: &String| -> LinkHealth {
        let fusion = &seen.statuses["fusion"];
        let edges = &fusion.live.as_ref().unwrap().edges;
        let at = edges
            .iter()
            .position(|edge| edge.viewpoint == *name)
            .unwrap();
        fusion.health.links[at]
    };
    let first = health(&names[0]);
    println!(
        "a link of 30 ms up and 10 ms down: {first:?}, then one set by 2 s: {:?}",
        health(&names[1])
    );
    assert!(
        first.clock_correction_us.unwrap().abs() <= 1_000,
        "{first:?}"
    );
    assert!(first.clock_uncertainty_us.unwrap() >= 25_000, "{first:?}");
    // It goes on by the time that it began with, but for what it is told.
    let second = health(&names[1]).clock_correction_us.unwrap();
    assert!((second - 2_000_000).abs() <= 30_000, "{second}");
}

#[test]
fn where_all_edges_agree_fusion_suspects_its_own_clock_and_refuses_nobody() {
    let mut stage = LiveStage::prepare(&[], "");
    for i in 0..stage.live.edges.len() {
        stage
            .live
            .start_edge(i, None, &["--clock-shift-ms", "2000"])
            .unwrap();
    }
    stage.start();
    stage.wait("fusion suspects itself", |seen| {
        let fusion = seen.statuses.get("fusion");
        fusion.is_some_and(|status| {
            let mut notices = status.health.notices.iter();
            notices.any(|notice| notice.contains("fusion's clock seems to be -2.0"))
        })
    });
    stage.go_on(1.0);
    let seen = stage.seen();
    let edges = &seen.live("fusion").unwrap().edges;
    assert!(edges.iter().all(|edge| edge.live), "{edges:?}");
}
