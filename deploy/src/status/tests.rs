//! What is shown of a venue, by statuses as its nodes say them.

use std::path::Path;
use std::time::Instant;

use farfield_proto::calibration::Calibration;
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::message::StageTime;
use farfield_proto::message::agreement::{AgreementOfCamera, AgreementVerdict, CameraAgreement};
use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::live::CameraStatus;

use super::super::table;
use super::*;

const NOW_S: i64 = 1_790_000_000;

fn venue() -> Venue {
    let camera = |name: &str| {
        format!(
            "[{name}]\nname = \"{name}\"\nsize = [640, 480]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]\n\
             distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [0.0, 1.0, 5.0]\n"
        )
    };
    let viewpoint = |name: &str| {
        format!(
            "[[viewpoint]]\nname = \"{name}\"\n[[viewpoint.camera]]\nname = \"c-{name}\"\nsource = {{ kind = \"keypoints\", path = \"c.jsonl\" }}\n"
        )
    };
    let calibration = camera("c-ne") + &camera("c-nw");
    let text = "name = \"hall\"\nrate_hz = 30.0\ncalibration = \"c.toml\"\n".to_owned()
        + &viewpoint("ne")
        + &viewpoint("nw");
    let calibration = Calibration::parse(&calibration, Path::new("c.toml")).unwrap();
    Venue::parse(&text, Path::new("venue.toml"), calibration).unwrap()
}

fn status(node: &str, tick: i64, live: LiveStatus) -> Status {
    Status {
        node: node.to_owned(),
        process: 7,
        viewpoint: (node != FUSION).then_some(ViewpointIndex(0)),
        release: "0.1.0".to_owned(),
        ready: true,
        venue_hash: String::new(),
        calibration_hash: String::new(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: None,
        tick: Some(Tick(tick)),
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: Some(LiveStatus {
            epoch_us: Some(0),
            ..live
        }),
        health: NodeHealth::default(),
        agreement: Vec::new(),
    }
}

fn link(viewpoint: &str) -> EdgeLink {
    EdgeLink {
        viewpoint: viewpoint.to_owned(),
        live: true,
        refused: None,
        round_trip_us: Some(1_500),
        clock_offset_us: Some(-2_250),
        horizon_ticks: 2.0,
        bytes_per_s: 41_000,
        late: 0,
        missing: 0,
        unreadable: 0,
    }
}

fn camera(index: u16, health: CameraHealth) -> CameraStatus {
    CameraStatus {
        camera: CameraIndex(index),
        health,
        frames_per_s: 30.0,
        capture_offset_us: 0,
        reason: (health != CameraHealth::Works).then(|| "connection refused".to_owned()),
    }
}

/// All nodes as they should be, each heard twice.
fn well() -> Heard {
    let mut heard = Heard::default();
    let now = clock::now();
    let before = now.checked_sub(Duration::from_secs(1)).unwrap();
    for (tick, at) in [(100, before), (130, now)] {
        for status in statuses(tick) {
            take(&mut heard, status, at);
        }
    }
    heard
}

fn take(heard: &mut Heard, status: Status, at: Instant) {
    heard.present.insert(status.node.clone());
    heard.take(status, at);
}

fn statuses(tick: i64) -> [Status; 3] {
    let mut fusion = status(
        FUSION,
        tick,
        LiveStatus {
            edges: vec![link("ne"), link("nw")],
            ..LiveStatus::default()
        },
    );
    fusion.stages = vec![StageTime {
        stage: CAPTURE_TO_POSE.to_owned(),
        count: 9,
        total_us: 9,
        p50_us: 52_000,
        p99_us: 88_000,
        p999_us: 99_000,
        max_us: 99_000,
    }];
    fusion.health.certificate_ends_s = Some(NOW_S.unsigned_abs() + 400 * DAY_S.unsigned_abs());
    fusion.health.links = vec![
        LinkHealth {
            clock_uncertainty_us: Some(400),
            ..LinkHealth::default()
        };
        2
    ];
    let edge = |node: &str, index: u16| {
        let live = LiveStatus {
            every_nth_tick: 1,
            bytes_per_s: 40_000,
            cameras: vec![camera(index, CameraHealth::Works)],
            ..LiveStatus::default()
        };
        status(node, tick, live)
    };
    [fusion, edge("ne", 0), edge("nw", 1)]
}

fn of<'a>(state: &'a VenueState, node: &str) -> &'a NodeState {
    state.nodes.iter().find(|state| state.node == node).unwrap()
}

#[test]
fn a_venue_that_is_well_is_a_table_without_a_word_too_many() {
    let state = VenueState::new(&venue(), &well(), NOW_S);
    assert_eq!(state.attention(), None);
    let text = table::text(&state);
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 4, "{text}");
    for word in [
        "fusion", "ok", "live", "0.1.0", "30.0", "52 (88)", "82.0", "400 days",
    ] {
        assert!(lines[1].contains(word), "{word}\n{text}");
    }
    for word in [
        "ne ",
        "ok",
        "1.5 rtt",
        "lossless",
        "40.0",
        "-2.2 ±0.4",
        "1 work",
    ] {
        assert!(lines[2].contains(word), "{word}\n{text}");
    }
    let json = serde_json::to_value(&state).unwrap();
    assert_eq!(json["nodes"][1]["clock"]["offset_ms"], -2.25);
    assert_eq!(json["nodes"][1]["mark"], "ok");
}

