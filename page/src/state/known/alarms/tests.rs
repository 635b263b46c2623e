//! Tests: nodes that are still starting and runs that have ended are not failures.

use std::sync::Arc;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::Status;
use farfield_proto::message::live::CameraHealth;
use farfield_proto::tick::{Micros, SECOND_US, Tick};
use farfield_proto::venue::{DeviceSettings, Source};
use farfield_proto::wire;

use crate::protocol::status::{Condition, Severity, StatusDocument};
use crate::state::fixture::{context, synthetic, venue};
use crate::state::known::alarms::Growth;
use crate::state::known::context::{Context, Topic};
use crate::state::known::{External, Known};

/// The synthetic venue with cameras instead of recordings.
fn filmed() -> Arc<Context> {
    let mut filmed = venue::venue();
    for camera in &mut filmed.cameras {
        camera.source = Source::V4l {
            device: "/dev/video0".into(),
            settings: DeviceSettings::default(),
        };
    }
    Arc::new(Context::new(filmed, venue::skeleton()))
}

/// Feeds every status from tick `from` up to `to` (exclusive), after `change`; `change` returns
/// whether to send it.
fn feed(
    known: &mut Known,
    context: &Context,
    [from, to]: [i64; 2],
    change: impl Fn(&mut Status) -> bool,
) {
    let synthetic = synthetic(1);
    for (key, bytes, at_us) in (from..to).flat_map(|tick| synthetic.messages(Tick(tick))) {
        let Some(topic @ Topic::Status(_)) = context.topic(&key) else {
            continue;
        };
        let mut status: Status = wire::decode(&bytes).unwrap();
        if change(&mut status) {
            known.take(topic, &wire::encode(&status), at_us);
        }
    }
}

fn status_of(known: &mut Known) -> StatusDocument {
    known.status(&External::default())
}

fn keys_of(known: &mut Known) -> Vec<String> {
    let alarms = status_of(known).alarms;
    alarms.into_iter().map(|alarm| alarm.key).collect()
}

/// Makes all cameras of this node stop giving images.
fn blind(status: &mut Status) -> bool {
    let cameras = status.live.iter_mut().flat_map(|live| &mut live.cameras);
    cameras.for_each(|camera| camera.health = CameraHealth::Silent);
    true
}

/// Regression: if one edge of a recorded venue was missing at the start, the cameras of all others
/// were reported as failed, and the waiting of fusion was not.
#[test]
fn waiting_for_an_edge_is_reported_without_camera_failures() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    feed(&mut known, &context, [0, 60 * 6], |status| {
        blind(status);
        status.tick = None;
        if let Some(live) = &mut status.live {
            live.epoch_us = None;
            live.edges.clear();
        }
        status.health.links.clear();
        status.node != "south-east"
    });
    let status = status_of(&mut known);
    let alarms: Vec<_> = status
        .alarms
        .iter()
        .map(|alarm| (alarm.severity, alarm.key.as_str(), alarm.text.as_str()))
        .collect();
    assert_eq!(
        alarms,
        [(
            Severity::Warning,
            "node/fusion/waiting",
            "starting: fusion waits for south-east"
        )]
    );
    assert_eq!(status.nodes[0].state, Condition::Warning);
    assert!(status.cameras.iter().all(|it| it.state == "unknown"));
}

/// Regression: the first half minute of a demo was red while it started its own edges.
#[test]
fn missing_nodes_fail_only_after_the_start_up_period() {
    let context = context();
    for waits in [true, false] {
        let mut known = Known::new(Arc::clone(&context));
        let alone = |status: &mut Status| {
            let live = status.live.as_mut().unwrap();
            live.edges.clear();
            live.epoch_us = live.epoch_us.filter(|_| !waits);
            status.health.links.clear();
            status.node == "fusion"
        };
        let about_nodes = |known: &mut Known| -> Vec<_> {
            let alarms = status_of(known).alarms.into_iter();
            let of_nodes = alarms.filter(|alarm| alarm.key.starts_with("node/"));
            of_nodes.map(|alarm| (alarm.severity, alarm.text)).collect()
        };
        feed(&mut known, &context, [0, 60 * 30], alone);
        let alarms = about_nodes(&mut known);
        assert!(!alarms.is_empty());
        for (severity, text) in alarms {
            assert_eq!(severity, Severity::Warning, "{text}");
            assert!(text.starts_with("starting: "), "{text}");
        }
        feed(&mut known, &context, [60 * 61, 60 * 62], alone);
        let alarms = about_nodes(&mut known);
        let failed = alarms.iter().filter(|it| it.0 == Severity::Failed);
        assert_eq!(failed.count(), context.venue.viewpoints.len(), "{alarms:?}");
    }
}

/// Regression: all links were red as soon as ticks began, before any edge could have sent.
#[test]
fn links_get_time_to_start_after_the_first_tick() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    let dumb = |status: &mut Status| {
        let edges = status.live.iter_mut().flat_map(|live| &mut live.edges);
        edges.for_each(|edge| edge.live = false);
        true
    };
    let n_red = |known: &mut Known| {
        let links = status_of(known).links;
        links
            .iter()
            .filter(|it| it.state == Condition::Failed)
            .count()
    };
    feed(&mut known, &context, [0, 60 * 2], dumb);
    assert_eq!(n_red(&mut known), 0);
    assert!(!keys_of(&mut known).iter().any(|it| it.starts_with("link/")));
    feed(&mut known, &context, [60 * 2, 60 * 5], dumb);
    assert_eq!(n_red(&mut known), context.venue.viewpoints.len());
}

