//! Fixed bytes, and refused messages.

use super::fixture::{box_set, live_status, patch_set, pose_set, sighting_set, stage, status};
use super::*;
use crate::message::live::{
    EdgeLink, LiveStatus, MAX_CLOCK_CORRECTION_US, MAX_EDGES, MAX_NTH_TICK,
};
use crate::message::{
    BoxSet, CameraBox, MAX_CAPTURE_OFFSET_US, MAX_PERSONS, MAX_STAGES, PatchSet, PoseSet, Status,
};
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
        "a clock correction past any clock",
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
