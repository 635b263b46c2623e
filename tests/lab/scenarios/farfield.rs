//! Runs the built program, which knows the commands of `farfield` and of `lab`, and reads what it left.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::nets::hold_verdicts;

/// What a finished `farfield` said.
pub(crate) struct FinishedCommand {
    pub(crate) code: i32,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

/// The binary, not yet started, quiet and without a terminal.
pub(crate) fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_lab"));
    command.stdin(Stdio::null()).env_remove("RUST_LOG");
    command
}

/// Runs `farfield` with `args` to its end.
pub(crate) fn farfield<S: AsRef<std::ffi::OsStr>>(args: &[S]) -> FinishedCommand {
    finish(&command().args(args).output().unwrap())
}

/// What a finished process said.
pub(crate) fn finish(output: &Output) -> FinishedCommand {
    FinishedCommand {
        code: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// Runs a venue into `out` and fails the test with what was said when it does not end well.
pub(crate) fn run(venue: &Path, out: &Path, more: &[&str]) -> FinishedCommand {
    let output = command()
        .arg("run")
        .arg(venue)
        .arg("--out")
        .arg(out)
        .args(more)
        .output()
        .unwrap();
    let finished = finish(&output);
    assert_eq!(
        finished.code,
        0,
        "farfield run {}\n{}\n{}",
        venue.display(),
        finished.stdout,
        finished.stderr
    );
    // What a live run sees depends on the machine.
    if !more.contains(&"--live") {
        hold_verdicts(out);
    }
    finished
}

/// The lines of a `poses.jsonl`, in file order.
pub(crate) fn poses(out: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(out.join("poses.jsonl")).unwrap();
    text.lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect()
}

/// What the run that left its files in `out` says of itself.
pub(crate) fn summary(out: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}
