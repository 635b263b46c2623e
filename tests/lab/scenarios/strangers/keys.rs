//! Keys that were made anew, and files that were replaced: what is older is refused, and that is said.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use farfield_lab::live_venue::NodeProcess;

use super::{SecuredHall, TICKS, VIEWPOINTS};
use crate::farfield::{command, farfield};

/// Far above what a loaded machine takes; a test that waits as long has failed.
const PATIENCE: Duration = Duration::from_mins(1);
/// Between two looks.
const PAUSE: Duration = Duration::from_millis(20);

/// Waits until `node` has said `words`; whether it has.
pub(super) fn has_said(node: &NodeProcess, words: &str) -> bool {
    (0..PATIENCE.as_millis() / PAUSE.as_millis()).any(|_| {
        let has_said = node.said().contains(words);
        if !has_said {
            std::thread::sleep(PAUSE);
        }
        has_said
    })
}

/// Waits until `node` has said `words`.
pub(super) fn wait_for(node: &NodeProcess, words: &str) {
    let name = node.name();
    assert!(
        has_said(node, words),
        "{name}: not said: {words}\n{}",
        node.said()
    );
}

/// Starts fusion as an operator would, in lock-step.
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

/// Copies what a node gets of the folder `certs` of `hall`.
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

/// Ends a node that was told to, and its exit code.
fn ended(node: &mut NodeProcess) -> Option<i32> {
    let status = node.wait(PATIENCE).unwrap();
    status
        .unwrap_or_else(|| panic!("{} does not end\n{}", node.name(), node.said()))
        .code()
}

#[test]
fn an_old_key_is_refused_once_its_node_has_a_new_one_and_both_sides_say_so() {
    // Symptom to prevent: a stolen key stayed good for as long as its certificate, up to 825 days.
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

    // The others, and the node with its new key, notice nothing.
    let mut honest: Vec<NodeProcess> = VIEWPOINTS
        .iter()
        .map(|name| NodeProcess::start(name, edge(&hall, &venue, name)).unwrap())
        .collect();
    for node in &mut honest {
        assert_eq!(ended(node), Some(0), "{}", node.said());
    }
    assert_eq!(ended(&mut fusion), Some(0), "{}", fusion.said());
    assert_eq!(old.wait(PAUSE).unwrap(), None, "{}", old.said());

    // Where the file of generations is new and the key is not, the node says so itself.
    let newest = hall.path("certs/generations.toml");
    std::fs::copy(newest, stolen.join("generations.toml")).unwrap();
    let mut mixed = edge(&hall, &venue, "north-east");
    mixed.arg("--certificates").arg(&stolen);
    let mut mixed = NodeProcess::start("mixed", mixed).unwrap();
    assert_eq!(ended(&mut mixed), Some(2), "{}", mixed.said());
    assert!(
        mixed.said().contains("2 is the newest of north-east"),
        "{}",
        mixed.said()
    );
}

#[test]
fn every_node_refuses_keys_that_are_not_its_own_instead_of_waiting() {
    // Symptom to prevent: with the key of another node, or with junk, edges and recorders waited for ever and did not say why.
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
        assert_eq!(ended(&mut node), Some(2), "{}", node.said());
        let said = node.said();
        assert!(
            said.contains(words) && said.contains("copy ca.pem"),
            "{words}: {said}"
        );
    }
}

#[test]
fn files_that_fusion_has_replaced_are_not_taken_back_without_a_word() {
    let hall = SecuredHall::new();
    let far = tempfile::tempdir().unwrap();
    copy_keys(&hall, &far.path().join("certs"));
    let frames = "north-east.jsonl";
    std::fs::copy(hall.path(frames), far.path().join(frames)).unwrap();
    let at = far.path().join("venue.toml");
    let first = std::fs::read_to_string(hall.path("venue.toml")).unwrap();
    let second = format!("{first}\n# moved\n");
    let history = far.path().join("venue.toml.handouts");
    // Fetches from the n-th fusion, with this venue file; `sets` were taken when it is over, one more or as before.
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
            assert_eq!(ended(&mut edge), Some(1), "{}", edge.said());
        } else {
            wait_for(&edge, "the venue file is fusion's now");
            let looks = PATIENCE.as_millis() / PAUSE.as_millis();
            let is_noted = (0..looks).any(|_| {
                std::thread::sleep(PAUSE);
                taken() == sets
            });
            assert!(is_noted, "{}", edge.said());
        }
        let said = edge.said();
        drop((edge, fusion));
        said
    };
    fetch(1, &first, &[], 1);
    fetch(2, &second, &[], 2);
    let said = fetch(3, &first, &[], 2);
    assert!(
        said.contains("older files") && said.contains("--accept-older"),
        "{said}"
    );
    assert_eq!(std::fs::read_to_string(&at).unwrap(), second);
    fetch(4, &first, &["--accept-older"], 3);
    assert_eq!(std::fs::read_to_string(&at).unwrap(), first);
}
