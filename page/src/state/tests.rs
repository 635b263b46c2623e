//! Tests: how messages become frames, statuses and alarms.

use std::sync::Arc;

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::PersonState;
use farfield_proto::message::identity_event::{Change, IdentityEvent, Likeness};
use farfield_proto::message::{PatchSet, PoseSet, Status};
use farfield_proto::tick::Tick;
use farfield_proto::wire;
use proptest::prelude::*;

use super::fixture::{context, feed, synthetic};
use super::known::context::Topic;
use super::known::evidence::Evidence;
use super::known::frame::SharedFrame;
use super::known::{External, Known, News};
use crate::protocol::camera_view::CameraView;
use crate::protocol::chosen_angles::ChosenAngles;
use crate::protocol::status::{Condition, Severity, StatusDocument};
use crate::protocol::tick::TickMessage;

fn status_of(known: &mut Known) -> StatusDocument {
    known.status(&External::default())
}

fn newest(news: Vec<News>) -> SharedFrame {
    let frames = news.into_iter().filter_map(|news| match news {
        News::Frame(frame) => Some(frame),
        _ => None,
    });
    frames.last().unwrap()
}

fn all(_: &str, _: i64) -> bool {
    true
}

#[test]
fn a_tick_contains_people_and_the_viewpoints_that_see_them() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(8));
    let frame = newest(feed(&mut known, &synthetic, [60, 130], all));
    let tick = TickMessage::decode(&frame.encoded).unwrap();
    assert_eq!(
        (tick.tick, tick.persons.len(), tick.joints),
        (Tick(129), 8, 29)
    );
    let poses = (1..=8).map(|person| super::fixture::people::pose(person, Tick(129)));
    for (person, pose) in tick.persons.iter().zip(poses) {
        assert_eq!((person.id, person.state), (pose.person, pose.state));
        for (steps, joint_m) in person.joints.iter().zip(&pose.joints_m) {
            let decoded_m = tick.grid.point_m(*steps);
            let off_m = (0..3)
                .map(|i| (decoded_m[i] - joint_m[i]).abs())
                .fold(0.0, f32::max);
            assert!(off_m <= 0.51 * tick.grid.step_m, "{off_m}");
        }
        let is_seen = pose.state != PersonState::Coasting;
        assert_eq!(person.viewpoints.count_ones() > 0, is_seen, "{person:?}");
    }
}

#[test]
fn a_camera_view_contains_boxes_and_keypoints_of_people() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(8));
    let frame = newest(feed(&mut known, &synthetic, [60, 121], all));
    let context = context();
    let view = CameraView::decode(&frame.camera_view(&context, CameraIndex(0)).unwrap()).unwrap();
    assert_eq!((view.persons.len(), view.keypoints), (8, 17));
    let boxed: Vec<_> = view
        .persons
        .iter()
        .filter_map(|p| Some((p, p.bounding_box?)))
        .collect();
    assert!(!boxed.is_empty());
    for (person, bounding_box) in boxed {
        for [x, y] in person.keypoints_px.iter().flatten() {
            let ([cx, cy], [w, h]) = (bounding_box.center_px, bounding_box.size_px);
            assert!(
                (x - cx).abs() < 0.5 * w && (y - cy).abs() < 0.5 * h,
                "{person:?}"
            );
        }
    }
    assert!(view.persons.iter().any(|person| person.is_chosen));
    assert_eq!(view.sightings.len(), 1, "tick 120 had a detection pass");
    assert_eq!(frame.camera_view(&context, CameraIndex(8)), None);
}

#[test]
fn chosen_angles_are_those_of_the_pose() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(3));
    let frame = newest(feed(&mut known, &synthetic, [60, 70], all));
    let chosen = ChosenAngles::decode(&frame.chosen_angles(&[2, 99], &[22, 19, 500])).unwrap();
    let pose = super::fixture::people::pose(2, Tick(69));
    let expected = vec![pose.angles[22], pose.angles[19], 0.0];
    assert_eq!(chosen.persons, [(PersonId(2), expected)]);
}

