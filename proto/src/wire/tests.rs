//! Fixed bytes, refused messages, and the laws of the wire: every message is read back, and no
//! bytes cause a panic.

use proptest::prelude::*;

use super::fixture::{
    box_set, live_status, patch_set, pose_set, sighting_set, stage, status, thumbnail,
};
use super::*;
use crate::bounding_box::{BoundingBox, BoxRate};
use crate::grid::CellGrid;
use crate::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use crate::message::agreement::{AgreementOfCamera, CameraAgreement};
use crate::message::decision::Decision;
use crate::message::fill::{FillRequest, Filled};
use crate::message::handout::{Chunk, FileList, HandoutRequest, SignedList};
use crate::message::health::NodeHealth;
use crate::message::identity_event::IdentityEventSet;
use crate::message::live::{
    BoxEcho, EdgeLink, HeardPatches, LiveBoxes, LiveStatus, MAX_CLOCK_CORRECTION_US, MAX_EDGES,
    MAX_NTH_TICK, PatchTiming,
};
use crate::message::naming::NamingSet;
use crate::message::thumbnail::{MAX_THUMBNAIL_BYTES, Thumbnail};
use crate::message::{
    BoxSet, CameraBox, KeypointPeak, MAX_CAPTURE_OFFSET_US, MAX_CROPS, MAX_PERSONS, MAX_STAGES,
    Order, PatchSet, PersonBoxes, PersonPatch, PersonPose, PersonState, PoseSet, Sighting,
    SightingSet, Status,
};
use crate::patch::EncodedMaps;
use crate::plain_text::one_line;
use crate::tick::Tick;

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
        "a crop whose size differs from its maps",
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
        "a node name that cannot be part of a key",
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
fn the_fields_of_a_link_are_checked() {
    let live = |m: &mut Status, spoil: fn(&mut LiveStatus)| m.live.iter_mut().for_each(spoil);
    check_refused(
        status(),
        |m| live(m, |l| l.every_nth_tick = 0),
        "every 0th tick",
    );
    let too_few = "a plan of too few ticks";
    check_refused(
        status(),
        |m| live(m, |l| l.needed_nth_tick = MAX_NTH_TICK + 1),
        too_few,
    );
    let planned = |m: &mut BoxSet| {
        let live = m.live.iter_mut();
        live.for_each(|l| l.every_nth_tick = MAX_NTH_TICK + 1);
    };
    check_refused(box_set(), planned, too_few);
    check_refused(
        status(),
        |m| live(m, |l| l.edges[0].horizon_ticks = f32::NAN),
        "a number that is not finite",
    );
    check_refused(
        status(),
        |m| live(m, |l| l.edges[0].viewpoint = "a/*".to_owned()),
        "a node name that cannot be part of a key",
    );
    check_refused(
        status(),
        |m| live(m, |l| l.edges = vec![l.edges[0].clone(); MAX_EDGES + 1]),
        "more edges than a venue may have",
    );
    let past = "a clock correction out of range";
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
fn clock_corrections_at_the_bound_or_unknown_are_read() {
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
        "a clock correction out of range",
    );
}

