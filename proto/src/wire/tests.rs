//! Bytes that must not change, and what is refused.

use super::*;
use crate::bounding_box::{BoundingBox, BoxRate};
use crate::grid::CellGrid;
use crate::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use crate::message::identity_event::tests::every_event;
use crate::message::live::{
    BoxEcho, CameraHealth, CameraStatus, EdgeLink, HeardPatches, LiveBoxes, LiveStatus,
    MAX_CLOCK_CORRECTION_US, MAX_EDGES, PatchTiming,
};
use crate::message::{
    BoxSet, CameraBox, KeypointPeak, MAX_CAPTURE_OFFSET_US, MAX_PERSONS, MAX_STAGES, Order,
    PatchSet, PersonBoxes, PersonPatch, PersonPose, PersonState, PoseSet, Sighting, SightingSet,
    StageTime, Status,
};
use crate::patch::EncodedMaps;
use crate::tick::Tick;

fn patch_set() -> PatchSet {
    let crop = CellGrid {
        origin_px: [10.0, 20.5],
        step_px: [4.0, 0.25],
        width: 48,
        height: 64,
    };
    let patch = PersonPatch {
        person: PersonId(7),
        camera: CameraIndex(3),
        box_tick: Tick(299),
        capture_offset_us: -120,
        crops: vec![crop],
        crop_of_keypoint: vec![0, 0],
        maps: EncodedMaps {
            width: 48,
            height: 64,
            keypoints: 2,
            bytes: vec![1, 2, 3],
        },
    };
    PatchSet {
        session: SessionId(0x0102_0304),
        tick: Tick(300),
        viewpoint: ViewpointIndex(1),
        part: 0,
        parts: 1,
        sighting_parts: 2,
        timing: Some(PatchTiming {
            sent_after_us: 9_000,
            clock_correction_us: -20_000,
            echo: Some(BoxEcho {
                sequence: 299,
                held_us: 4_000,
            }),
        }),
        persons: vec![patch],
    }
}

fn box_set() -> BoxSet {
    let camera = CameraBox {
        camera: CameraIndex(3),
        bounding_box: BoundingBox {
            center_px: [100.0, 200.0],
            size_px: [50.0, 90.0],
            rotation_rad: 0.5,
        },
        rate: BoxRate {
            center_px: [1.0, -1.0],
            size_px: [0.0, 0.5],
            rotation_rad: 0.0,
        },
        torso_px: [100.0, 210.0],
        neck_px: [101.0, 170.0],
    };
    BoxSet {
        session: SessionId(9),
        tick: Tick(-5),
        viewpoint: ViewpointIndex(0),
        order: Order::Track,
        live: Some(LiveBoxes {
            sequence: 300,
            epoch_us: 1_700_000_000_000_000,
            clock_correction_us: Some(-20_000),
            heard: Some(HeardPatches {
                tick: Tick(-17),
                one_way_us: 40_100,
                bytes: 120_000,
            }),
        }),
        detection_cameras: vec![CameraIndex(0), CameraIndex(3)],
        persons: vec![PersonBoxes {
            person: PersonId(1),
            cameras: vec![camera],
        }],
    }
}

fn sighting_set() -> SightingSet {
    let peak = KeypointPeak {
        position_px: [1.5, -2.0],
        score: 0.75,
    };
    let sighting = Sighting {
        camera: CameraIndex(0),
        score: 1.0,
        keypoints: vec![Some(peak), None],
    };
    SightingSet {
        session: SessionId(9),
        tick: Tick(64),
        viewpoint: ViewpointIndex(2),
        part: 1,
        parts: 2,
        sightings: vec![sighting],
    }
}

fn pose_set() -> PoseSet {
    let pose = PersonPose {
        person: PersonId(2),
        state: PersonState::Coasting,
        joints_m: vec![[0.0, 0.5, 1.0]],
        keypoints_m: vec![[1.0, -0.5, 2.0]],
        sigma_m: vec![0.015_625],
        angles: vec![0.25],
        unobserved: 1 << 39,
        views: 4,
    };
    PoseSet {
        session: SessionId(9),
        tick: Tick(64),
        persons: vec![pose],
    }
}

