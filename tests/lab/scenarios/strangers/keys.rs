//! Renewed keys and replaced files: nodes refuse the older ones and report it.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use farfield_lab::live_venue::NodeProcess;

use super::{SecuredHall, TICKS, VIEWPOINTS};
use crate::farfield::{command, farfield};

/// Far above what a loaded machine takes: a test that waits as long has failed.
const PATIENCE: Duration = Duration::from_mins(1);
/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(20);

/// Waits until `node` has printed `words`; whether it has.
pub(super) fn has_printed(node: &NodeProcess, words: &str) -> bool {
    (0..PATIENCE.as_millis() / PAUSE.as_millis()).any(|_| {
        let has_printed = node.output().contains(words);
        if !has_printed {
            std::thread::sleep(PAUSE);
        }
        has_printed
    })
}

/// Waits until `node` has printed `words`, or fails the test.
pub(super) fn wait_for(node: &NodeProcess, words: &str) {
    let name = node.name();
    assert!(
        has_printed(node, words),
        "{name} did not print: {words}\n{}",
        node.output()
    );
}

/// Starts fusion in lock-step.
pub(super) fn fusion(hall: &SecuredHall, out: &str) -> NodeProcess {
    let mut command = command();
    command.arg("fusion").arg(hall.path("venue.toml"));
    command.args(["--listen", &hall.endpoint, "--ticks", TICKS, "--out"]);
    command.arg(hall.path(out));
    NodeProcess::start("fusion", command).unwrap()
}

/// The command of an edge.
pub(super) fn edge(hall: &SecuredHall, venue: &Path, viewpoint: &str) -> Command {
    let mut command = command();
    command.arg("edge").arg(venue);
    command.args(["--viewpoint", viewpoint, "--connect", &hall.endpoint]);
    command
}

/// Copies north-east's files of the folder `certs` of `hall`.
fn copy_keys(hall: &SecuredHall, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for file in [
        "ca.pem",
        "generations.toml",
        "north-east.pem",
        "north-east.key",
    ] {
        std::fs::copy(hall.path("certs").join(file), to.join(file)).unwrap();
    }
}

/// Waits for the end of a node; its exit code.
fn wait_for_end(node: &mut NodeProcess) -> Option<i32> {
    let status = node.wait(PATIENCE).unwrap();
    status
        .unwrap_or_else(|| panic!("{} does not end\n{}", node.name(), node.output()))
        .code()
}

#[test]
fn a_renewed_nodes_old_key_is_refused_and_both_sides_report_it() {
    // Symptom to prevent: a stolen key stayed valid as long as its certificate, up to 825 days.
    let hall = SecuredHall::new();
    let stolen = hall.path("stolen");
    copy_keys(&hall, &stolen);
    let words = [
        "certs".into(),
        hall.path("venue.toml"),
        "--out".into(),
        hall.path("certs"),
    ];
    let renewed = farfield(&[&words[..], &["--renew".into(), "north-east".into()]].concat());
    assert_eq!(renewed.code, 0, "{}", renewed.stderr);
    assert!(
        renewed.stderr.contains("generation 2"),
        "{}",
        renewed.stderr
    );

    let mut fusion = fusion(&hall, "out");
    wait_for(&fusion, "listens on");
    let venue = hall.path("venue.toml");
    let mut old = edge(&hall, &venue, "north-east");
    old.arg("--certificates").arg(&stolen);
    let mut old = NodeProcess::start("the old one", old).unwrap();
    wait_for(
        &fusion,
        "the node of certificate walk/north-east/1: north-east has newer keys",
    );
    wait_for(&old, "rejects this node's certificate");

    // The other nodes and the node with the new key are not disturbed.
    let mut honest: Vec<NodeProcess> = VIEWPOINTS
        .iter()
        .map(|name| NodeProcess::start(name, edge(&hall, &venue, name)).unwrap())
        .collect();
    for node in &mut honest {
        assert_eq!(wait_for_end(node), Some(0), "{}", node.output());
    }
    assert_eq!(wait_for_end(&mut fusion), Some(0), "{}", fusion.output());
    assert_eq!(old.wait(PAUSE).unwrap(), None, "{}", old.output());

    // With a new file of generations and an old key, the node itself reports the mistake.
    let newest = hall.path("certs/generations.toml");
    std::fs::copy(newest, stolen.join("generations.toml")).unwrap();
    let mut mixed = edge(&hall, &venue, "north-east");
    mixed.arg("--certificates").arg(&stolen);
    let mut mixed = NodeProcess::start("mixed", mixed).unwrap();
    assert_eq!(wait_for_end(&mut mixed), Some(2), "{}", mixed.output());
    assert!(
        mixed.output().contains("2 is the newest of north-east"),
        "{}",
        mixed.output()
    );
}