#[test]
fn refusals_of_all_edges_fit_one_message() {
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
    // Regression: a list that claims 2^60 elements. An allocation of them would end the process.
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

fn check_round_trip<M: Message + PartialEq + std::fmt::Debug>(message: &M) {
    assert_eq!(decode::<M>(&encode(message)).as_ref(), Ok(message));
}

fn decode_all(bytes: &[u8]) {
    // They only have to return.
    drop((
        decode::<PatchSet>(bytes),
        decode::<BoxSet>(bytes),
        decode::<SightingSet>(bytes),
    ));
    drop((decode::<PoseSet>(bytes), decode::<Status>(bytes)));
    drop((decode::<HandoutRequest>(bytes), decode::<FileList>(bytes)));
    drop((decode::<SignedList>(bytes), decode::<Chunk>(bytes)));
    drop((decode::<FillRequest>(bytes), decode::<Filled>(bytes)));
    drop((decode::<Decision>(bytes), decode::<IdentityEventSet>(bytes)));
    drop((decode::<Thumbnail>(bytes), decode::<NamingSet>(bytes)));
}

fn px() -> impl Strategy<Value = [f32; 2]> {
    prop::array::uniform2(-5000.0f32..5000.0)
}

/// In every second message.
fn timing(seed: u16) -> Option<PatchTiming> {
    seed.is_multiple_of(2).then(|| PatchTiming {
        sent_after_us: i32::from(seed) - 500,
        clock_correction_us: -i32::from(seed),
        echo: seed.is_multiple_of(4).then(|| BoxEcho {
            sequence: u32::from(seed),
            held_us: 7 * u32::from(seed),
        }),
    })
}

/// In every second message.
fn live_boxes(seed: i64) -> Option<LiveBoxes> {
    (seed % 2 == 0).then_some(LiveBoxes {
        sequence: seed as u32,
        epoch_us: seed as u64,
        clock_correction_us: (seed % 3 != 0).then_some((seed % 1_000_000) as i32),
        heard: (seed % 4 == 0).then_some(HeardPatches {
            tick: Tick(seed),
            one_way_us: seed as i32,
            bytes: seed as u32,
        }),
        every_nth_tick: (seed % 65).unsigned_abs() as u16,
    })
}

fn any_patch_set() -> impl Strategy<Value = PatchSet> {
    let patch = (
        (
            any::<u32>(),
            any::<u16>(),
            any::<i64>(),
            -MAX_CAPTURE_OFFSET_US..=MAX_CAPTURE_OFFSET_US,
        ),
        1u8..=64,
        1usize..=MAX_CROPS,
        px(),
        any::<Vec<u8>>(),
    );
    let persons = prop::collection::vec(patch, 0..6);
    (
        any::<(u64, i64, u16)>(),
        1..=MAX_PARTS,
        0..=MAX_PARTS,
        persons,
    )
        .prop_map(|(head, parts, sighting_parts, persons)| {
            let persons = persons.into_iter().map(
                |((person, camera, box_tick, offset), keypoints, n_crops, origin_px, bytes)| {
                    let crop = CellGrid {
                        origin_px,
                        step_px: [3.0, 0.5],
                        width: 72,
                        height: 96,
                    };
                    // Crops as edges cut them, and arbitrary ones.
                    let crop = if camera % 2 == 0 {
                        crop.snapped()
                    } else {
                        crop
                    };
                    PersonPatch {
                        person: PersonId(person),
                        camera: CameraIndex(camera),
                        box_tick: Tick(box_tick),
                        capture_offset_us: offset,
                        crops: vec![crop; n_crops],
                        crop_of_keypoint: (0..keypoints).map(|k| k % n_crops as u8).collect(),
                        maps: EncodedMaps {
                            width: 72,
                            height: 96,
                            keypoints,
                            bytes,
                        },
                    }
                },
            );
            PatchSet {
                session: SessionId(head.0),
                tick: Tick(head.1),
                viewpoint: ViewpointIndex(head.2),
                part: parts - 1,
                parts,
                sighting_parts,
                timing: timing(parts),
                persons: persons.collect(),
            }
        })
}

fn any_box_set() -> impl Strategy<Value = BoxSet> {
    let camera =
        (any::<u16>(), px(), px(), px(), -4.0f32..4.0).prop_map(|(camera, a, b, c, turn)| {
            CameraBox {
                camera: CameraIndex(camera),
                bounding_box: BoundingBox {
                    center_px: a,
                    size_px: b.map(|v| v.abs() + 1.0),
                    rotation_rad: turn,
                },
                rate: BoxRate {
                    center_px: c,
                    size_px: b,
                    rotation_rad: turn,
                },
                torso_px: b,
                neck_px: c,
            }
        });
    let person =
        (any::<u32>(), prop::collection::vec(camera, 0..5)).prop_map(|(person, cameras)| {
            PersonBoxes {
                person: PersonId(person),
                cameras,
            }
        });
    let order = prop::sample::select(vec![Order::Track, Order::End]);
    let look = prop::collection::btree_set(any::<u16>(), 0..5);
    (
        any::<(u64, i64, u16)>(),
        order,
        look,
        prop::collection::vec(person, 0..8),
    )
        .prop_map(|(head, order, look, persons)| BoxSet {
            session: SessionId(head.0),
            tick: Tick(head.1),
            viewpoint: ViewpointIndex(head.2),
            part: 0,
            parts: 1,
            order,
            live: live_boxes(head.1),
            detection_cameras: look.into_iter().map(CameraIndex).collect(),
            persons,
        })
}

fn any_sighting_set() -> impl Strategy<Value = SightingSet> {
    let peak =
        (px(), 0.0f32..=1.0).prop_map(|(position_px, score)| KeypointPeak { position_px, score });
    let sighting = (
        any::<u16>(),
        0.0f32..=1.0,
        prop::collection::vec(prop::option::of(peak), 0..26),
    )
        .prop_map(|(camera, score, keypoints)| Sighting {
            camera: CameraIndex(camera),
            score,
            keypoints,
        });
    (
        any::<(u64, i64, u16)>(),
        1..=MAX_PARTS,
        prop::collection::vec(sighting, 0..8),
    )
        .prop_map(|(head, parts, sightings)| {
            let (session, tick, viewpoint) =
                (SessionId(head.0), Tick(head.1), ViewpointIndex(head.2));
            SightingSet {
                session,
                tick,
                viewpoint,
                part: 0,
                parts,
                sightings,
            }
        })
}

fn any_pose_set() -> impl Strategy<Value = PoseSet> {
    let state = prop::sample::select(vec![
        PersonState::Tentative,
        PersonState::Tracked,
        PersonState::Coasting,
    ]);
    let points = || prop::collection::vec(prop::array::uniform3(-100.0f32..100.0), 0..=29);
    let pose = (
        any::<(u32, u64, u16)>(),
        state,
        points(),
        points(),
        any::<bool>(),
        prop::collection::vec(-4.0f32..4.0, 0..=40),
    )
        .prop_map(
            |((person, unobserved, views), state, joints_m, keypoints_m, sure, angles)| {
                PersonPose {
                    person: PersonId(person),
                    state,
                    sigma_m: joints_m
                        .iter()
                        .filter(|_| sure)
                        .map(|p| p[0].abs())
                        .collect(),
                    joints_m,
                    keypoints_m,
                    angles,
                    unobserved,
                    views,
                }
            },
        );
    (any::<(u64, i64)>(), prop::collection::vec(pose, 0..8)).prop_map(|(head, persons)| PoseSet {
        session: SessionId(head.0),
        tick: Tick(head.1),
        persons,
    })
}

fn any_status() -> impl Strategy<Value = Status> {
    // A reader escapes foreign text.
    let texts = prop::array::uniform5("\\PC{0,40}".prop_map(|text| one_line(&text)));
    (
        "[a-z0-9_.-]{1,64}",
        texts,
        any::<(Option<u16>, bool, Option<i64>, u64, bool)>(),
        any::<u64>(),
    )
        .prop_map(|(node, texts, rest, process)| {
            let (viewpoint, ready, tick, unreadable, failed) = rest;
            let [venue_hash, calibration_hash, network_hash, backend, failure] = texts;
            Status {
                node,
                process,
                viewpoint: viewpoint.map(ViewpointIndex),
                release: String::new(),
                ready,
                venue_hash,
                calibration_hash,
                network_hash,
                backend,
                ticks: tick.map(|t| [Tick(t), Tick(t) + 100]),
                tick: tick.map(Tick),
                unreadable,
                failure: failed.then_some(failure),
                stages: vec![stage(unreadable); usize::from(failed)],
                live: ready.then(|| LiveStatus {
                    every_nth_tick: 1,
                    needed_nth_tick: (process % 65) as u16,
                    held_back: process,
                    ..LiveStatus::default()
                }),
                health: NodeHealth {
                    certificate_ends_s: failed.then_some(process),
                    follows: viewpoint.map(|v| SessionId(v.into())),
                    ..NodeHealth::default()
                },
                agreement: vec![
                    AgreementOfCamera {
                        camera: CameraIndex(3),
                        agreement: CameraAgreement {
                            keypoints: process,
                            late_ticks: tick.map(|t| t as f32),
                            ..CameraAgreement::default()
                        },
                    };
                    usize::from(failed)
                ],
            }
        })
}

proptest! {
    #[test]
    fn patches_are_read_back(message in any_patch_set()) {
        check_round_trip(&message);
    }

    #[test]
    fn boxes_are_read_back(message in any_box_set()) {
        check_round_trip(&message);
    }

    #[test]
    fn sightings_are_read_back(message in any_sighting_set()) {
        check_round_trip(&message);
    }

    #[test]
    fn poses_are_read_back(message in any_pose_set()) {
        check_round_trip(&message);
    }

    #[test]
    fn statuses_are_read_back(message in any_status()) {
        check_round_trip(&message);
    }

    #[test]
    fn thumbnails_are_read_back_for_any_pixels(
        head in any::<(u64, i64, u16, u16)>(),
        pixels in prop::collection::vec(any::<u8>(), 0..2000),
    ) {
        let whole = thumbnail();
        let message = Thumbnail {
            session: SessionId(head.0),
            tick: Tick(head.1),
            viewpoint: ViewpointIndex(head.2),
            camera: CameraIndex(head.3),
            jpeg: [whole.jpeg, pixels].concat(),
        };
        check_round_trip(&message);
    }

    #[test]
    fn a_thumbnail_is_read_only_within_its_bounds(
        [width, height] in [0u16..700, 0u16..700],
        length in 13..2 * MAX_THUMBNAIL_BYTES,
    ) {
        let ([h0, h1], [w0, w1]) = (height.to_be_bytes(), width.to_be_bytes());
        let mut jpeg = vec![0xff, 0xd8, 0xff, 0xc0, 0, 11, 8, h0, h1, w0, w1, 1, 0];
        jpeg.resize(length, 0);
        let read = decode::<Thumbnail>(&encode(&Thumbnail { jpeg, ..thumbnail() }));
        let is_possible = |side: u16| (1..=crate::message::thumbnail::MAX_THUMBNAIL_PX).contains(&side);
        let is_within = is_possible(width) && is_possible(height) && length <= MAX_THUMBNAIL_BYTES;
        prop_assert_eq!(read.is_ok(), is_within);
    }

    #[test]
    fn random_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 1..400)) {
        bytes[0] = VERSION;
        decode_all(&bytes);
    }

    #[test]
    fn damaged_messages_never_panic(
        message in any_patch_set(),
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = encode(&message);
        let len = bytes.len();
        for (at, byte) in changes {
            bytes[at.index(len)] = byte;
        }
        decode_all(&bytes);
    }
}