pub(super) fn stage(count: u64) -> StageTime {
    StageTime {
        stage: "crop".to_owned(),
        count,
        total_us: 70,
        p50_us: 40,
        p99_us: 300,
        p999_us: 600,
        max_us: 1000,
    }
}

fn live_status() -> LiveStatus {
    let camera = CameraStatus {
        camera: CameraIndex(4),
        health: CameraHealth::Frozen,
        frames_per_s: 59.5,
        capture_offset_us: -3_000,
    };
    let edge = EdgeLink {
        viewpoint: "north".to_owned(),
        live: false,
        refused: Some("clock".to_owned()),
        round_trip_us: Some(80_000),
        clock_offset_us: Some(-20_000),
        horizon_ticks: 6.5,
        bytes_per_s: 100_000,
        late: 3,
        missing: 4,
        unreadable: 5,
    };
    LiveStatus {
        epoch_us: Some(1_700_000_000_000_000),
        clock_correction_us: 20_000,
        quality: 3,
        persons_per_tick: Some(6),
        every_nth_tick: 2,
        bytes_per_s: 110_000,
        held_back: 7,
        missed_ticks: 8,
        cameras: vec![camera],
        edges: vec![edge],
        recording_failure: None,
    }
}

fn status() -> Status {
    Status {
        node: "north".to_owned(),
        process: 129,
        viewpoint: Some(ViewpointIndex(2)),
        ready: true,
        venue_hash: "ab".to_owned(),
        calibration_hash: "cd".to_owned(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: Some([Tick(300), Tick(400)]),
        tick: None,
        unreadable: 300,
        failure: Some("lost".to_owned()),
        stages: vec![stage(3)],
        live: Some(live_status()),
    }
}

/// One message of each kind, in hexadecimal; the last one has every identity event.
const GOLDEN: [&str; 6] = [
    "0384868808d8040100010201d08c01bfb80201ab02a01f01070302ef010050a401801080010330400203010203",
    "030909000001ac028080f9c0c1c4820301bfb8020121c8f204c0a9070200030101010003a006c00c9003d005005008ef018004201f001000",
    "0309800102010201000000803f02010000c03f000000c00000403f00",
    "0309800101020201000000000000003f0000803f010000803f000000bf00000040010000803c010000803e80808080801004",
    "03056e6f7274688101010201026162026364000001d804a00600ac0201046c6f7374010463726f70034628ac02d804e80701018080f9c0c1c48203c0b80203010602b0db06070801040100006e42ef2e01056e6f727468000105636c6f636b0180f10401bfb8020000d040a08d0603040500",
    "0380808080808080808001d80412070900ac020709010709020000003f0709030000003f070904ac020000003f0000803f0000c03f000000c0010000803e0709050000003f0709060000003f0709070000003f0000803f0000c03f000000c0010000803e070908ac020000003f0000803f07090900ac029601070909010000003f0000803f070909020000003f070909030000003f070909040000003f070909050000003f0000803f0000c03f07090906ac020000003f0709090707090908",
];

fn hex(bytes: &[u8]) -> String {
    bytes
        .iter()
        .fold(String::new(), |text, b| text + &format!("{b:02x}"))
}

#[test]
fn the_bytes_of_every_message_stay_as_they_are() {
    let bytes = [
        encode(&patch_set()),
        encode(&box_set()),
        encode(&sighting_set()),
        encode(&pose_set()),
        encode(&status()),
        encode(&every_event()),
    ];
    let found = bytes.each_ref().map(|b| hex(b));
    assert_eq!(found, GOLDEN, "a change of these bytes needs a new VERSION");
}

#[test]
fn other_versions_and_other_lengths_are_refused() {
    let bytes = encode(&status());
    assert_eq!(decode::<Status>(&[]), Err(WireError::Empty));
    let mut newer = bytes.clone();
    newer[0] = VERSION + 1;
    assert_eq!(
        decode::<Status>(&newer),
        Err(WireError::Version { got: VERSION + 1 })
    );
    let longer = [bytes.as_slice(), &[0, 0]].concat();
    assert_eq!(
        decode::<Status>(&longer),
        Err(WireError::LeftOver { left: 2 })
    );
    let cut = &bytes[..bytes.len() - 1];
    assert!(matches!(
        decode::<Status>(cut),
        Err(WireError::Unreadable { .. })
    ));
    let huge = vec![VERSION; MAX_MESSAGE_BYTES + 1];
    assert_eq!(
        decode::<Status>(&huge),
        Err(WireError::TooLong {
            got: MAX_MESSAGE_BYTES + 1
        })
    );
}

fn check_refused<M: Message + std::fmt::Debug>(
    mut message: M,
    spoil: impl FnOnce(&mut M),
    reason: &'static str,
) {
    spoil(&mut message);
    assert_eq!(
        decode::<M>(&encode(&message)).unwrap_err(),
        WireError::Invalid(reason)
    );
}

#[test]
fn impossible_patches_are_refused() {
    check_refused(
        patch_set(),
        |m| m.parts = 0,
        "an impossible number of parts",
    );
    check_refused(patch_set(), |m| m.part = 1, "a part past the last one");
    check_refused(
        patch_set(),
        |m| m.persons[0].crops.clear(),
        "an impossible number of crops",
    );
    check_refused(
        patch_set(),
        |m| m.persons[0].crops[0].step_px = [0.0; 2],
        "an impossible crop",
    );
    check_refused(
        patch_set(),
        |m| m.persons[0].crops[0].width = 47,
        "a crop of another size than its maps",
    );
    check_refused(
        patch_set(),
        |m| m.persons[0].crop_of_keypoint.push(0),
        "not one crop index per keypoint",
    );
    check_refused(
        patch_set(),
        |m| m.persons[0].crop_of_keypoint[1] = 1,
        "a crop index without a crop",
    );
    check_refused(
        patch_set(),
        |m| m.persons[0].maps.keypoints = 65,
        "maps of an impossible size",
    );
    let crowd = |m: &mut PatchSet| m.persons = vec![m.persons[0].clone(); MAX_PERSONS + 1];
    check_refused(patch_set(), crowd, "more persons than a message may have");
}

#[test]
fn impossible_numbers_are_refused() {
    let camera = |m: &mut BoxSet, spoil: fn(&mut CameraBox)| spoil(&mut m.persons[0].cameras[0]);
    check_refused(
        box_set(),
        |m| camera(m, |c| c.bounding_box.size_px[0] = 0.0),
        "an impossible box",
    );
    check_refused(
        box_set(),
        |m| camera(m, |c| c.rate.rotation_rad = f32::NAN),
        "a rate that is not finite",
    );
    check_refused(
        box_set(),
        |m| camera(m, |c| c.neck_px[1] = f32::INFINITY),
        "a torso or neck that is not finite",
    );
    check_refused(
        sighting_set(),
        |m| m.sightings[0].score = f32::NAN,
        "a score outside 0 to 1",
    );
    check_refused(
        pose_set(),
        |m| m.persons[0].joints_m[0][2] = f32::NAN,
        "a number that is not finite",
    );
    check_refused(
        status(),
        |m| m.node = "a/b".to_owned(),
        "a node name that cannot stand in a key",
    );
    check_refused(
        status(),
        |m| m.stages = vec![stage(1); MAX_STAGES + 1],
        "more stages than a node may have",
    );
    check_refused(
        status(),
        |m| m.ticks = Some([Tick(1), Tick(0)]),
        "ticks that end before they begin",
    );
    check_refused(
        status(),
        |m| m.failure = Some("x".repeat(MAX_TEXT_BYTES + 1)),
        "a text that is too long",
    );
    check_refused(
        status(),
        |m| m.network_hash = "x".repeat(MAX_HASH_BYTES + 1),
        "a fingerprint that is too long",
    );
}

#[test]
fn what_is_said_of_a_link_is_checked() {
    let live = |m: &mut Status, spoil: fn(&mut LiveStatus)| m.live.iter_mut().for_each(spoil);
    check_refused(
        status(),
        |m| live(m, |l| l.every_nth_tick = 0),
        "every 0th tick",
    );
    check_refused(
        status(),
        |m| live(m, |l| l.edges[0].horizon_ticks = f32::NAN),
        "a number that is not finite",
    );
    check_refused(
        status(),
        |m| live(m, |l| l.edges[0].viewpoint = "a/*".to_owned()),
        "a node name that cannot stand in a key",
    );
    check_refused(
        status(),
        |m| live(m, |l| l.edges = vec![l.edges[0].clone(); MAX_EDGES + 1]),
        "more edges than a venue may have",
    );
    let past = "a clock correction past any clock";
    let timing = |m: &mut PatchSet| {
        let timing = m.timing.iter_mut();
        timing.for_each(|t| t.clock_correction_us = i32::MIN);
    };
    check_refused(patch_set(), timing, past);
    let correction = |m: &mut BoxSet| {
        let live = m.live.iter_mut();
        live.for_each(|l| l.clock_correction_us = Some(i32::MAX));
    };
    check_refused(box_set(), correction, past);
}

#[test]
fn a_correction_at_the_bound_and_one_that_is_not_known_are_read() {
    for correction in [
        None,
        Some(MAX_CLOCK_CORRECTION_US),
        Some(-MAX_CLOCK_CORRECTION_US),
    ] {
        let mut set = box_set();
        let live = set.live.iter_mut();
        live.for_each(|l| l.clock_correction_us = correction);
        assert_eq!(decode(&encode(&set)), Ok(set));
    }
    check_refused(
        box_set(),
        |m| {
            let live = m.live.iter_mut();
            live.for_each(|l| l.clock_correction_us = Some(MAX_CLOCK_CORRECTION_US + 1));
        },
        "a clock correction past any clock",
    );
}

#[test]
fn a_refusal_of_every_edge_that_a_venue_may_have_is_one_message() {
    let refused = EdgeLink {
        refused: Some(cut_refusal("x".repeat(MAX_TEXT_BYTES))),
        ..live_status().edges.swap_remove(0)
    };
    let live = LiveStatus {
        edges: vec![refused; MAX_EDGES],
        ..live_status()
    };
    let status = Status {
        live: Some(live),
        ..status()
    };
    assert_eq!(decode(&encode(&status)), Ok(status));
}

#[test]
fn a_capture_too_far_from_its_tick_is_refused() {
    for offset in [MAX_CAPTURE_OFFSET_US + 1, i32::MIN] {
        check_refused(
            patch_set(),
            |m| m.persons[0].capture_offset_us = offset,
            "a capture too far from its tick",
        );
    }
    let mut farthest = patch_set();
    farthest.persons[0].capture_offset_us = -MAX_CAPTURE_OFFSET_US;
    assert_eq!(decode(&encode(&farthest)), Ok(farthest));
}

#[test]
fn a_long_text_is_cut_between_characters_and_the_status_stays_readable() {
    // Three bytes each, which does not divide the bound.
    let cut = cut_text("\u{2026}".repeat(MAX_TEXT_BYTES));
    assert_eq!(cut.len(), MAX_TEXT_BYTES - MAX_TEXT_BYTES % 3);
    let status = Status {
        failure: Some(cut),
        ..status()
    };
    assert_eq!(decode(&encode(&status)), Ok(status));
    assert_eq!(cut_text("short".to_owned()), "short");
}

#[test]
fn a_stated_length_beyond_the_bytes_reserves_nothing() {
    // Symptom to prevent: a list that says it has 2^60 elements. Were room made for it, this test
    // would end the process.
    let empty = PoseSet {
        persons: Vec::new(),
        ..pose_set()
    };
    let mut bytes = encode(&empty);
    bytes.pop();
    bytes.extend([0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x0f]);
    assert!(matches!(
        decode::<PoseSet>(&bytes),
        Err(WireError::Unreadable { .. })
    ));
}
