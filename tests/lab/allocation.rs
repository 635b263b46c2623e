//! In steady state a tick of a person allocates nothing. A test binary of its own, because the counter is global.

use std::alloc::System;

use farfield_lab::ring::CameraRing;
use farfield_proto::tick::Tick;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

#[test]
fn a_tick_in_steady_state_allocates_nothing() {
    let ring = CameraRing::new(4).unwrap();
    let method = CameraRing::method();
    let mut track = ring.track(&method).unwrap();
    let groups: Vec<_> = (0..60)
        .map(|tick| ring.group(Tick(tick)).unwrap())
        .collect();
    let mut counts = Vec::with_capacity(groups.len());
    for group in &groups {
        let region = Region::new(ALLOCATOR);
        track.begin(&method);
        for (set, camera) in group.patch_sets.iter().zip(ring.cameras()) {
            assert!(track.see(&set.persons[0], set.viewpoint, camera, &method));
        }
        track.place_views(&[], 0, &method);
        track.search(&method);
        track.fit_keypoints(&method);
        track.smooth(&method);
        track.fit_joints(&method);
        let change = region.change();
        counts.push(change.allocations + change.reallocations);
    }
    println!("allocations in the first ticks: {:?}", &counts[..5]);
    assert!(counts[0] > 0, "the counter does not count");
    assert!(counts[20..].iter().all(|n| *n == 0), "{counts:?}");
    let last = Tick(59);
    let error_m: Vec<f64> = track
        .keypoints_m()
        .iter()
        .zip(ring.truth_m(last))
        .map(|(a, b)| (a - b).norm())
        .collect();
    assert!(
        error_m.iter().sum::<f64>() / (error_m.len() as f64) < 0.05,
        "the track has lost the walker: {error_m:?}"
    );
}
