//! An edge on a link with known properties, and what fusion measures of it.

use farfield_proto::id::{CameraIndex, SessionId, ViewpointIndex};
use farfield_proto::message::live::{BoxEcho, PatchTiming};
use farfield_proto::message::{Order, PersonPatch, Sighting};

use super::*;
use crate::live::fixture;

const BOUND_MS: f64 = 100.0;
const WAITS: LongestWaits = LongestWaits {
    patches_us: 400_000,
    detections_us: 400_000,
    enough_since_us: None,
};
const START_US: Micros = 1_700_000_000 * SECOND_US;

fn time() -> TickTime {
    TickTime::with_tick_at(Tick(0), START_US, 60.0)
}

fn boxes(tick: i64, detect: bool) -> BoxSet {
    BoxSet {
        session: SessionId(1),
        tick: Tick(tick),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        order: Order::Track,
        live: None,
        detection_cameras: if detect {
            vec![CameraIndex(0)]
        } else {
            Vec::new()
        },
        persons: Vec::new(),
    }
}

fn patches(tick: i64, timing: PatchTiming, box_tick: Option<i64>) -> PatchSet {
    let patch = |box_tick| PersonPatch {
        box_tick: Tick(box_tick),
        capture_offset_us: 1_000,
        ..fixture::patch(1)
    };
    PatchSet {
        timing: Some(timing),
        persons: box_tick.map(patch).into_iter().collect(),
        ..fixture::patches(tick, 0, 0, 1)
    }
}

/// A pass at `tick` that found a person, or none.
fn sightings(tick: i64, finds: bool) -> SightingSet {
    let sighting = Sighting {
        camera: CameraIndex(0),
        score: 1.0,
        keypoints: Vec::new(),
    };
    SightingSet {
        session: SessionId(1),
        tick: Tick(tick),
        viewpoint: ViewpointIndex(0),
        part: 0,
        parts: 1,
        sightings: vec![sighting; usize::from(finds)],
    }
}

/// Runs an edge for `ticks` with a clock offset of `offset_us` and a one-way delay of `delay_us`.
/// It works on each tick 5 ms after it, with the newest boxes. Boxes leave 30 ms after their tick.
fn run(edge: &mut Edge, ticks: Range<i64>, offset_us: Micros, delay_us: Micros) -> Trip {
    let time = time();
    let mut sent_boxes: VecDeque<(u32, i64, i32, Micros)> = VecDeque::new();
    let mut trip = Trip::default();
    for tick in ticks {
        let sent_us = time.at(Tick(tick)) + 5_000;
        let used = sent_boxes
            .iter()
            .rev()
            .find(|(.., at)| at + delay_us <= sent_us);
        let timing = used.map_or(
            PatchTiming {
                sent_after_us: (5_000 + offset_us) as i32,
                clock_correction_us: 0,
                echo: None,
            },
            |&(sequence, _, correction, at)| PatchTiming {
                sent_after_us: (5_000 + offset_us) as i32 + correction,
                clock_correction_us: correction,
                echo: Some(BoxEcho {
                    sequence,
                    held_us: (sent_us - at - delay_us) as u32,
                }),
            },
        );
        let set = patches(tick, timing, used.map(|sent_boxes| sent_boxes.1));
        let came = Came {
            at_us: sent_us + delay_us,
            bytes: 500,
        };
        trip = edge.receive_patches(&set, came, &time);
        let publish_us = time.at(Tick(tick)) + 30_000 + delay_us;
        let horizon = edge.horizon_ticks(30_000.0 + delay_us as f64, time.period_us()) as i64;
        let set = boxes(tick + horizon, false);
        let live = edge.send(&set, &time, publish_us);
        sent_boxes.push_back((
            live.sequence,
            set.tick.0,
            live.clock_correction_us.unwrap_or(0),
            publish_us,
        ));
    }
    trip
}

use std::ops::Range;

#[test]
fn a_small_clock_offset_is_corrected_and_reported() {
    let mut edge = Edge::new("north", BOUND_MS);
    run(&mut edge, 0..120, 20_000, 40_000);
    let link = edge.link(time().at(Tick(121)));
    assert_eq!(link.round_trip_us, Some(80_000));
    assert_eq!(link.clock_offset_us, Some(20_000));
    assert!(edge.is_on_time() && link.refused.is_none());
    let live = edge.send(&boxes(130, false), &time(), START_US);
    assert_eq!(live.clock_correction_us, Some(-20_000));
    let used = live.heard.unwrap();
    assert_eq!((used.tick, used.one_way_us), (Tick(119), 40_000));
}

