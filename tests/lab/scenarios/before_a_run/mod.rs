//! Checks before a run: `farfield check`, `doctor`, `init`, and refused runs.

mod check;
mod doctor;
mod init;
mod moved_calibrations;
mod plausible;

use std::path::Path;

use serde_json::Value;

use crate::data::SampleFolder;
use crate::farfield::{FinishedCommand, command, finish};

impl SampleFolder {
    fn farfield(&self, args: &[&str]) -> FinishedCommand {
        farfield_in(self.folder(), args)
    }
}

/// Runs `farfield` with `args` in `folder` and waits for its end.
fn farfield_in(folder: &Path, args: &[&str]) -> FinishedCommand {
    let output = command().current_dir(folder).args(args).output().unwrap();
    finish(&output)
}

/// The lines of a report in JSON: group, verdict, text, remedy.
fn lines(finished: &FinishedCommand) -> Vec<[String; 4]> {
    let report: Value = serde_json::from_str(&finished.stdout).unwrap_or_else(|error| {
        panic!("{error}\n{}\n{}", finished.stdout, finished.stderr);
    });
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let mut lines = Vec::new();
    for group in report["groups"].as_array().unwrap() {
        for line in group["lines"].as_array().unwrap() {
            let fields = [
                &group["group"],
                &line["verdict"],
                &line["text"],
                &line["remedy"],
            ];
            lines.push(fields.map(text));
        }
    }
    lines
}

/// Whether one line with this verdict contains all `words` in its text or remedy.
fn has_line(lines: &[[String; 4]], verdict: &str, words: &[&str]) -> bool {
    lines.iter().any(|[_, line_verdict, text, remedy]| {
        let has = |word: &&str| text.contains(*word) || remedy.contains(*word);
        line_verdict == verdict && words.iter().all(has)
    })
}