#[test]
fn how_each_camera_agrees_with_the_others_is_told_under_the_table() {
    let mut heard = well();
    let [mut fusion, ..] = statuses(160);
    let compared = |camera, verdict, late_ticks| AgreementOfCamera {
        camera: CameraIndex(camera),
        agreement: CameraAgreement {
            verdict,
            keypoints: 900,
            distance_mm: Some(61.0),
            distance_px: Some(5.0),
            late_ticks,
        },
    };
    fusion.agreement = vec![
        compared(0, AgreementVerdict::Agrees, None),
        compared(1, AgreementVerdict::Disagrees, Some(2.5)),
    ];
    take(&mut heard, fusion, clock::now());
    let state = VenueState::new(&venue(), &heard, NOW_S);
    let text = table::text(&state);
    let below: Vec<&str> = text.lines().skip(4).collect();
    assert_eq!(
        below,
        [
            "",
            "camera c-ne  agrees with the others: 61 mm, 5 px apart at the median",
            "camera c-nw  DISAGREES with the others: 61 mm, 5 px apart at the median, +2.5 ticks late",
        ]
    );
    let json = serde_json::to_value(&state).unwrap();
    let agreement = &json["nodes"][2]["cameras"][0]["agreement"];
    assert_eq!(agreement["verdict"], "disagrees");
}

#[test]
fn whoever_is_missing_refused_or_silent_is_to_be_looked_after() {
    let venue = venue();
    let mut heard = well();
    heard.nodes.remove("nw");
    heard.present.remove("nw");
    let state = VenueState::new(&venue, &heard, NOW_S);
    assert_eq!(
        (of(&state, "nw").mark, of(&state, "ne").mark),
        (Mark::Red, Mark::Ok)
    );
    assert_eq!(
        state.attention().unwrap(),
        "to be looked after: nw (not there)"
    );

    let mut heard = well();
    let [mut fusion, ..] = statuses(160);
    let edges = &mut fusion.live.as_mut().unwrap().edges;
    (edges[0].live, edges[0].refused) = (false, Some("it holds another calibration".to_owned()));
    take(&mut heard, fusion, clock::now());
    let state = VenueState::new(&venue, &heard, NOW_S);
    let attention = state.attention().unwrap();
    assert!(
        attention.contains("ne (refused: it holds another calibration"),
        "{attention}"
    );
    assert!(
        table::text(&state).contains("RED  refused"),
        "{}",
        table::text(&state)
    );

    let mut heard = well();
    let long_ago = clock::now().checked_sub(SILENT + SILENT).unwrap();
    heard.nodes.get_mut("ne").unwrap().at = long_ago;
    let state = VenueState::new(&venue, &heard, NOW_S);
    assert_eq!(of(&state, "ne").state, "silent for 6 s");
}

#[test]
fn a_camera_that_gives_no_pictures_is_named_with_the_reason() {
    let mut heard = well();
    let [_, mut edge, _] = statuses(160);
    edge.live.as_mut().unwrap().cameras = vec![camera(0, CameraHealth::Failed)];
    take(&mut heard, edge, clock::now());
    let state = VenueState::new(&venue(), &heard, NOW_S);
    let text = table::text(&state);
    assert!(text.contains("0 of 1 work"), "{text}");
    assert!(
        text.contains("camera c-ne has failed") && text.contains("connection refused"),
        "{text}"
    );
    assert_eq!(of(&state, "ne").mark, Mark::Red);
}

#[test]
fn notices_and_keys_that_end_soon_are_warnings_on_one_line() {
    let mut heard = well();
    let [mut fusion, ..] = statuses(160);
    fusion.health.certificate_ends_s = Some(NOW_S.unsigned_abs() + 9 * DAY_S.unsigned_abs());
    fusion.health.notices = vec!["one\u{1b}[2J\ntwo".to_owned()];
    take(&mut heard, fusion, clock::now());
    let state = VenueState::new(&venue(), &heard, NOW_S);
    let text = table::text(&state);
    assert_eq!(text.lines().count(), 4, "{text}");
    assert!(
        text.contains("9 days") && text.contains("one\\u001b[2J\\ntwo"),
        "{text}"
    );
    assert_eq!(
        (of(&state, FUSION).mark, state.attention()),
        (Mark::Warning, None)
    );
}

#[test]
fn what_a_node_says_of_its_release_and_its_failure_commands_no_terminal() {
    let mut heard = well();
    let [_, mut edge, _] = statuses(160);
    edge.release = "9\u{1b}[2J\u{9b}1A\n".to_owned();
    edge.failure = Some("out\u{1b}]0;of\u{7}\nmemory".to_owned());
    take(&mut heard, edge, clock::now());
    let text = table::text(&VenueState::new(&venue(), &heard, NOW_S));
    assert_eq!(text.lines().count(), 4, "{text:?}");
    assert!(
        !text.contains(|c: char| c.is_control() && c != '\n'),
        "{text:?}"
    );
    assert!(text.contains("out\\u001b]0;of\\u0007\\nmemory"), "{text:?}");
}