#[test]
fn a_large_clock_offset_is_refused_until_it_is_corrected() {
    let mut edge = Edge::new("north", BOUND_MS);
    run(&mut edge, 0..120, 500_000, 2_000);
    assert!(!edge.is_on_time());
    let refused = edge.link(0).refused.unwrap();
    assert!(
        refused.contains("500 ms") && refused.contains("100"),
        "{refused}"
    );
    run(&mut edge, 120..900, 0, 2_000);
    assert!(edge.is_on_time() && edge.link(0).refused.is_none());
}

#[test]
fn boxes_are_made_for_the_tick_at_which_they_are_used() {
    for delay_us in [0, 10_000, 40_000, 100_000] {
        let mut edge = Edge::new("north", BOUND_MS);
        run(&mut edge, 0..600, 0, delay_us);
        let time = time();
        let horizon = edge.horizon_ticks(30_000.0 + delay_us as f64, time.period_us()) as i64;
        // Boxes of tick 0 arrive at 30 ms and two one-way delays; pictures are processed 5 ms after
        // their tick.
        let arrive_us = (30_000 + 2 * delay_us - 5_000) as f64;
        let used = (arrive_us / time.period_us()).ceil() as i64;
        assert!(
            (horizon - used).abs() <= 1,
            "delay {delay_us}: {horizon} for {used}"
        );
    }
}

#[test]
fn the_delays_of_patches_and_boxes_are_measured() {
    let mut edge = Edge::new("north", BOUND_MS);
    let trip = run(&mut edge, 0..300, 0, 10_000);
    assert_eq!(
        trip.sent_us,
        Some(4_000),
        "the pictures were taken 1 ms after their tick"
    );
    assert_eq!(trip.arrived_us, Some(10_000));
    let used_us = trip.box_used_us.unwrap();
    assert!(
        (10_000..10_000 + 2 * 16_667).contains(&used_us),
        "{used_us}"
    );
}

#[test]
fn a_silent_edge_is_not_awaited_and_a_new_one_unknown() {
    let mut edge = Edge::new("north", BOUND_MS);
    run(&mut edge, 0..60, 0, 1_000);
    let last_us = time().at(Tick(59)) + 6_000;
    assert!(edge.is_heard(last_us + SILENT_US) && !edge.is_heard(last_us + SILENT_US + 1));
    edge.start_again();
    assert!(!edge.is_heard(last_us) && !edge.is_on_time());
}

#[test]
fn an_expected_edge_is_awaited_for_a_while() {
    let mut edge = Edge::new("north", BOUND_MS);
    assert!(!edge.is_awaited(START_US));
    edge.expect(START_US + SECOND_US);
    assert!(edge.is_awaited(START_US) && !edge.is_awaited(START_US + SECOND_US));
    run(&mut edge, 0..2, 0, 1_000);
    assert!(edge.is_awaited(time().at(Tick(2))));
    assert!(
        !edge.is_awaited(START_US + SECOND_US),
        "it has fallen silent"
    );
}

#[test]
fn impossible_ticks_do_not_change_link_statistics() {
    let mut edge = Edge::new("north", BOUND_MS);
    run(&mut edge, 0..60, 0, 1_000);
    let before = edge.send(&boxes(70, false), &time(), START_US).heard;
    for tick in [i64::MIN, -1 << 40, 1 << 40, i64::MAX] {
        let timing = PatchTiming {
            sent_after_us: i32::MAX,
            clock_correction_us: 0,
            echo: None,
        };
        let came = Came {
            at_us: time().at(Tick(60)),
            bytes: 9,
        };
        let trip = edge.receive_patches(&patches(tick, timing, Some(tick)), came, &time());
        assert_eq!(trip, Trip::default());
    }
    let after = edge.send(&boxes(71, false), &time(), START_US).heard;
    assert_eq!(before.map(|h| h.tick), after.map(|h| h.tick));
}

