//! The programs that decode video.

use std::ffi::OsStr;
use std::io;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use farfield_node::clock;

use crate::report_lines::{ReportLines, Verdict};

const GROUP: &str = "programs";
const PROGRAMS: [&str; 2] = ["ffmpeg", "ffprobe"];
const INSTALL: &str = "apt install ffmpeg (Fedora: dnf install ffmpeg; macOS: brew install ffmpeg)";
/// The first version with `-fps_mode`.
const LEAST_VERSION: (u32, u32) = (5, 1);
/// A program without an answer after this time hangs, for example on a network drive.
const PATIENCE: Duration = Duration::from_secs(1);
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// What the programs are needed for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ProgramNeed {
    /// No source is a video.
    None,
    /// Videos or streams.
    Video,
}

/// Queries `ffmpeg` and `ffprobe` on the search path `path` for their versions.
pub(super) fn check_programs(path: &OsStr, need: ProgramNeed, report: &mut ReportLines) {
    // Both at once, to wait only for the slower one.
    let results = thread::scope(|scope| {
        let checks = PROGRAMS.map(|program| scope.spawn(move || check_program(program, path)));
        checks.map(|check| {
            check
                .join()
                .unwrap_or_else(|_| (Verdict::Failed, "the version query failed".to_owned()))
        })
    });
    for (verdict, text) in results {
        let is_needed = need == ProgramNeed::Video;
        let (verdict, text) = match verdict {
            Verdict::Failed if !is_needed => (
                Verdict::Warning,
                format!("{text}; this venue does not need it"),
            ),
            verdict => (verdict, text),
        };
        let remedy = if verdict == Verdict::Ok { "" } else { INSTALL };
        report.push(GROUP, verdict, text, remedy);
    }
}

fn check_program(program: &str, path: &OsStr) -> (Verdict, String) {
    let mut command = Command::new(program);
    command
        .arg("-version")
        .env("PATH", path)
        .stdin(Stdio::null());
    let output = match answer(&mut command) {
        Ok(Some(output)) => output,
        Ok(None) => {
            return (
                Verdict::Failed,
                format!(
                    "`{program} -version` gave no answer within {} s",
                    PATIENCE.as_secs()
                ),
            );
        }
        Err(error) => {
            return (
                Verdict::Failed,
                format!("`{program}` cannot be started: {error}"),
            );
        }
    };
    let output_text = String::from_utf8_lossy(&output.stdout);
    let first = output_text.lines().next().unwrap_or_default();
    let Some(version) = first
        .split(" version ")
        .nth(1)
        .filter(|_| output.status.success())
    else {
        return (
            Verdict::Failed,
            format!(
                "`{program} -version` ended with {} and no version",
                output.status
            ),
        );
    };
    let version = version.split_whitespace().next().unwrap_or_default();
    match numbers(version) {
        Some(found) if found < LEAST_VERSION => (
            Verdict::Failed,
            format!(
                "{program} {version}, expected {}.{} or later",
                LEAST_VERSION.0, LEAST_VERSION.1
            ),
        ),
        _ => (Verdict::Ok, format!("{program} {version}")),
    }
}

/// Output and exit status of the program; `None` if it hangs and was killed.
fn answer(command: &mut Command) -> io::Result<Option<Output>> {
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let start = clock::now();
    // The output is much smaller than the pipe's buffer.
    while child.try_wait()?.is_none() {
        if clock::now().duration_since(start) > PATIENCE {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(POLL_INTERVAL);
    }
    child.wait_with_output().map(Some)
}

/// The first two numbers of a version; `None` if it is a date or commit, which is recent.
fn numbers(version: &str) -> Option<(u32, u32)> {
    let mut parts = version.trim_start_matches('n').split(['.', '-', '+']);
    let major: u32 = parts.next()?.parse().ok()?;
    // Daily builds begin with the year.
    (major < 1000).then(|| {
        (
            major,
            parts.next().and_then(|it| it.parse().ok()).unwrap_or(0),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn versions_are_compared_by_their_numbers() {
        assert_eq!(numbers("5.1.9-0+deb12u1"), Some((5, 1)));
        assert_eq!(numbers("n7.0"), Some((7, 0)));
        assert_eq!(numbers("8"), Some((8, 0)));
        assert_eq!(numbers("2026-01-02-git-abc"), None);
        assert_eq!(numbers("N-112233-g1234"), None);
    }
}
