//! Runs the built program, which knows the commands of `farfield` and of `lab`, and reads what it left.

use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::nets::check_verdicts;

/// Exit code and output of a finished `farfield`.
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

/// Runs `farfield` with `args` and waits for its end.
pub(crate) fn farfield<S: AsRef<std::ffi::OsStr>>(args: &[S]) -> FinishedCommand {
    finish(&command().args(args).output().unwrap())
}

pub(crate) fn finish(output: &Output) -> FinishedCommand {
    FinishedCommand {
        code: output.status.code().unwrap_or(-1),
        stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
        stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
    }
}

/// Runs a venue into `out`. Fails the test with the output if the exit code is not 0.
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
    // The verdicts of a live run depend on the machine.
    if !more.contains(&"--live") {
        check_verdicts(out);
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

/// The `summary.json` of a run.
pub(crate) fn summary(out: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(out.join("summary.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}
