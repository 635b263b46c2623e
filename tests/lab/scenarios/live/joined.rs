//! A live run on this machine is joined where it says that it can be.

use std::process::Command;
use std::time::Duration;

use farfield_lab::live_venue::NodeProcess;
use farfield_node::clock;

use super::stage::write_venue;
use crate::farfield::{command, farfield};

/// Far above what a loaded machine takes for anything that is waited for.
const PATIENCE: Duration = Duration::from_secs(90);
/// Between two looks.
const PAUSE: Duration = Duration::from_millis(100);

/// The words of the command that a run has told to look at its nodes with, once it has.
fn told(said: &str) -> Option<Vec<String>> {
    let line = said
        .lines()
        .find(|line| line.ends_with(" shows its nodes"))?;
    let command = line.split('`').nth(1)?;
    let words = command.strip_prefix("farfield ")?.split(' ');
    Some(words.map(str::to_owned).collect())
}

/// Symptom: `farfield status` found no venue that `farfield run --live` had started beside it, whose port was nowhere said.
#[test]
fn the_status_shows_the_nodes_of_a_live_run_by_the_words_that_this_has_told() {
    let folder = tempfile::tempdir().unwrap();
    let venue = write_venue(folder.path(), &[], "");
    let mut run = command();
    run.arg("run").arg(&venue).args(["--live", "--out"]);
    run.arg(folder.path().join("out"));
    let mut run = NodeProcess::start("run", run).unwrap();
    let until = clock::now() + PATIENCE;
    let words = loop {
        if let Some(words) = told(&run.output()) {
            break words;
        }
        assert!(clock::now() < until, "{}", run.output());
        std::thread::sleep(PAUSE);
    };
    let is_live = |shown: &str, node: &str| {
        let mut lines = shown.lines().filter(|line| line.starts_with(node));
        lines.any(|line| line.contains(" live "))
    };
    // Its nodes begin one after the other.
    loop {
        let shown = farfield(&words);
        let all = ["fusion ", "north-east ", "south-west "];
        if shown.code == 0 && all.iter().all(|node| is_live(&shown.stdout, node)) {
            break;
        }
        assert!(clock::now() < until, "{}\n{}", shown.stdout, shown.stderr);
        std::thread::sleep(PAUSE);
    }
    let id = run.pid().to_string();
    let interrupted = Command::new("kill").args(["-INT", &id]).status();
    assert!(interrupted.unwrap().success());
    let ended = run.wait(PATIENCE).unwrap();
    assert_eq!(
        ended.and_then(|status| status.code()),
        Some(130),
        "{}",
        run.output()
    );
}
