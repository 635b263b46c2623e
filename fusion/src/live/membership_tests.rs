//! Which edges are accepted, and which are refused.

use farfield_proto::message::health::NodeHealth;
use farfield_proto::message::live::LiveStatus;

use super::*;

fn membership() -> Membership {
    let member = |name: &str| Member {
        name: name.to_owned(),
        ..Member::default()
    };
    Membership {
        venue_hash: "v1".to_owned(),
        calibration_hash: "c1".to_owned(),
        models: None,
        members: vec![member("a"), member("b")],
    }
}

fn status(node: &str, process: u64) -> Status {
    Status {
        node: node.to_owned(),
        process,
        viewpoint: None,
        release: String::new(),
        ready: true,
        venue_hash: "v1".to_owned(),
        calibration_hash: "c1".to_owned(),
        network_hash: "n1".to_owned(),
        backend: String::new(),
        ticks: Some([Tick(0), Tick(100)]),
        tick: None,
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: None,
        health: NodeHealth::default(),
        agreement: Vec::new(),
    }
}

#[test]
fn an_edge_with_another_calibration_is_refused_alone() {
    let mut members = membership();
    assert!(!members.is_welcome(0), "there is no status yet");
    let other = Status {
        calibration_hash: "c2".to_owned(),
        ..status("a", 1)
    };
    assert_eq!(members.update(&other, 0), StatusChange::NewNode(0));
    assert_eq!(members.update(&status("b", 2), 0), StatusChange::NewNode(1));
    assert!(!members.is_welcome(0) && members.is_welcome(1));
    let why = members.refused(0).unwrap();
    assert!(
        why.contains("calibration") && why.contains("c2") && why.contains("c1"),
        "{why}"
    );
    members.leave("a");
    assert_eq!(
        members.update(&status("a", 3), SECOND_US),
        StatusChange::NewNode(0)
    );
    assert!(members.is_welcome(0), "with the right file it is accepted");
}

#[test]
fn the_second_network_is_refused_and_keypoint_files_never() {
    let mut members = membership();
    let without = Status {
        network_hash: String::new(),
        ..status("a", 1)
    };
    members.update(&without, 0);
    members.update(&status("b", 2), 0);
    assert!(members.is_welcome(0) && members.is_welcome(1));
    let other = Status {
        network_hash: "n2".to_owned(),
        ..status("a", 1)
    };
    members.update(&other, 1);
    assert!(!members.is_welcome(0) && members.is_welcome(1));
    assert!(members.refused(0).unwrap().contains("n2"));
}

#[test]
fn another_backend_warns_and_excludes_no_edge() {
    let mut members = membership();
    let with = |node: &str, process, backend: &str| Status {
        network_hash: format!("n1+d1+{backend}"),
        ..status(node, process)
    };
    members.update(&with("a", 1, "tract"), 0);
    members.update(&with("b", 2, "onnxruntime"), 0);
    assert!(members.is_welcome(0) && members.is_welcome(1));
    let warning = members.other_backend(1).unwrap();
    assert!(
        warning.contains("with onnxruntime, a with tract"),
        "{warning}"
    );
    members.update(&with("a", 1, "onnxruntime"), 1);
    assert_eq!(members.other_backend(1), None);
    let other = Status {
        network_hash: "n2+d1+tract".to_owned(),
        ..status("a", 1)
    };
    members.update(&other, 2);
    assert!(!members.is_welcome(0));
}

#[test]
fn a_second_process_is_refused_and_a_restarted_one_is_not() {
    let mut members = membership();
    members.update(&status("a", 1), 0);
    assert_eq!(
        members.update(&status("a", 2), SECOND_US),
        StatusChange::Nothing
    );
    assert_eq!(members.second(0), None, "the first may have gone");
    members.update(&status("a", 1), SECOND_US * 3 / 2);
    assert_eq!(members.second(0), Some(2));
    assert!(members.is_welcome(0), "the first goes on");
    for i in 2..6 {
        members.update(&status("a", 1), i * SECOND_US);
    }
    assert_eq!(members.second(0), None, "the second has gone");

    let mut members = membership();
    members.update(&status("a", 1), 0);
    for i in 1..3 {
        assert_eq!(
            members.update(&status("a", 2), i * SECOND_US),
            StatusChange::Nothing
        );
    }
    assert_eq!(
        members.update(&status("a", 2), 3 * SECOND_US),
        StatusChange::NewNode(0)
    );
    assert_eq!(members.second(0), None);
}

#[test]
fn a_node_that_left_can_be_replaced_at_once() {
    let mut members = membership();
    members.update(&status("a", 1), 0);
    assert_eq!(members.leave("a"), Some(0));
    assert_eq!(members.update(&status("a", 2), 1), StatusChange::NewNode(0));
    assert_eq!(members.leave("fusion"), None);
    assert_eq!(members.update(&status("z", 2), 1), StatusChange::Unknown);
}

#[test]
fn a_run_covers_all_recorded_ticks() {
    let mut members = membership();
    assert_eq!(
        (members.recorded(), members.missing()),
        (None, vec!["a", "b"])
    );
    members.update(&status("a", 1), 0);
    let later = Status {
        ticks: Some([Tick(50), Tick(200)]),
        ..status("b", 2)
    };
    members.update(&later, 0);
    assert_eq!(members.recorded(), Some(Tick(0)..Tick(200)));
    assert!(members.missing().is_empty());
}

/// A hundred recorded ticks that are played from `epoch_us` on, one per microsecond.
fn plays(node: &str, epoch_us: u64) -> Status {
    Status {
        live: Some(LiveStatus {
            epoch_us: Some(epoch_us),
            ..LiveStatus::default()
        }),
        ..status(node, 1)
    }
}

#[test]
fn the_epoch_comes_from_an_accepted_edge_that_still_plays() {
    // Symptom to prevent: with the epoch of an edge that was refused, or had played to its end, the
    // run ended at once.
    let now_us = 5_050;
    let tick_by = |epoch_us: u64| Tick(now_us - epoch_us.cast_signed());
    let mut members = membership();
    let stranger = Status {
        calibration_hash: "c2".to_owned(),
        ..plays("a", 5_020)
    };
    members.update(&stranger, 0);
    assert_eq!(members.epoch_us(tick_by, None), None, "it is refused");
    for epoch_us in [0, 4_950, 5_051, 1 << 40] {
        members.update(&plays("b", epoch_us), 0);
        assert_eq!(members.epoch_us(tick_by, None), None, "{epoch_us}");
    }
    members.update(&plays("b", 5_000), 0);
    assert_eq!(members.epoch_us(tick_by, None), Some(5_000));
    let requested = Tick(0)..Tick(50);
    assert_eq!(members.epoch_us(tick_by, Some(&requested)), None);
    let requested = Tick(0)..Tick(51);
    assert_eq!(members.epoch_us(tick_by, Some(&requested)), Some(5_000));
}

#[test]
fn a_report_of_being_refused_is_no_failure() {
    // Symptom to prevent: fusion and edge refused each other forever for being refused.
    let mut members = membership();
    let echo = Status {
        failure: Some("refused by fusion: its clock is off".to_owned()),
        ..status("a", 1)
    };
    members.update(&echo, 0);
    assert!(members.is_welcome(0));
    assert_eq!(members.failure(0), None);
    let gone = Status {
        failure: Some("no camera".to_owned()),
        ..status("a", 1)
    };
    members.update(&gone, 1);
    assert_eq!(members.failure(0), Some("no camera"));
}