#[test]
fn missing_ticks_count_from_the_first_message() {
    let mut edge = Edge::new("north", BOUND_MS);
    edge.miss(Tick(3));
    run(&mut edge, 10..12, 0, 1_000);
    edge.miss(Tick(9));
    edge.miss(Tick(12));
    assert_eq!(edge.missing, 1);
}

#[test]
fn detection_passes_are_waited_for_longer_than_other_ticks() {
    let mut edge = Edge::new("north", BOUND_MS);
    run(&mut edge, 0..60, 0, 1_000);
    let time = time();
    edge.send(&boxes(70, true), &time, time.at(Tick(60)));
    let came = Came {
        at_us: time.at(Tick(70)) + 90_000,
        bytes: 10,
    };
    edge.receive_sightings(&sightings(70, true), came, &time);
    edge.send(&boxes(80, true), &time, time.at(Tick(71)));
    let now_us = time.at(Tick(71));
    let mut waits = |tick| edge.deadline_us(Tick(tick), &time, now_us, WAITS) - time.at(Tick(tick));
    assert!((180_000..200_000).contains(&waits(80)), "{}", waits(80));
    assert!(waits(79) < 20_000);
}

#[test]
fn a_pass_without_people_is_no_measure_of_passes() {
    let mut edge = Edge::new("north", BOUND_MS);
    let time = time();
    for tick in [0, 60] {
        edge.send(&boxes(tick, true), &time, time.at(Tick(tick)));
    }
    let came = Came {
        at_us: time.at(Tick(0)) + 4_000,
        bytes: 10,
    };
    edge.receive_sightings(&sightings(0, false), came, &time);
    let now_us = time.at(Tick(60));
    let until_us = edge.deadline_us(Tick(60), &time, now_us, WAITS);
    assert_eq!(until_us - now_us, WAITS.detections_us);
}

#[test]
fn patches_of_later_ticks_do_not_end_the_wait_for_sightings() {
    let mut edge = Edge::new("north", BOUND_MS);
    run(&mut edge, 0..60, 0, 1_000);
    let time = time();
    edge.send(&boxes(70, true), &time, time.at(Tick(60)));
    let late = Came {
        at_us: time.at(Tick(70)) + 250_000,
        bytes: 10,
    };
    edge.receive_sightings(&sightings(70, true), late, &time);
    edge.send(&boxes(80, true), &time, time.at(Tick(71)));
    run(&mut edge, 81..84, 0, 1_000);
    let now_us = time.at(Tick(84));
    let waited_us = edge.deadline_us(Tick(80), &time, now_us, WAITS) - time.at(Tick(80));
    assert!(waited_us >= 250_000, "{waited_us}");
}

#[test]
fn enough_sightings_shorten_the_wait_for_the_rest() {
    let mut edge = Edge::new("north", BOUND_MS);
    run(&mut edge, 0..60, 0, 1_000);
    let time = time();
    edge.send(&boxes(60, true), &time, time.at(Tick(59)));
    let enough = LongestWaits {
        enough_since_us: Some(time.at(Tick(60)) + 20_000),
        ..WAITS
    };
    let first_us = edge.deadline_us(Tick(60), &time, time.at(Tick(60)), enough);
    assert_eq!(first_us - time.at(Tick(60)), 70_000, "nothing is usual yet");
    for (tick, delay_us) in [(60, 60_000), (120, 60_000), (180, 390_000)] {
        edge.send(&boxes(tick, true), &time, time.at(Tick(tick - 1)));
        let came = Came {
            at_us: time.at(Tick(tick)) + delay_us,
            bytes: 10,
        };
        edge.receive_sightings(&sightings(tick, true), came, &time);
    }
    edge.send(&boxes(240, true), &time, time.at(Tick(239)));
    let tick_us = time.at(Tick(240));
    let mut waited_us = |since_us: Option<Micros>| {
        let waits = LongestWaits {
            enough_since_us: since_us.map(|us| tick_us + us),
            ..WAITS
        };
        edge.deadline_us(Tick(240), &time, tick_us, waits) - tick_us
    };
    assert_eq!(waited_us(None), WAITS.detections_us);
    assert_eq!(waited_us(Some(20_000)), 110_000, "than usual");
    assert_eq!(waited_us(Some(90_000)), 140_000, "than the others");
}

