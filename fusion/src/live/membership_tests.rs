//! Who is let in, and who is refused by name.

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
fn another_calibration_is_refused_by_name_while_the_others_go_on() {
    let mut members = membership();
    assert!(!members.is_welcome(0), "nobody has spoken");
    let other = Status {
        calibration_hash: "c2".to_owned(),
        ..status("a", 1)
    };
    assert_eq!(members.hear(&other, 0), Said::NewNode(0));
    assert_eq!(members.hear(&status("b", 2), 0), Said::NewNode(1));
    assert!(!members.is_welcome(0) && members.is_welcome(1));
    let why = members.refused(0).unwrap();
    assert!(
        why.contains("calibration") && why.contains("c2") && why.contains("c1"),
        "{why}"
    );
    members.leave("a");
    assert_eq!(members.hear(&status("a", 3), SECOND_US), Said::NewNode(0));
    assert!(members.is_welcome(0), "with the right file it is let in");
}

#[test]
fn of_two_networks_the_first_goes_on_and_keypoint_files_fit_any() {
    let mut members = membership();
    let without = Status {
        network_hash: String::new(),
        ..status("a", 1)
    };
    members.hear(&without, 0);
    members.hear(&status("b", 2), 0);
    assert!(members.is_welcome(0) && members.is_welcome(1));
    let other = Status {
        network_hash: "n2".to_owned(),
        ..status("a", 1)
    };
    members.hear(&other, 1);
    assert!(!members.is_welcome(0) && members.is_welcome(1));
    assert!(members.refused(0).unwrap().contains("n2"));
}

#[test]
fn a_box_that_fell_back_to_tract_and_spoke_first_shuts_nobody_out() {
    let mut members = membership();
    let with = |node: &str, process, backend: &str| Status {
        network_hash: format!("n1+d1+{backend}"),
        ..status(node, process)
    };
    members.hear(&with("a", 1, "tract"), 0);
    members.hear(&with("b", 2, "onnxruntime"), 0);
    assert!(members.is_welcome(0) && members.is_welcome(1));
    let warning = members.other_backend(1).unwrap();
    assert!(
        warning.contains("with onnxruntime, a with tract"),
        "{warning}"
    );
    members.hear(&with("a", 1, "onnxruntime"), 1);
    assert_eq!(members.other_backend(1), None);
    let other = Status {
        network_hash: "n2+d1+tract".to_owned(),
        ..status("a", 1)
    };
    members.hear(&other, 2);
    assert!(!members.is_welcome(0));
}

#[test]
fn the_second_of_a_name_is_refused_and_a_restarted_one_is_not() {
    let mut members = membership();
    members.hear(&status("a", 1), 0);
    assert_eq!(members.hear(&status("a", 2), SECOND_US), Said::Nothing);
    assert_eq!(members.second(0), None, "the first may have gone");
    members.hear(&status("a", 1), SECOND_US * 3 / 2);
    assert_eq!(members.second(0), Some(2));
    assert!(members.is_welcome(0), "the first goes on");
    for i in 2..6 {
        members.hear(&status("a", 1), i * SECOND_US);
    }
    assert_eq!(members.second(0), None, "the second has gone");

    let mut members = membership();
    members.hear(&status("a", 1), 0);
    for i in 1..3 {
        assert_eq!(members.hear(&status("a", 2), i * SECOND_US), Said::Nothing);
    }
    assert_eq!(
        members.hear(&status("a", 2), 3 * SECOND_US),
        Said::NewNode(0)
    );
    assert_eq!(members.second(0), None);
}

#[test]
fn who_has_left_may_be_followed_at_once() {
    let mut members = membership();
    members.hear(&status("a", 1), 0);
    assert_eq!(members.leave("a"), Some(0));
    assert_eq!(members.hear(&status("a", 2), 1), Said::NewNode(0));
    assert_eq!(members.leave("fusion"), None);
    assert_eq!(members.hear(&status("z", 2), 1), Said::Unknown);
}

#[test]
fn a_run_goes_over_all_that_is_recorded() {
    let mut members = membership();
    assert_eq!(
        (members.recorded(), members.missing()),
        (None, vec!["a", "b"])
    );
    members.hear(&status("a", 1), 0);
    let later = Status {
        ticks: Some([Tick(50), Tick(200)]),
        ..status("b", 2)
    };
    members.hear(&later, 0);
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
fn the_time_goes_on_by_an_edge_that_is_welcome_and_still_plays() {
    // Symptom to prevent: by the epoch of an edge that was refused, or had played to its end, the run was
    // over at once.
    let now_us = 5_050;
    let tick_by = |epoch_us: u64| Tick(now_us - epoch_us.cast_signed());
    let mut members = membership();
    let stranger = Status {
        calibration_hash: "c2".to_owned(),
        ..plays("a", 5_020)
    };
    members.hear(&stranger, 0);
    assert_eq!(members.epoch_us(tick_by, None), None, "it is refused");
    for epoch_us in [0, 4_950, 5_051, 1 << 40] {
        members.hear(&plays("b", epoch_us), 0);
        assert_eq!(members.epoch_us(tick_by, None), None, "{epoch_us}");
    }
    members.hear(&plays("b", 5_000), 0);
    assert_eq!(members.epoch_us(tick_by, None), Some(5_000));
    let asked = Tick(0)..Tick(50);
    assert_eq!(members.epoch_us(tick_by, Some(&asked)), None);
    let asked = Tick(0)..Tick(51);
    assert_eq!(members.epoch_us(tick_by, Some(&asked)), Some(5_000));
}

#[test]
fn what_an_edge_says_of_being_refused_does_not_refuse_it() {
    // Symptom to prevent: fusion and edge refused each other for being refused, for ever.
    let mut members = membership();
    let echo = Status {
        failure: Some("refused by fusion: its clock is off".to_owned()),
        ..status("a", 1)
    };
    members.hear(&echo, 0);
    assert!(members.is_welcome(0));
    assert_eq!(members.failure(0), None);
    let gone = Status {
        failure: Some("no camera".to_owned()),
        ..status("a", 1)
    };
    members.hear(&gone, 1);
    assert_eq!(members.failure(0), Some("no camera"));
}