#[test]
fn no_alarms_while_all_nodes_send() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(8));
    feed(&mut known, &synthetic, [0, 300], all);
    let status = status_of(&mut known);
    assert_eq!(status.alarms, []);
    assert!(
        status
            .nodes
            .iter()
            .all(|node| node.state == Condition::Works)
    );
    assert!(status.cameras.iter().all(|camera| camera.state == "works"));
    assert_eq!(status.nodes.len(), 5);
    assert!(
        (59.0..=61.0).contains(&status.poses_per_s),
        "{}",
        status.poses_per_s
    );
    let stages: Vec<_> = status.latency.stages.iter().map(|s| s.stage).collect();
    assert_eq!(
        stages,
        ["capture_to_send", "link", "fusion", "capture_to_pose"]
    );
    // Poses are sent 21 ms after their tick and captures taken 0.15 ms before it; every 97th pose
    // is 9 ms late.
    let whole = status.latency.stages.last().unwrap();
    assert_eq!((whole.p50_us, whole.p99_us), (21_150, 30_150));
}

#[test]
fn a_silent_edge_fails_with_a_remedy_and_recovers() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(8));
    // The last edge is silent for six seconds from second 12.
    feed(&mut known, &synthetic, [600, 60 * 16], all);
    let status = status_of(&mut known);
    let failed: Vec<_> = status
        .alarms
        .iter()
        .filter(|a| a.severity == Severity::Failed)
        .collect();
    let keys: Vec<_> = failed.iter().map(|alarm| alarm.key.as_str()).collect();
    // One cause, one alarm.
    assert_eq!(keys, ["node/south-east"]);
    assert_eq!(failed[0].subject, "edge south-east");
    assert!(failed.iter().all(|alarm| !alarm.remedy.is_empty()));
    assert_eq!(status.nodes[4].state, Condition::Failed);
    assert_eq!(status.links[3].state, Condition::Failed);
    assert_eq!(status.links[0].state, Condition::Works);
    feed(&mut known, &synthetic, [60 * 16, 60 * 19], all);
    let keys: Vec<String> = status_of(&mut known)
        .alarms
        .into_iter()
        .map(|a| a.key)
        .collect();
    assert!(
        !keys.iter().any(|key| key.contains("south-east")),
        "{keys:?}"
    );
}

#[test]
fn a_black_camera_fails_and_a_slow_link_is_a_warning() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(8));
    feed(&mut known, &synthetic, [60 * 36, 60 * 40], all);
    let status = status_of(&mut known);
    assert_eq!(status.alarms[0].key, "camera/north-west-left");
    assert_eq!(status.cameras[2].state, "black");
    // Seconds 20 to 28 of 40, at another time.
    feed(&mut known, &synthetic, [60 * 60, 60 * 65], all);
    let status = status_of(&mut known);
    let thin = status
        .alarms
        .iter()
        .find(|alarm| alarm.key == "link/north-west/load")
        .unwrap();
    assert!(
        thin.text.contains("6 people per tick") && thin.text.contains("level 5 instead of 2"),
        "{thin:?}"
    );
    assert_eq!(status.links[1].state, Condition::Warning);
}

fn keys_of(known: &mut Known) -> Vec<String> {
    let alarms = status_of(known).alarms;
    alarms.into_iter().map(|alarm| alarm.key).collect()
}

#[test]
fn silent_edges_are_reported_after_the_start_up_period() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(1));
    let fusion_only = |key: &str, _| !key.contains("/status/") || key.ends_with("/fusion");
    feed(&mut known, &synthetic, [0, 60 * 9], fusion_only);
    assert_eq!(keys_of(&mut known), [""; 0]);
    feed(&mut known, &synthetic, [60 * 9, 60 * 11], fusion_only);
    let keys = keys_of(&mut known);
    assert_eq!(keys.len(), 4, "{keys:?}");
    assert!(keys.iter().all(|key| key.starts_with("node/")), "{keys:?}");
}

#[test]
fn a_link_without_any_status_is_unknown() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(1));
    // The last edge's link is down in seconds 12 to 18, and there was no status before.
    let pass = |key: &str, _| !key.ends_with("/status/south-east");
    feed(&mut known, &synthetic, [60 * 12, 60 * 14], pass);
    let status = status_of(&mut known);
    assert_eq!(status.links[3].state, Condition::Unknown);
    assert_eq!(status.links[0].state, Condition::Works);
}

#[test]
fn missing_poses_are_reported_even_if_an_edge_failed() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(1));
    let pass = |key: &str, tick| {
        !key.ends_with("/pose") && (tick < 120 || !key.contains("/status/north-east"))
    };
    feed(&mut known, &synthetic, [0, 150], pass);
    assert_eq!(keys_of(&mut known), [""; 0]);
    feed(&mut known, &synthetic, [150, 60 * 7], pass);
    let keys = keys_of(&mut known);
    assert!(
        ["poses", "node/north-east"]
            .iter()
            .all(|key| keys.iter().any(|k| k == key)),
        "{keys:?}"
    );
    // Fusion's own silence explains the missing poses.
    for _ in 0..20 {
        known.wait(250_000);
    }
    let keys = keys_of(&mut known);
    assert!(!keys.contains(&"poses".to_owned()), "{keys:?}");
}

