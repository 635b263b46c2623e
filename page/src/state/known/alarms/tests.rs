//! What is no failure: nodes that are waited for, and a run that has ended.

use std::sync::Arc;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::Status;
use farfield_proto::message::live::CameraHealth;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{DeviceSettings, Source};
use farfield_proto::wire;

use crate::protocol::status::{Condition, Severity, StatusDocument};
use crate::state::fixture::{context, synthetic, venue};
use crate::state::known::context::{Context, Topic};
use crate::state::known::{Beside, Known};

/// The made-up venue with cameras in the place of its recordings.
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

/// Lets `known` hear every status from tick `from` to `to`, not included, as `change` makes it, where that says that it is
/// said at all.
fn tell(
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
    known.status(&Beside::default())
}

fn keys_of(known: &mut Known) -> Vec<String> {
    let alarms = status_of(known).alarms;
    alarms.into_iter().map(|alarm| alarm.key).collect()
}

/// No camera of this node gives pictures.
fn blind(status: &mut Status) -> bool {
    let cameras = status.live.iter_mut().flat_map(|live| &mut live.cameras);
    cameras.for_each(|camera| camera.health = CameraHealth::Silent);
    true
}

/// Symptom: where one edge of a recorded venue was missing at the start, the cameras of all others were told to have failed,
/// and nothing that fusion waited.
#[test]
fn while_fusion_waits_for_an_edge_that_is_said_and_no_recording_has_failed() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    tell(&mut known, &context, [0, 60 * 6], |status| {
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
    let said: Vec<_> = status
        .alarms
        .iter()
        .map(|alarm| (alarm.severity, alarm.key.as_str(), alarm.text.as_str()))
        .collect();
    assert_eq!(
        said,
        [(
            Severity::Warning,
            "node/fusion/waiting",
            "starting: fusion waits for south-east"
        )]
    );
    assert_eq!(status.nodes[0].state, Condition::Warning);
    assert!(status.cameras.iter().all(|it| it.state == "unknown"));
}

/// Symptom: the first half minute of a demo was red, while the demo started its own edges.
#[test]
fn a_venue_that_is_starting_has_no_failure_and_one_that_should_have_started_has() {
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
        tell(&mut known, &context, [0, 60 * 30], alone);
        let alarms = about_nodes(&mut known);
        assert!(!alarms.is_empty());
        for (severity, text) in alarms {
            assert_eq!(severity, Severity::Warning, "{text}");
            assert!(text.starts_with("starting: "), "{text}");
        }
        tell(&mut known, &context, [60 * 61, 60 * 62], alone);
        let alarms = about_nodes(&mut known);
        let failed = alarms.iter().filter(|it| it.0 == Severity::Failed);
        assert_eq!(failed.count(), context.venue.viewpoints.len(), "{alarms:?}");
    }
}

/// Symptom: as soon as ticks began, and before any edge could have sent something, all links were red.
#[test]
fn links_have_a_moment_to_begin_once_the_ticks_do() {
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
    tell(&mut known, &context, [0, 60 * 2], dumb);
    assert_eq!(n_red(&mut known), 0);
    assert!(!keys_of(&mut known).iter().any(|it| it.starts_with("link/")));
    tell(&mut known, &context, [60 * 2, 60 * 5], dumb);
    assert_eq!(n_red(&mut known), context.venue.viewpoints.len());
}

#[test]
fn recordings_have_a_moment_to_begin_once_the_ticks_do() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    let n_told = |known: &mut Known| {
        let keys = keys_of(known);
        let told = keys.iter().filter(|key| key.starts_with("camera/"));
        told.count()
    };
    tell(&mut known, &context, [0, 60 * 3], blind);
    assert_eq!(n_told(&mut known), 0);
    tell(&mut known, &context, [60 * 3, 60 * 5], blind);
    assert_eq!(n_told(&mut known), context.venue.cameras.len());
}

