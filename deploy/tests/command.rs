//! Tests of the real `farfield`: the commands of the README, wrong usage, and one whole run.
#![expect(
    clippy::unwrap_used,
    reason = "what goes wrong in a test fails it, with its place"
)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

/// The root of the checkout.
fn root() -> &'static Path {
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    manifest.parent().expect("the package is in the workspace")
}

/// Runs the built program with `args` to its end.
fn farfield(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_farfield"))
        .args(args)
        .stdin(Stdio::null())
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}

#[test]
fn the_commands_of_the_readme_exist() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let help = farfield(&["--help"]);
    let help = String::from_utf8_lossy(&help.stdout);
    let subcommands: Vec<&str> = help
        .lines()
        .filter_map(|line| line.strip_prefix("  ")?.split_whitespace().next())
        .collect();
    let mut faults = Vec::new();
    let mut seen = 0;
    for line in shell_lines(&readme) {
        let called = line
            .split_once("cargo run --release -- ")
            .map(|(_, rest)| rest)
            .or_else(|| line.strip_prefix("farfield "));
        let Some(called) = called else { continue };
        seen += 1;
        let mut words = called.split_whitespace();
        let subcommand = words.next().unwrap_or_default();
        if !subcommands.contains(&subcommand) {
            faults.push(format!("README.md: farfield has no `{subcommand}`: {line}"));
        }
        for file in words.filter(|word| word.starts_with("examples/")) {
            if !root().join(file).exists() {
                faults.push(format!("README.md: {file} is not there"));
            }
        }
    }
    assert!(seen > 0, "the README shows no command");
    assert!(faults.is_empty(), "\n{}", faults.join("\n"));
}

/// The lines of the `sh` blocks of a Markdown text.
fn shell_lines(markdown: &str) -> Vec<&str> {
    let mut inside = false;
    let mut lines = Vec::new();
    for line in markdown.lines() {
        if line.starts_with("```") {
            inside = !inside && line == "```sh";
        } else if inside {
            lines.push(line.trim());
        }
    }
    lines
}

#[test]
fn wrong_usage_exits_with_2_and_names_the_argument() {
    for (args, named) in [
        (&["no-such-command"][..], "no-such-command"),
        (&["run"], "VENUE"),
        (&["demo", "--ticks", "many"], "many"),
        (&["evaluate", "poses.jsonl"], "TRUTH"),
        // Suites and studies belong to the laboratory.
        (&["evaluate", "--suite", "paper"], "--suite"),
        (&["suite", "paper"], "suite"),
    ] {
        let output = farfield(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(error.contains(named), "{args:?}: {error}");
    }
}

#[test]
fn a_demo_of_maps_writes_poses() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let output = farfield(&[
        "demo",
        "--maps",
        "--ticks",
        "60",
        "--out",
        out.to_str().unwrap(),
    ]);
    let text = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{text}");
    let poses = fs::read_to_string(out.join("poses.jsonl")).unwrap();
    let last: serde_json::Value = serde_json::from_str(poses.lines().last().unwrap()).unwrap();
    assert_eq!(last["tick"], 59);
    assert!(last["joints"]["pelvis"].is_array(), "{last}");
}