/// Symptom: while fusion waited for an edge it was shown as live and well, and the cameras of all others as failed.
#[test]
fn while_fusion_waits_for_an_edge_that_is_said_and_no_recording_has_failed() {
    let mut heard = Heard::default();
    let [mut fusion, mut edge, _] = statuses(0);
    *fusion.live.as_mut().unwrap() = LiveStatus::default();
    (fusion.tick, edge.tick) = (None, None);
    let live = edge.live.as_mut().unwrap();
    live.epoch_us = None;
    live.cameras = vec![CameraStatus {
        reason: None,
        ..camera(0, CameraHealth::Silent)
    }];
    take(&mut heard, fusion, clock::now());
    take(&mut heard, edge, clock::now());
    let state = VenueState::new(&venue(), &heard, NOW_S);
    let fusion = of(&state, FUSION);
    assert_eq!(
        (fusion.mark, fusion.state.as_str()),
        (Mark::Warning, "waiting for nw")
    );
    assert_eq!(of(&state, "ne").mark, Mark::Ok);
    assert_eq!(
        state.attention().unwrap(),
        "to be looked after: nw (not there)"
    );
    let text = table::text(&state);
    assert!(
        text.contains("1 wait") && !text.contains("pictures"),
        "{text}"
    );
}

/// Symptom: in the first seconds of a run the cameras were red whose decoders were about to open, and a fusion that nobody had
/// kept waiting was said to wait.
#[test]
fn a_recording_that_gives_no_pictures_has_failed_some_seconds_after_the_first_tick() {
    let at = |tick: Option<i64>| {
        let mut heard = well();
        let [mut fusion, mut edge, _] = statuses(0);
        fusion.tick = tick.map(Tick);
        edge.live.as_mut().unwrap().cameras = vec![camera(0, CameraHealth::Silent)];
        take(&mut heard, fusion, clock::now());
        take(&mut heard, edge, clock::now());
        VenueState::new(&venue(), &heard, NOW_S)
    };
    for tick in [None, Some(0), Some(60)] {
        let state = at(tick);
        assert_eq!(state.attention(), None, "{tick:?}");
        assert_eq!(of(&state, FUSION).state, "live", "{tick:?}");
    }
    assert_eq!(of(&at(Some(120)), "ne").mark, Mark::Red);
}

#[test]
fn who_leaves_when_the_run_has_ended_has_not_failed() {
    let mut heard = well();
    let [mut fusion, ..] = statuses(160);
    fusion.ready = false;
    take(&mut heard, fusion, clock::now());
    heard.present.clear();
    let long_ago = clock::now().checked_sub(SILENT + SILENT).unwrap();
    for node in heard.nodes.values_mut() {
        node.at = long_ago;
    }
    let state = VenueState::new(&venue(), &heard, NOW_S);
    assert_eq!(state.attention(), None);
    assert!(
        state
            .nodes
            .iter()
            .all(|node| node.state == "the run has ended")
    );
}

#[test]
fn a_narrow_terminal_has_what_matters_on_lines_of_its_width() {
    let mut heard = well();
    let [mut fusion, mut edge, _] = statuses(160);
    fusion.health.notices = vec!["its clock is kept right by nothing at all ".repeat(4)];
    // Then nobody's key ends.
    fusion.health.certificate_ends_s = None;
    let missing = AgreementOfCamera {
        camera: CameraIndex(1),
        agreement: CameraAgreement {
            verdict: AgreementVerdict::Disagrees,
            keypoints: 900,
            distance_mm: Some(61.0),
            distance_px: Some(5.0),
            late_ticks: Some(2.5),
        },
    };
    fusion.agreement = vec![missing];
    edge.live.as_mut().unwrap().persons_per_tick = Some(3);
    take(&mut heard, fusion, clock::now());
    take(&mut heard, edge, clock::now());
    let state = VenueState::new(&venue(), &heard, NOW_S);
    let whole = table::text(&state);
    assert!(
        whole.lines().any(|line| line.chars().count() > 120),
        "{whole}"
    );
    assert!(whole.contains("key ends"), "{whole}");
    assert_eq!(table::text_within(&state, 500), whole);
    for columns in [85, 80, 60, 40] {
        let text = table::text_within(&state, columns);
        for line in text.lines() {
            assert!(line.chars().count() <= columns, "{columns}: {line}\n{text}");
        }
        let words: Vec<&str> = text.split_whitespace().collect();
        let words = words.join(" ");
        for word in [
            "fusion",
            "live",
            "by nothing at all",
            "DISAGREES",
            "no room for",
        ] {
            assert!(words.contains(word), "{columns}: {word}\n{text}");
        }
        // A column that says nothing needs no room.
        assert!(!words.contains("key ends"), "{columns}\n{text}");
    }
    let text = table::text_within(&state, 80);
    assert!(text.lines().next().unwrap().contains("ticks/s"), "{text}");
}
