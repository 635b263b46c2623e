//! Links that double and reorder what they carry, and links that are cut.

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
fn doubled_and_reordered_messages_change_nobody() {
    let mut stage = LiveStage::open();
    let (before, ids) = (stage.takes(), stage.ids());
    for relay in &stage.live.relays {
        relay.set_both(Impairment {
            duplicate: 0.3,
            reorder: 0.3,
            reorder_us: 40_000,
            delay_us: 5_000,
            ..Impairment::default()
        });
    }
    stage.go_on(4.0);
    assert_eq!(stage.ids(), ids);
    before.assert_flat(&stage.takes());
    let lines = poses(&stage.finish("first"));
    let at: Vec<(i64, u64)> = lines
        .iter()
        .map(|line| {
            let person = line["person"].as_u64().unwrap();
            (line["tick"].as_i64().unwrap(), person)
        })
        .collect();
    assert!(at.is_sorted_by(|a, b| a < b), "a tick was worked on twice");
    let people: BTreeSet<u64> = at.iter().map(|(_, person)| *person).collect();
    assert_eq!(people.len(), ids.len(), "{people:?}");
}

/// Patches of persons that each tick from `from` to `to` has of the viewpoint of index `viewpoint`, in `recording`.
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
fn an_edge_goes_on_following_people_while_its_link_is_cut_and_the_recording_gets_their_patches() {
    let mut stage = LiveStage::prepare(&[], "");
    let recording = stage.folder.path().join("run.mcap");
    let out = stage.out("first");
    stage.start_with(&out, &["--record", recording.to_str().unwrap()]);
    stage.go_on(2.0);
    let tick = |stage: &LiveStage| stage.seen().newest.as_ref().unwrap().tick;
    let before = tick(&stage);
    stage.live.relays[0].cut(Duration::from_secs(3));
    stage.go_on(3.0);
    let after = tick(&stage);
    stage.go_on(2.0);
    stage.finish("first");
    let found = patches_of(&recording, 0, before..after);
    // Two people, of whom cameras do not always see both.
    let usual = patches_of(&recording, 0, before + -60..before);
    let per_tick = found as f64 / (after - before) as f64;
    let usual_per_tick = usual as f64 / 60.0;
    println!(
        "{per_tick:.2} patches a tick while the link was cut for 3 s, {usual_per_tick:.2} before"
    );
    assert!(per_tick > 0.8 * usual_per_tick);
}

/// The median delay of the poses from `from` on, microseconds.
fn usual_delay_us(stage: &LiveStage, from: Tick) -> u64 {
    let delays_us = stage.seen().delays_us(RATE_HZ, from);
    percentile(&delays_us, 0.5).unwrap()
}

/// Whether a notice of fusion's says that the viewpoint `name` is left out because of the target.
fn is_told_of(seen: &SeenVenue, name: &str) -> bool {
    let notices = seen.statuses.get("fusion").map(|it| &it.health.notices);
    notices.into_iter().flatten().any(|notice| {
        let words = notice.split_once("are left out, from viewpoint ");
        words.is_some_and(|(_, names)| names.contains(name))
    })
}

#[test]
fn with_a_target_latency_people_are_followed_and_an_edge_that_is_far_away_is_named() {
    const ONE_WAY_US: u32 = 180_000;
    const TARGET_MS: u32 = 60;
    let far = Impairment {
        delay_us: ONE_WAY_US,
        ..Impairment::default()
    };
    let mut waited = Vec::new();
    for parameters in ["", &format!("[link]\ntarget_latency_ms = {TARGET_MS}\n")] {
        let has_target = !parameters.is_empty();
        let mut stage = LiveStage::prepare(&[], parameters);
        let far_away = stage.live.venue().viewpoints[0].name.clone();
        stage.start();
        stage.live.relays[0].set(Direction::Up, far);
        stage.go_on(2.0);
        let from = stage.seen().newest.as_ref().unwrap().tick;
        if has_target {
            stage.wait("the far edge is named", |seen| is_told_of(seen, &far_away));
        }
        stage.go_on(4.0);
        waited.push(usual_delay_us(&stage, from));
        let followed: Vec<bool> = {
            let seen = stage.seen();
            let later = seen.arrivals.iter().filter(|arrival| arrival.tick >= from);
            later.map(|arrival| arrival.tracked == PEOPLE).collect()
        };
        let everybody = followed.iter().filter(|it| **it).count() as f64 / followed.len() as f64;
        let out = stage.finish("first");
        let kept = summary(&out)["timing"]["target_latency"].clone();
        println!(
            "{parameters:?}: {} us at the median, everybody at {:.1} % of the ticks; {kept}",
            waited[waited.len() - 1],
            100.0 * everybody
        );
        assert!(everybody > 0.9, "{parameters:?}: {everybody}");
        assert_eq!(kept.is_null(), !has_target);
        if has_target {
            // From the beginning, when it was not far away yet.
            let left_out = kept["left_out"][&far_away].as_f64();
            assert!(left_out.is_some_and(|share| share > 0.1), "{kept}");
        }
    }
    println!("median delays without and with a target: {waited:?} us");
}