#[test]
fn recordings_get_time_to_start_after_the_first_tick() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    let n_camera_alarms = |known: &mut Known| {
        let keys = keys_of(known);
        keys.iter().filter(|key| key.starts_with("camera/")).count()
    };
    feed(&mut known, &context, [0, 60 * 3], blind);
    assert_eq!(n_camera_alarms(&mut known), 0);
    feed(&mut known, &context, [60 * 3, 60 * 5], blind);
    assert_eq!(n_camera_alarms(&mut known), context.venue.cameras.len());
}

#[test]
fn a_silent_live_camera_is_reported_at_once() {
    let context = filmed();
    let mut known = Known::new(Arc::clone(&context));
    feed(&mut known, &context, [0, 1], blind);
    assert!(keys_of(&mut known).contains(&"camera/north-east-left".to_owned()));
}

/// Regression: at the end of every round of the demo, and at Ctrl-C, every node and camera was
/// reported as failed.
#[test]
fn silence_after_the_end_of_a_run_is_no_failure() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    feed(&mut known, &context, [0, 600], |_| true);
    feed(&mut known, &context, [600, 601], |status| {
        status.ready = false;
        status.node == "fusion"
    });
    for _ in 0..40 {
        known.wait(250_000);
    }
    let status = status_of(&mut known);
    let alarms: Vec<_> = status
        .alarms
        .iter()
        .map(|alarm| (alarm.severity, alarm.text.as_str()))
        .collect();
    assert_eq!(alarms, [(Severity::Warning, "the run has ended")]);
    assert!(
        status
            .nodes
            .iter()
            .all(|node| node.state == Condition::Works)
    );
    // Fusion runs again.
    feed(&mut known, &context, [60 * 21, 60 * 21 + 1], |_| true);
    let keys = keys_of(&mut known);
    assert!(!keys.contains(&"run/ended".to_owned()), "{keys:?}");
}

#[test]
fn a_failed_fusion_is_not_reported_as_ended() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    feed(&mut known, &context, [0, 61], |status| {
        status.ready = false;
        status.failure = Some("no disk".to_owned());
        status.node == "fusion"
    });
    let keys = keys_of(&mut known);
    assert!(keys.contains(&"node/fusion".to_owned()), "{keys:?}");
    assert!(!keys.contains(&"run/ended".to_owned()), "{keys:?}");
}

/// Fusion describes camera disagreements; the page must show causes that it does not know.
#[test]
fn notices_keep_their_own_text_and_remedy() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    feed(&mut known, &context, [0, 61], |status| {
        if status.node == "fusion" {
            status.health.notice(
                "camera ne-left stands in a new kind of fog; wipe it; then look again".to_owned(),
            );
            status.health.notice("the disk is slow".to_owned());
        }
        true
    });
    let alarms = status_of(&mut known).alarms;
    let notices: Vec<_> = alarms
        .iter()
        .filter(|alarm| alarm.key.contains("/notice/"))
        .map(|alarm| (alarm.text.as_str(), alarm.remedy.as_str()))
        .collect();
    assert_eq!(
        notices,
        [
            (
                "camera ne-left stands in a new kind of fog",
                "wipe it; then look again"
            ),
            (
                "the disk is slow",
                "see `farfield status` and `farfield doctor`"
            ),
        ]
    );
}

/// Regression: all missing ticks were attributed to message loss, also if the processor was busy.
#[test]
fn missing_ticks_are_attributed_to_the_main_cause() {
    /// Increase per second of the counters of fusion's link and of the edge.
    #[derive(Default)]
    struct Increase {
        late: u64,
        missing: u64,
        missed_ticks: u64,
    }
    let alarm = |increase: Increase| {
        let context = context();
        let mut known = Known::new(Arc::clone(&context));
        let viewpoint = context.node_name(Some(ViewpointIndex(0))).to_owned();
        feed(&mut known, &context, [0, 301], |status| {
            let s = status.tick.map_or(0, |tick| tick.0.unsigned_abs() / 60);
            let is_edge = status.node == viewpoint;
            let Some(live) = &mut status.live else {
                return true;
            };
            if is_edge {
                live.missed_ticks = s * increase.missed_ticks;
            } else if let Some(link) = live.edges.first_mut() {
                (link.late, link.missing) = (s * increase.late, s * increase.missing);
            }
            true
        });
        let key = format!("link/{viewpoint}/missing");
        let alarms = status_of(&mut known).alarms;
        alarms.into_iter().find(|alarm| alarm.key == key)
    };
    let with_missing = |late: u64, missed_ticks: u64| Increase {
        late,
        missing: 10,
        missed_ticks,
    };
    for (increase, why, remedy) in [
        (with_missing(0, 0), "north-east", "the link loses messages"),
        (with_missing(1, 2), "north-east", "the link loses messages"),
        (
            with_missing(0, 9),
            "which it skipped",
            "processor is too busy",
        ),
        (with_missing(8, 1), "in time", "none is lost"),
    ] {
        let alarm = alarm(increase).unwrap();
        assert!(alarm.text.starts_with("10 ticks per second"), "{alarm:?}");
        assert!(
            alarm.text.contains(why) && alarm.remedy.contains(remedy),
            "{alarm:?}"
        );
    }
    assert_eq!(alarm(Increase::default()), None);
}

#[test]
fn a_loss_is_reported_for_a_minute() {
    let mut growth = Growth::default();
    let mut at = |s: Micros, value| growth.has_grown("link/ne/dropped", value, s * SECOND_US);
    assert!(!at(0, 7), "the time of earlier losses is unknown");
    assert!(!at(1, 7));
    assert!(at(2, 8) && at(61, 8));
    assert!(!at(62, 8));
    assert!(!at(63, 0), "the node was restarted");
    assert!(at(64, 1));
}
