//! Hostile bytes on every subscribed key of a running system: it goes on, and counts them.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::key::Keys;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet, SightingSet, Status};
use farfield_proto::wire::decode;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::stage::{LiveStage, PEOPLE, heard};

/// Messages of each sort on each key.
const MESSAGES: usize = 150;
/// Longest message that is made of noise alone, bytes.
const NOISE_BYTES: usize = 2000;

/// Whether some node would take `bytes` for a message: then they are a lie, and it is for certificates and
/// access control to keep those out who tell them.
fn can_be_read(bytes: &[u8]) -> bool {
    decode::<PatchSet>(bytes).is_ok()
        || decode::<BoxSet>(bytes).is_ok()
        || decode::<SightingSet>(bytes).is_ok()
        || decode::<PoseSet>(bytes).is_ok()
        || decode::<Status>(bytes).is_ok()
}

/// Bytes that nobody should send: noise, noise with a fitting version, and real messages that were cut,
/// changed or lengthened.
fn hostile(rng: &mut ChaCha8Rng, real: Option<&Vec<u8>>) -> Vec<u8> {
    let mut noise: Vec<u8> = (0..rng.random_range(0..NOISE_BYTES))
        .map(|_| rng.random())
        .collect();
    let Some(real) = real.filter(|real| !real.is_empty()) else {
        return noise;
    };
    let mut changed = real.clone();
    match rng.random_range(0..5u8) {
        0 => return noise,
        1 => {
            if let Some(first) = noise.first_mut() {
                *first = real[0];
            }
            return noise;
        }
        2 => changed.truncate(rng.random_range(0..real.len())),
        3 => changed.extend_from_slice(&noise),
        _ => {
            for _ in 0..rng.random_range(1..8) {
                let at = rng.random_range(0..changed.len());
                changed[at] = rng.random();
            }
        }
    }
    changed
}

#[test]
fn hostile_bytes_on_every_key_are_counted_and_change_nothing() {
    let stage = LiveStage::open();
    let before = stage.takes();
    let keys = Keys::new(&stage.live.venue().name);
    let viewpoints: Vec<String> = stage
        .live
        .venue()
        .viewpoints
        .iter()
        .map(|viewpoint| viewpoint.name.clone())
        .collect();
    let heard_bytes: BTreeMap<String, Vec<u8>> = stage.seen().newest_bytes.clone();
    let mut targets = vec![
        keys.pose(),
        keys.smooth(),
        keys.decision(),
        keys.config(),
        keys.status("fusion"),
        keys.status("a-stranger"),
        keys.patch("a-stranger"),
        keys.sighting("a-stranger"),
    ];
    for viewpoint in &viewpoints {
        targets.extend([
            keys.patch(viewpoint),
            keys.sighting(viewpoint),
            keys.boxes(viewpoint),
            keys.status(viewpoint),
            keys.fill(viewpoint),
        ]);
    }
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for _ in 0..MESSAGES {
        for key in &targets {
            let bytes = hostile(&mut rng, heard_bytes.get(key));
            if can_be_read(&bytes) {
                continue;
            }
            stage.watch().put(key, &bytes).unwrap();
        }
    }
    stage.wait("fusion counts what it cannot read", |seen| {
        let total = seen.statuses.get("fusion").map(|status| status.unreadable);
        let of_edges = viewpoints
            .iter()
            .all(|v| heard(seen, v).is_some_and(|edge| edge.unreadable > 0));
        total.is_some_and(|n| n > 0) && of_edges
    });
    stage.wait("every edge counts what it cannot read", |seen| {
        let of = |v: &String| seen.statuses.get(v).is_some_and(|s| s.unreadable > 0);
        viewpoints.iter().all(of)
    });
    stage.go_on(2.0);
    assert_eq!(stage.ids().len(), PEOPLE);
    before.assert_flat(&stage.takes());
    for node in stage.live.nodes() {
        assert!(!node.output().contains("panicked"), "{}", node.output());
    }
}

/// How fast the recording grows while the stage plays for some seconds, bytes per tick.
fn growth(stage: &LiveStage, recording: &Path) -> f64 {
    let look = || {
        (
            std::fs::metadata(recording).unwrap().len(),
            stage.seen().poses,
        )
    };
    let (bytes, poses) = look();
    stage.go_on(6.0);
    let (more_bytes, more_poses) = look();
    (more_bytes - bytes) as f64 / (more_poses - poses) as f64
}

#[test]
fn an_edge_in_other_hands_that_floods_is_named_and_fills_neither_the_recording_nor_the_others_places()
 {
    let mut stage = LiveStage::prepare(&[], "");
    let recording = stage.folder.path().join("run.mcap");
    let out = stage.out("first");
    stage.start_with(&out, &["--record", recording.to_str().unwrap()]);
    stage.go_on(2.0);
    let (before, ids) = (growth(&stage, &recording), stage.ids());
    let viewpoint = stage.live.venue().viewpoints[0].name.clone();
    let (flooded, sent) = stage
        .watch()
        .flood(&viewpoint, || growth(&stage, &recording));
    let said = stage.live.fusion.as_ref().unwrap().output();
    println!(
        "a flood of {} MB: the recording grew by {flooded:.0} bytes a tick, before by {before:.0}",
        sent / 1_000_000
    );
    assert!(flooded < 1.3 * before, "{flooded} and {before}");
    assert!(
        said.contains(&format!(
            "viewpoint {viewpoint} sends more than any edge may"
        )),
        "{said}"
    );
    assert_eq!(stage.ids(), ids);
    stage.wait("its drops are shown", |seen| {
        let fusion = seen.statuses.get("fusion");
        fusion.is_some_and(|status| {
            status.health.links[0].dropped > 0 && status.health.links[1].dropped == 0
        })
    });
}