#[test]
fn a_camera_that_is_no_recording_is_missed_at_once() {
    let context = filmed();
    let mut known = Known::new(Arc::clone(&context));
    tell(&mut known, &context, [0, 1], blind);
    assert!(keys_of(&mut known).contains(&"camera/north-east-left".to_owned()));
}

/// Symptom: at the end of every round of the demo, and at Ctrl-C, every node and camera was told to have failed.
#[test]
fn what_is_silent_since_the_run_has_ended_has_not_failed() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    tell(&mut known, &context, [0, 600], |_| true);
    tell(&mut known, &context, [600, 601], |status| {
        status.ready = false;
        status.node == "fusion"
    });
    for _ in 0..40 {
        known.wait(250_000);
    }
    let status = status_of(&mut known);
    let said: Vec<_> = status
        .alarms
        .iter()
        .map(|alarm| (alarm.severity, alarm.text.as_str()))
        .collect();
    assert_eq!(said, [(Severity::Warning, "the run has ended")]);
    assert!(
        status
            .nodes
            .iter()
            .all(|node| node.state == Condition::Works)
    );
    // Fusion works again.
    tell(&mut known, &context, [60 * 21, 60 * 21 + 1], |_| true);
    let keys = keys_of(&mut known);
    assert!(!keys.contains(&"run/ended".to_owned()), "{keys:?}");
}

#[test]
fn fusion_that_gives_up_has_failed_and_not_ended() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    tell(&mut known, &context, [0, 61], |status| {
        status.ready = false;
        status.failure = Some("no disk".to_owned());
        status.node == "fusion"
    });
    let keys = keys_of(&mut known);
    assert!(keys.contains(&"node/fusion".to_owned()), "{keys:?}");
    assert!(!keys.contains(&"run/ended".to_owned()), "{keys:?}");
}

/// What cameras disagree about is fusion's to say: a cause that the page has never heard of is told like any other.
#[test]
fn a_notice_is_told_in_its_own_words_with_its_own_remedy() {
    let context = context();
    let mut known = Known::new(Arc::clone(&context));
    tell(&mut known, &context, [0, 61], |status| {
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

/// Symptom: wherever ticks of a viewpoint were missing, the link was said to lose messages, also where the processor was busy.
#[test]
fn missing_ticks_are_blamed_on_what_loses_most_of_them() {
    /// What of fusion's link and of the edge grows by so many a second.
    #[derive(Default)]
    struct Grows {
        late: u64,
        missing: u64,
        missed_ticks: u64,
    }
    let alarm = |grows: Grows| {
        let context = context();
        let mut known = Known::new(Arc::clone(&context));
        let viewpoint = context.node_name(Some(ViewpointIndex(0))).to_owned();
        tell(&mut known, &context, [0, 301], |status| {
            let s = status.tick.map_or(0, |tick| tick.0.unsigned_abs() / 60);
            let is_edge = status.node == viewpoint;
            let Some(live) = &mut status.live else {
                return true;
            };
            if is_edge {
                live.missed_ticks = s * grows.missed_ticks;
            } else if let Some(link) = live.edges.first_mut() {
                (link.late, link.missing) = (s * grows.late, s * grows.missing);
            }
            true
        });
        let key = format!("link/{viewpoint}/missing");
        let alarms = status_of(&mut known).alarms;
        alarms.into_iter().find(|alarm| alarm.key == key)
    };
    let with_missing = |late: u64, missed_ticks: u64| Grows {
        late,
        missing: 10,
        missed_ticks,
    };
    for (grows, why, remedy) in [
        (with_missing(0, 0), "north-east", "the link loses messages"),
        (with_missing(1, 2), "north-east", "the link loses messages"),
        (
            with_missing(0, 9),
            "did not work on",
            "processor is too busy",
        ),
        (with_missing(8, 1), "in time", "none is lost"),
    ] {
        let alarm = alarm(grows).unwrap();
        assert!(alarm.text.starts_with("of 10 ticks a second"), "{alarm:?}");
        assert!(
            alarm.text.contains(why) && alarm.remedy.contains(remedy),
            "{alarm:?}"
        );
    }
    assert_eq!(alarm(Grows::default()), None);
}