#[test]
fn cameras_of_a_failed_edge_raise_no_alarms() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(1));
    // Camera 2, of the second edge, is black in seconds 8 to 13 of 30.
    let pass = |key: &str, tick| tick < 60 * 40 || !key.ends_with("/status/north-west");
    feed(&mut known, &synthetic, [60 * 36, 60 * 40], pass);
    assert_eq!(keys_of(&mut known), ["camera/north-west-left"]);
    feed(&mut known, &synthetic, [60 * 40, 60 * 45], pass);
    let keys = keys_of(&mut known);
    assert!(keys.contains(&"node/north-west".to_owned()), "{keys:?}");
    assert!(
        !keys.iter().any(|key| key.starts_with("camera/")),
        "{keys:?}"
    );
}

#[test]
fn an_edge_with_a_fast_clock_does_not_displace_others() {
    let mut evidence = Evidence::default();
    let synthetic = synthetic(1);
    let passed = synthetic.messages(Tick(90));
    let patches = passed.iter().filter(|(key, ..)| key.contains("/patch/"));
    let sets: Vec<PatchSet> = patches
        .map(|(_, bytes, _)| wire::decode(bytes).unwrap())
        .filter(|set: &PatchSet| !set.persons.is_empty())
        .collect();
    let right = sets.first().unwrap();
    evidence.take_tick(Tick(90));
    for ahead in 0..300 {
        let tick = Tick(500 + ahead);
        evidence.take_patches(
            &PatchSet {
                tick,
                ..right.clone()
            },
            0,
        );
    }
    evidence.take_patches(
        &PatchSet {
            tick: Tick(91),
            ..right.clone()
        },
        0,
    );
    for ahead in 300..310 {
        let tick = Tick(500 + ahead);
        evidence.take_patches(
            &PatchSet {
                tick,
                ..right.clone()
            },
            0,
        );
    }
    assert!(evidence.take_tick(Tick(91)).viewpoints_of(PersonId(1)) > 0);
}

/// Clock alarms if no clock is synchronised and fusion knows offsets to `uncertainty_us`.
fn alarms_of_free_clocks(uncertainty_us: Option<u32>) -> Vec<String> {
    let (mut known, synthetic, context) = (Known::new(context()), synthetic(1), context());
    for (key, bytes, at_us) in (60..240).flat_map(|tick| synthetic.messages(Tick(tick))) {
        let Some(topic) = context.topic(&key) else {
            continue;
        };
        let bytes = match topic {
            Topic::Status(_) => {
                let mut status: Status = wire::decode(&bytes).unwrap();
                let clock = status.health.system_clock.as_mut().unwrap();
                clock.synchronised = false;
                for link in &mut status.health.links {
                    link.clock_uncertainty_us = uncertainty_us;
                }
                wire::encode(&status)
            }
            _ => bytes,
        };
        known.take(topic, &bytes, at_us);
    }
    let keys = keys_of(&mut known);
    keys.into_iter()
        .filter(|it| it.starts_with("clock/"))
        .collect()
}

/// Regression: the demo, whose nodes share one machine, started with five clock warnings.
#[test]
fn free_clocks_are_reported_only_if_the_offset_is_uncertain() {
    assert_eq!(alarms_of_free_clocks(Some(1_900)), Vec::<String>::new());
    for badly in [Some(2_100), None] {
        let keys = alarms_of_free_clocks(badly);
        let nodes = context().venue.viewpoints.len() + 1;
        assert_eq!(keys.len(), nodes, "{keys:?}");
        assert!(keys.contains(&"clock/fusion/free".to_owned()), "{keys:?}");
    }
}

#[test]
fn alarms_keep_their_start_time() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(1));
    // Links get some seconds to start; the one to south-east is down.
    feed(&mut known, &synthetic, [300, 60 * 13], all);
    let since_us = |known: &mut Known| {
        let mut alarms = status_of(known).alarms.into_iter();
        alarms
            .find(|alarm| alarm.key == "link/south-east")
            .map(|alarm| alarm.since_us)
    };
    let first_us = since_us(&mut known);
    assert!(first_us.is_some());
    feed(&mut known, &synthetic, [60 * 13, 60 * 14], all);
    assert_eq!(since_us(&mut known), first_us);
}

