//! Links that duplicate and reorder messages, and links that are cut.

use std::collections::BTreeSet;
use std::fs::File;
use std::ops::Range;
use std::path::Path;
use std::time::Duration;

use farfield_fusion::recording::reader::{AnySet, Recording};
use farfield_lab::live_venue::SeenVenue;
use farfield_lab::relay::{Direction, Impairment};
use farfield_proto::order_statistics::percentile;
use farfield_proto::tick::Tick;

use super::stage::{LiveStage, PEOPLE, RATE_HZ};
use crate::farfield::{poses, summary};

#[test]
fn duplicated_and_reordered_messages_change_no_track() {
    let mut stage = LiveStage::open();
    let (before, ids) = (stage.resources(), stage.ids());
    for relay in &stage.live.relays {
        relay.set_both(Impairment {
            duplicate: 0.3,
            reorder: 0.3,
            reorder_us: 40_000,
            delay_us: 5_000,
            ..Impairment::default()
        });
    }
    stage.run_for(4.0);
    assert_eq!(stage.ids(), ids);
    before.assert_flat(&stage.resources());
    let lines = poses(&stage.finish("first"));
    let at: Vec<(i64, u64)> = lines
        .iter()
        .map(|line| {
            let person = line["person"].as_u64().unwrap();
            (line["tick"].as_i64().unwrap(), person)
        })
        .collect();
    assert!(at.is_sorted_by(|a, b| a < b), "a tick was computed twice");
    let people: BTreeSet<u64> = at.iter().map(|(_, person)| *person).collect();
    assert_eq!(people.len(), ids.len(), "{people:?}");
}

/// Number of patches of one viewpoint at some ticks of a recording.
fn patches_of(recording: &Path, viewpoint: u16, ticks: Range<Tick>) -> usize {
    let mut recording = Recording::open(File::open(recording).unwrap()).unwrap();
    let session = recording.sessions()[0].session;
    let sets = ticks.start.0..ticks.end.0;
    sets.flat_map(|tick| recording.sets(session, Tick(tick)).unwrap())
        .filter_map(|set| match set {
            AnySet::Patches(set) if set.viewpoint.0 == viewpoint => Some(set.persons.len()),
            _ => None,
        })
        .sum()
}

#[test]
fn an_edge_tracks_people_over_a_cut_link_and_fills_the_recording() {
    let mut stage = LiveStage::prepare(&[], "");
    let recording = stage.folder.path().join("run.mcap");
    let out = stage.out("first");
    stage.start_with(&out, &["--record", recording.to_str().unwrap()]);
    stage.run_for(2.0);
    let tick = |stage: &LiveStage| stage.seen().newest.as_ref().unwrap().tick;
    let before = tick(&stage);
    stage.live.relays[0].cut(Duration::from_secs(3));
    stage.run_for(3.0);
    let after = tick(&stage);
    stage.run_for(2.0);
    stage.finish("first");
    let n_cut = patches_of(&recording, 0, before..after);
    // Two people; some cameras do not see both at times.
    let n_before = patches_of(&recording, 0, before + -60..before);
    let per_tick = n_cut as f64 / (after - before) as f64;
    let usual_per_tick = n_before as f64 / 60.0;
    println!(
        "{per_tick:.2} patches a tick while the link was cut for 3 s, {usual_per_tick:.2} before"
    );
    assert!(per_tick > 0.8 * usual_per_tick);
}

/// Median delay of the poses from tick `from` on, microseconds.
fn usual_delay_us(stage: &LiveStage, from: Tick) -> u64 {
    let delays_us = stage.seen().delays_us(RATE_HZ, from);
    percentile(&delays_us, 0.5).unwrap()
}

/// Whether a notice of fusion reports that the target latency excludes the viewpoint `name`.
fn is_excluded(seen: &SeenVenue, name: &str) -> bool {
    let notices = seen.statuses.get("fusion").map(|it| &it.health.notices);
    notices.into_iter().flatten().any(|notice| {
        let words = notice.split_once("are left out, from viewpoint ");
        words.is_some_and(|(_, names)| names.contains(name))
    })
}

#[test]
fn a_target_latency_excludes_a_far_edge_and_people_stay_tracked() {
    const ONE_WAY_US: u32 = 180_000;
    const TARGET_MS: u32 = 60;
    let far = Impairment {
        delay_us: ONE_WAY_US,
        ..Impairment::default()
    };
    let mut delays_us = Vec::new();
    for parameters in ["", &format!("[link]\ntarget_latency_ms = {TARGET_MS}\n")] {
        let has_target = !parameters.is_empty();
        let mut stage = LiveStage::prepare(&[], parameters);
        let far_away = stage.live.venue().viewpoints[0].name.clone();
        stage.start();
        stage.live.relays[0].set(Direction::Up, far);
        stage.run_for(2.0);
        let from = stage.seen().newest.as_ref().unwrap().tick;
        if has_target {
            stage.wait("the far edge is reported", |seen| {
                is_excluded(seen, &far_away)
            });
        }
        stage.run_for(4.0);
        delays_us.push(usual_delay_us(&stage, from));
        let followed: Vec<bool> = {
            let seen = stage.seen();
            let later = seen.arrivals.iter().filter(|arrival| arrival.tick >= from);
            later.map(|arrival| arrival.tracked == PEOPLE).collect()
        };
        let all_tracked = followed.iter().filter(|it| **it).count() as f64 / followed.len() as f64;
        let out = stage.finish("first");
        let target_latency = summary(&out)["timing"]["target_latency"].clone();
        println!(
            "{parameters:?}: {} us at the median, all people at {:.1} % of the ticks; {target_latency}",
            delays_us[delays_us.len() - 1],
            100.0 * all_tracked
        );
        assert!(all_tracked > 0.9, "{parameters:?}: {all_tracked}");
        assert_eq!(target_latency.is_null(), !has_target);
        if has_target {
            // Counted from the start, before the link became slow.
            let left_out = target_latency["left_out"][&far_away].as_f64();
            assert!(
                left_out.is_some_and(|share| share > 0.1),
                "{target_latency}"
            );
        }
    }
    println!("median delays without and with a target: {delays_us:?} us");
}