#[test]
fn every_node_refuses_keys_of_others_instead_of_waiting() {
    // Symptom to prevent: with another node's key or junk, edges and recorders waited for ever without a message.
    let hall = SecuredHall::new();
    let venue = hall.path("venue.toml");
    let certs = |file: &str| hall.path("certs").join(file);
    std::fs::copy(certs("south-west.key"), certs("fusion.key")).unwrap();
    std::fs::write(certs("north-east.key"), "junk").unwrap();
    std::fs::copy(certs("north-east.pem"), certs("recorder.pem")).unwrap();
    let mut record = command();
    record
        .arg("record")
        .arg(&venue)
        .args(["--connect", &hall.endpoint, "--out"])
        .arg(hall.path("run.mcap"));
    let nodes = [
        (
            fusion(&hall, "out"),
            "fusion.key: found the private key of another certificate",
        ),
        (
            NodeProcess::start("edge", edge(&hall, &venue, "north-east")).unwrap(),
            "north-east.key: found no private key in PEM",
        ),
        (
            NodeProcess::start("recorder", record).unwrap(),
            "recorder.pem: found the certificate of `walk/north-east/1`, expected that of recorder",
        ),
    ];
    for (mut node, words) in nodes {
        assert_eq!(wait_for_end(&mut node), Some(2), "{}", node.output());
        let output = node.output();
        assert!(output.contains(words), "{words}: {output}");
    }
}

#[test]
fn older_files_of_fusion_are_refused_without_the_option() {
    let hall = SecuredHall::new();
    let far = tempfile::tempdir().unwrap();
    copy_keys(&hall, &far.path().join("certs"));
    let frames = "north-east.jsonl";
    std::fs::copy(hall.path(frames), far.path().join(frames)).unwrap();
    let at = far.path().join("venue.toml");
    let first = std::fs::read_to_string(hall.path("venue.toml")).unwrap();
    let second = format!("{first}\n# moved\n");
    let history = far.path().join("venue.toml.handouts");
    // Fetches `text` from the n-th fusion. Afterwards the edge has accepted `sets` sets of files: one more or as many as before.
    let fetch = |n: usize, text: &str, more: &[&str], sets: usize| {
        std::fs::write(hall.path("venue.toml"), text).unwrap();
        let fusion = fusion(&hall, &format!("out-{n}"));
        wait_for(&fusion, "listens on");
        let mut edge = edge(&hall, &at, "north-east");
        edge.args(["--from-fusion", "--venue-name", "walk"])
            .args(more);
        let mut edge = NodeProcess::start("edge", edge).unwrap();
        let taken = || std::fs::read_to_string(&history).map_or(0, |text| text.lines().count());
        if sets == taken() {
            assert_eq!(wait_for_end(&mut edge), Some(1), "{}", edge.output());
        } else {
            wait_for(&edge, "the venue file is fusion's now");
            let polls = PATIENCE.as_millis() / PAUSE.as_millis();
            let is_noted = (0..polls).any(|_| {
                std::thread::sleep(PAUSE);
                taken() == sets
            });
            assert!(is_noted, "{}", edge.output());
        }
        let output = edge.output();
        drop((edge, fusion));
        output
    };
    fetch(1, &first, &[], 1);
    fetch(2, &second, &[], 2);
    let output = fetch(3, &first, &[], 2);
    assert!(output.contains("--accept-older"), "{output}");
    assert_eq!(std::fs::read_to_string(&at).unwrap(), second);
    fetch(4, &first, &["--accept-older"], 3);
    assert_eq!(std::fs::read_to_string(&at).unwrap(), first);
}