#[test]
fn a_silent_fusion_fails_as_time_passes() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(1));
    feed(&mut known, &synthetic, [0, 120], all);
    for _ in 0..16 {
        known.wait(250_000);
    }
    let status = status_of(&mut known);
    let keys: Vec<_> = status
        .alarms
        .iter()
        .map(|alarm| alarm.key.as_str())
        .collect();
    assert!(keys.contains(&"node/fusion"), "{keys:?}");
    assert!(status.poses_per_s.abs() < 1e-9);
}

#[test]
fn maps_are_matched_by_the_id_before_recognition() {
    let mut evidence = Evidence::default();
    let why = Likeness {
        distance_m: 1.0,
        absence_s: 2.0,
        lengths_sigma: 0.5,
        log_ratio: 9.0,
        margin: None,
    };
    let recognised = IdentityEvent {
        person: PersonId(7),
        wire_id: PersonId(7),
        change: Change::Recognise {
            old: PersonId(3),
            why,
        },
    };
    evidence.take_event(&recognised);
    let synthetic = synthetic(8);
    let passed = synthetic.messages(Tick(90));
    let patches = passed.iter().filter(|(key, ..)| key.contains("/patch/"));
    for set in patches.map(|(_, bytes, _)| wire::decode::<PatchSet>(bytes).unwrap()) {
        evidence.take_patches(&set, 0);
    }
    let found = evidence.take_tick(Tick(90));
    assert_eq!(found.viewpoints_of(PersonId(7)), 0);
    assert!(found.viewpoints_of(PersonId(3)) > 0);
}

#[test]
fn a_new_session_discards_the_old_people() {
    let (mut known, synthetic) = (Known::new(context()), synthetic(2));
    feed(&mut known, &synthetic, [0, 30], all);
    let (_, bytes, at_us) = synthetic
        .messages(Tick(31))
        .into_iter()
        .find(|(key, ..)| key.ends_with("/pose"))
        .unwrap();
    let mut poses: PoseSet = wire::decode(&bytes).unwrap();
    poses.session.0 += 1;
    poses.tick = Tick(3);
    let News::Frame(frame) = known.take(Topic::Poses, &wire::encode(&poses), at_us) else {
        panic!("no people");
    };
    assert_eq!(
        (frame.session, frame.tick),
        (poses.session.0 as u32, Tick(3))
    );
}

#[test]
fn unreadable_messages_are_counted() {
    let mut known = Known::new(context());
    known.take(Topic::Poses, b"no message", 1);
    known.take(Topic::Status(None), &[], 2);
    assert_eq!(status_of(&mut known).page.unreadable, 2);
}

fn any_topic() -> impl Strategy<Value = Topic> {
    let context = context();
    let topics: Vec<Topic> = [
        "pose",
        "event",
        "status/fusion",
        "patch/north-east",
        "sighting/north-east",
        "box/north-east",
        "status/north-east",
    ]
    .iter()
    .map(|key| context.topic(&format!("synthetic/{key}")).unwrap())
    .collect();
    prop::sample::select(topics)
}

proptest! {
    #[test]
    fn arbitrary_messages_do_not_panic(
        messages in prop::collection::vec((any_topic(), prop::collection::vec(any::<u8>(), 0..120), any::<i64>()), 0..20),
    ) {
        let mut known = Known::new(context());
        for (topic, mut bytes, at_us) in messages {
            if let Some(version) = bytes.first_mut() {
                *version = wire::VERSION;
            }
            known.take(topic, &bytes, at_us);
            known.wait(250_000);
            known.status(&External::default());
        }
    }

    #[test]
    fn valid_messages_with_flipped_bits_do_not_panic(
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>(), any::<u8>(), any::<i64>()), 1..30),
    ) {
        let synthetic = synthetic(2);
        let context = context();
        let mut known = Known::new(Arc::clone(&context));
        let passed = synthetic.messages(Tick(60));
        for (which, place, flip, at_us) in flips {
            let (key, bytes, _) = which.get(&passed);
            let mut bytes = bytes.clone();
            *place.get_mut(bytes.as_mut_slice()) ^= flip;
            let topic = context.topic(key).unwrap();
            if let News::Frame(frame) = known.take(topic, &bytes, at_us) {
                frame.camera_view(&context, CameraIndex(0));
                frame.json(true);
            }
            known.status(&External::default());
        }
    }
}
