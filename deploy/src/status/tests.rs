//! The view of a venue by the statuses of its nodes.

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

/// All nodes are healthy, with two statuses each.
fn healthy() -> Received {
    let mut received = Received::default();
    let now = clock::now();
    let before = now.checked_sub(Duration::from_secs(1)).unwrap();
    for (tick, at) in [(100, before), (130, now)] {
        for status in statuses(tick) {
            take(&mut received, status, at);
        }
    }
    received
}

fn take(received: &mut Received, status: Status, at: Instant) {
    received.present.insert(status.node.clone());
    received.take(status, at);
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

fn node<'a>(state: &'a VenueState, name: &str) -> &'a NodeState {
    state.nodes.iter().find(|state| state.node == name).unwrap()
}

#[test]
fn a_healthy_venue_is_a_table_without_warnings() {
    let state = VenueState::new(&venue(), &healthy(), NOW_S);
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
fn the_agreement_of_each_camera_is_shown_below_the_table() {
    let mut received = healthy();
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
    take(&mut received, fusion, clock::now());
    let state = VenueState::new(&venue(), &received, NOW_S);
    let text = table::text(&state);
    let below: Vec<&str> = text.lines().skip(4).collect();
    assert_eq!(below.len(), 3, "{text}");
    assert!(below[1].starts_with("camera c-ne  ") && below[1].contains("61 mm, 5 px"));
    assert!(below[2].starts_with("camera c-nw  ") && below[2].contains("+2.5 ticks"));
    let json = serde_json::to_value(&state).unwrap();
    let agreement = &json["nodes"][2]["cameras"][0]["agreement"];
    assert_eq!(agreement["verdict"], "disagrees");
}

#[test]
fn missing_refused_or_silent_nodes_need_attention() {
    let venue = venue();
    let mut received = healthy();
    received.nodes.remove("nw");
    received.present.remove("nw");
    let state = VenueState::new(&venue, &received, NOW_S);
    assert_eq!(
        (node(&state, "nw").mark, node(&state, "ne").mark),
        (Mark::Red, Mark::Ok)
    );
    assert!(state.attention().unwrap().contains("nw (not connected)"));

    let mut received = healthy();
    let [mut fusion, ..] = statuses(160);
    let edges = &mut fusion.live.as_mut().unwrap().edges;
    (edges[0].live, edges[0].refused) = (false, Some("it holds another calibration".to_owned()));
    take(&mut received, fusion, clock::now());
    let state = VenueState::new(&venue, &received, NOW_S);
    let attention = state.attention().unwrap();
    assert!(
        attention.contains("ne (refused: it holds another calibration"),
        "{attention}"
    );
    assert_eq!(node(&state, "ne").mark, Mark::Red);

    let mut received = healthy();
    let long_ago = clock::now().checked_sub(SILENT + SILENT).unwrap();
    received.nodes.get_mut("ne").unwrap().at = long_ago;
    let state = VenueState::new(&venue, &received, NOW_S);
    assert_eq!(node(&state, "ne").state, "silent for 6 s");
}

#[test]
fn a_failed_camera_is_shown_with_the_reason() {
    let mut received = healthy();
    let [_, mut edge, _] = statuses(160);
    edge.live.as_mut().unwrap().cameras = vec![camera(0, CameraHealth::Failed)];
    take(&mut received, edge, clock::now());
    let state = VenueState::new(&venue(), &received, NOW_S);
    let text = table::text(&state);
    assert!(text.contains("0 of 1 work"), "{text}");
    assert!(
        text.contains("camera c-ne has failed") && text.contains("connection refused"),
        "{text}"
    );
    assert_eq!(node(&state, "ne").mark, Mark::Red);
}

#[test]
fn notices_and_keys_that_end_soon_are_warnings_in_one_line() {
    let mut received = healthy();
    let [mut fusion, ..] = statuses(160);
    fusion.health.certificate_ends_s = Some(NOW_S.unsigned_abs() + 9 * DAY_S.unsigned_abs());
    fusion.health.notices = vec!["one\u{1b}[2J\ntwo".to_owned()];
    take(&mut received, fusion, clock::now());
    let state = VenueState::new(&venue(), &received, NOW_S);
    let text = table::text(&state);
    assert_eq!(text.lines().count(), 4, "{text}");
    assert!(
        text.contains("9 days") && text.contains("one\\u001b[2J\\ntwo"),
        "{text}"
    );
    assert_eq!(
        (node(&state, FUSION).mark, state.attention()),
        (Mark::Warning, None)
    );
}

#[test]
fn control_characters_in_a_status_are_escaped() {
    let mut received = healthy();
    let [_, mut edge, _] = statuses(160);
    edge.release = "9\u{1b}[2J\u{9b}1A\n".to_owned();
    edge.failure = Some("out\u{1b}]0;of\u{7}\nmemory".to_owned());
    take(&mut received, edge, clock::now());
    let text = table::text(&VenueState::new(&venue(), &received, NOW_S));
    assert_eq!(text.lines().count(), 4, "{text:?}");
    assert!(
        !text.contains(|c: char| c.is_control() && c != '\n'),
        "{text:?}"
    );
    assert!(text.contains("out\\u001b]0;of\\u0007\\nmemory"), "{text:?}");
}

/// Symptom: while fusion waited for an edge it was shown as live and healthy, and the cameras of all others as failed.
#[test]
fn a_waiting_fusion_is_shown_and_recordings_have_not_failed() {
    let mut received = Received::default();
    let [mut fusion, mut edge, _] = statuses(0);
    *fusion.live.as_mut().unwrap() = LiveStatus::default();
    (fusion.tick, edge.tick) = (None, None);
    let live = edge.live.as_mut().unwrap();
    live.epoch_us = None;
    live.cameras = vec![CameraStatus {
        reason: None,
        ..camera(0, CameraHealth::Silent)
    }];
    take(&mut received, fusion, clock::now());
    take(&mut received, edge, clock::now());
    let state = VenueState::new(&venue(), &received, NOW_S);
    let fusion = node(&state, FUSION);
    assert_eq!(
        (fusion.mark, fusion.state.as_str()),
        (Mark::Warning, "waiting for nw")
    );
    assert_eq!(node(&state, "ne").mark, Mark::Ok);
    assert_eq!(node(&state, "nw").state, "not connected");
    let text = table::text(&state);
    assert!(text.contains("1 wait") && !text.contains("c-ne"), "{text}");
}

/// Symptom: in the first seconds of a run, cameras were red while their decoders started, and fusion was shown as
/// waiting although no node delayed it.
#[test]
fn a_recording_without_images_fails_only_seconds_after_the_first_tick() {
    let at = |tick: Option<i64>| {
        let mut received = healthy();
        let [mut fusion, mut edge, _] = statuses(0);
        fusion.tick = tick.map(Tick);
        edge.live.as_mut().unwrap().cameras = vec![camera(0, CameraHealth::Silent)];
        take(&mut received, fusion, clock::now());
        take(&mut received, edge, clock::now());
        VenueState::new(&venue(), &received, NOW_S)
    };
    for tick in [None, Some(0), Some(60)] {
        let state = at(tick);
        assert_eq!(state.attention(), None, "{tick:?}");
        assert_eq!(node(&state, FUSION).state, "live", "{tick:?}");
    }
    assert_eq!(node(&at(Some(120)), "ne").mark, Mark::Red);
}

#[test]
fn nodes_that_leave_after_the_end_have_not_failed() {
    let mut received = healthy();
    let [mut fusion, ..] = statuses(160);
    fusion.ready = false;
    take(&mut received, fusion, clock::now());
    received.present.clear();
    let long_ago = clock::now().checked_sub(SILENT + SILENT).unwrap();
    for node in received.nodes.values_mut() {
        node.at = long_ago;
    }
    let state = VenueState::new(&venue(), &received, NOW_S);
    assert_eq!(state.attention(), None);
    assert!(
        state
            .nodes
            .iter()
            .all(|node| node.state == "the run has ended")
    );
}

#[test]
fn a_narrow_terminal_shows_the_important_columns_within_its_width() {
    let mut received = healthy();
    let [mut fusion, mut edge, _] = statuses(160);
    fusion.health.notices = vec!["its clock is set by no time server ".repeat(4)];
    // Then no certificate ends.
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
    take(&mut received, fusion, clock::now());
    take(&mut received, edge, clock::now());
    let state = VenueState::new(&venue(), &received, NOW_S);
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
            "by no time server",
            "DISAGREES",
            "hidden columns:",
        ] {
            assert!(words.contains(word), "{columns}: {word}\n{text}");
        }
        // An empty column is removed without a note.
        assert!(!words.contains("key ends"), "{columns}\n{text}");
    }
    let text = table::text_within(&state, 80);
    assert!(text.lines().next().unwrap().contains("ticks/s"), "{text}");
}