#[test]
fn an_edge_of_every_fourth_tick_is_awaited_at_these() {
    let mut edge = Edge::new("north", BOUND_MS);
    let time = time();
    let receive_one = |edge: &mut Edge, tick: i64| {
        let timing = PatchTiming {
            sent_after_us: 5_000,
            clock_correction_us: 0,
            echo: None,
        };
        let came = Came {
            at_us: time.at(Tick(tick)) + 6_000,
            bytes: 500,
        };
        edge.receive_patches(&patches(tick, timing, None), came, &time);
    };
    let receive = |edge: &mut Edge, ticks: &[i64]| {
        for &tick in ticks {
            receive_one(edge, tick);
        }
    };
    let next = |edge: &Edge, after: i64| {
        let ticks = after + 1..after + 9;
        ticks
            .filter(|&tick| edge.works_on(Tick(tick)))
            .collect::<Vec<i64>>()
    };
    receive(&mut edge, &[8, 9]);
    assert_eq!(next(&edge, 9).len(), 8, "two sets say little");
    receive(&mut edge, &[10, 12, 16, 20]);
    assert_eq!(next(&edge, 20), [22, 24, 26, 28], "one gap may be a loss");
    receive(&mut edge, &[24, 28]);
    assert_eq!(next(&edge, 28), [32, 36]);
    // A lost set changes nothing, and neither does one in between.
    receive(&mut edge, &[36, 40]);
    assert_eq!(next(&edge, 40), [44, 48]);
    let silent_from_us = time.at(Tick(40)) + 6_000 + SILENT_US + 3 * SECOND_US / 60;
    assert!(edge.is_heard(silent_from_us) && !edge.is_heard(silent_from_us + 1));
    edge.send(&boxes(43, true), &time, time.at(Tick(40)));
    assert_eq!(
        next(&edge, 40),
        [43, 44, 48],
        "all work on detection passes"
    );
    receive(&mut edge, &[41]);
    assert_eq!(next(&edge, 41).len(), 8);
}

#[test]
fn a_later_message_ends_the_wait_for_a_skipped_tick() {
    let mut edge = Edge::new("north", BOUND_MS);
    let time = time();
    let silent = PatchTiming {
        sent_after_us: 5_000,
        clock_correction_us: 0,
        echo: None,
    };
    // All were half a second late: each awaited edge is waited for to the bound.
    for tick in 0..20 {
        let came = Came {
            at_us: time.at(Tick(20)) + 500_000,
            bytes: 500,
        };
        edge.receive_patches(&patches(tick, silent, None), came, &time);
    }
    let now_us = time.at(Tick(51));
    let waits = |edge: &mut Edge, tick| {
        edge.deadline_us(Tick(tick), &time, now_us, WAITS) - time.at(Tick(tick))
    };
    assert_eq!(waits(&mut edge, 51), 400_000);
    let came = Came {
        at_us: time.at(Tick(52)) + 6_000,
        bytes: 500,
    };
    edge.receive_patches(&patches(52, silent, None), came, &time);
    assert!(waits(&mut edge, 51) < 50_000);
    assert_eq!(waits(&mut edge, 53), 400_000);
}

#[test]
fn an_edge_of_another_version_is_reported_and_noise_is_not() {
    let mut edge = Edge::new("north", BOUND_MS);
    let time = time();
    let newer = WireError::Version { got: 99 };
    let silent = PatchTiming {
        sent_after_us: 5_000,
        clock_correction_us: 0,
        echo: None,
    };
    for tick in 0..50 {
        let came = Came {
            at_us: time.at(Tick(tick)) + 6_000,
            bytes: 500,
        };
        edge.cannot_read(&newer);
        edge.receive_patches(&patches(tick, silent, None), came, &time);
    }
    assert_eq!(edge.link(time.at(Tick(50))).refused, None);
    for _ in 0..FOREIGN_IN_A_ROW {
        edge.cannot_read(&newer);
    }
    let link = edge.link(time.at(Tick(50)));
    let refused = link.refused.unwrap();
    assert!(
        refused.contains("version 99") && refused.contains("update"),
        "{refused}"
    );
    assert_eq!(link.unreadable, 50 + u64::from(FOREIGN_IN_A_ROW));
}
