//! Hostile bytes on every subscribed key of a running system: nodes count them and work on.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::key::Keys;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet, SightingSet, Status};
use farfield_proto::wire::decode;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::stage::{LiveStage, PEOPLE, edge_link};

/// Messages on each key.
const MESSAGES: usize = 150;
/// Longest message of pure noise, bytes.
const NOISE_BYTES: usize = 2000;

/// Whether some node would decode `bytes`. Forged valid messages are left to certificates and access control.
fn can_be_read(bytes: &[u8]) -> bool {
    decode::<PatchSet>(bytes).is_ok()
        || decode::<BoxSet>(bytes).is_ok()
        || decode::<SightingSet>(bytes).is_ok()
        || decode::<PoseSet>(bytes).is_ok()
        || decode::<Status>(bytes).is_ok()
}

/// Invalid bytes: noise, noise with a valid version byte, and real messages that were cut, changed or lengthened.
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
    let before = stage.resources();
    let keys = Keys::new(&stage.live.venue().name);
    let viewpoints: Vec<String> = stage
        .live
        .venue()
        .viewpoints
        .iter()
        .map(|viewpoint| viewpoint.name.clone())
        .collect();
    let observed_bytes: BTreeMap<String, Vec<u8>> = stage.seen().newest_bytes.clone();
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
            let bytes = hostile(&mut rng, observed_bytes.get(key));
            if can_be_read(&bytes) {
                continue;
            }
            stage.watch().put(key, &bytes).unwrap();
        }
    }
    stage.wait("fusion counts what it cannot read", |seen| {
        let total = seen.statuses.get("fusion").map(|status| status.unreadable);
        let edges_count = viewpoints
            .iter()
            .all(|v| edge_link(seen, v).is_some_and(|edge| edge.unreadable > 0));
        total.is_some_and(|n| n > 0) && edges_count
    });
    stage.wait("every edge counts what it cannot read", |seen| {
        let counts = |v: &String| seen.statuses.get(v).is_some_and(|s| s.unreadable > 0);
        viewpoints.iter().all(counts)
    });
    stage.run_for(2.0);
    assert_eq!(stage.ids().len(), PEOPLE);
    before.assert_flat(&stage.resources());
    for node in stage.live.nodes() {
        assert!(!node.output().contains("panicked"), "{}", node.output());
    }
}

/// Growth of the recording while the stage runs for 6 s, bytes per tick.
fn growth(stage: &LiveStage, recording: &Path) -> f64 {
    let measure = || {
        (
            std::fs::metadata(recording).unwrap().len(),
            stage.seen().poses,
        )
    };
    let (bytes, poses) = measure();
    stage.run_for(6.0);
    let (more_bytes, more_poses) = measure();
    (more_bytes - bytes) as f64 / (more_poses - poses) as f64
}

#[test]
fn a_flooding_edge_is_reported_and_harms_neither_recording_nor_others() {
    let mut stage = LiveStage::prepare(&[], "");
    let recording = stage.folder.path().join("run.mcap");
    let out = stage.out("first");
    stage.start_with(&out, &["--record", recording.to_str().unwrap()]);
    stage.run_for(2.0);
    let (before, ids) = (growth(&stage, &recording), stage.ids());
    let viewpoint = stage.live.venue().viewpoints[0].name.clone();
    let (flooded, sent) = stage
        .watch()
        .flood(&viewpoint, || growth(&stage, &recording));
    let output = stage.live.fusion.as_ref().unwrap().output();
    println!(
        "a flood of {} MB: the recording grew by {flooded:.0} bytes a tick, before by {before:.0}",
        sent / 1_000_000
    );
    assert!(flooded < 1.3 * before, "{flooded} and {before}");
    assert!(
        output.contains(&format!(
            "viewpoint {viewpoint} sends more than any edge may"
        )),
        "{output}"
    );
    assert_eq!(stage.ids(), ids);
    stage.wait("its drops are shown", |seen| {
        let fusion = seen.statuses.get("fusion");
        fusion.is_some_and(|status| {
            status.health.links[0].dropped > 0 && status.health.links[1].dropped == 0
        })
    });
}
