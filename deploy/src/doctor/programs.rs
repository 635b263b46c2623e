//! The programs that decode video.

use std::ffi::OsStr;
use std::io;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use farfield_node::clock;

use crate::report_lines::{ReportLines, Verdict};

/// The group of these lines.
const GROUP: &str = "programs";
const PROGRAMS: [&str; 2] = ["ffmpeg", "ffprobe"];
const INSTALL: &str = "apt install ffmpeg (Fedora: dnf install ffmpeg; macOS: brew install ffmpeg)";
/// The first version that knows `-fps_mode`.
const LEAST_VERSION: (u32, u32) = (5, 1);
/// A program that says its version later than this hangs, on a network drive for one.
const PATIENCE: Duration = Duration::from_secs(1);
const LOOKED_AT_EVERY: Duration = Duration::from_millis(5);

/// What the programs are needed for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ProgramNeed {
    /// No source is a video.
    None,
    /// Videos or streams.
    Video,
}

/// Asks `ffmpeg` and `ffprobe` on the search path `path` for their versions.
pub(super) fn look_at_programs(path: &OsStr, need: ProgramNeed, report: &mut ReportLines) {
    // Both at once: who waits for a diagnosis waits for the slower.
    let said = thread::scope(|scope| {
        let asked = PROGRAMS.map(|program| scope.spawn(move || look_at(program, path)));
        asked.map(|asked| {
            asked
                .join()
                .unwrap_or_else(|_| (Verdict::Failed, "asking for its version failed".to_owned()))
        })
    });
    for (verdict, text) in said {
        let is_needed = need == ProgramNeed::Video;
        let (verdict, text) = match verdict {
            Verdict::Failed if !is_needed => (
                Verdict::Warning,
                format!("{text}; this venue does without it"),
            ),
            verdict => (verdict, text),
        };
        let remedy = if verdict == Verdict::Ok { "" } else { INSTALL };
        report.push(GROUP, verdict, text, remedy);
    }
}

fn look_at(program: &str, path: &OsStr) -> (Verdict, String) {
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
                    "`{program} -version` gives no answer within {} s",
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
    let said = String::from_utf8_lossy(&output.stdout);
    let first = said.lines().next().unwrap_or_default();
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

/// What the program says and how it ends; `None` where it does not end, and is ended.
fn answer(command: &mut Command) -> io::Result<Option<Output>> {
    let mut child = command
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()?;
    let asked = clock::now();
    // What it says fits into its pipe many times.
    while child.try_wait()?.is_none() {
        if clock::now().duration_since(asked) > PATIENCE {
            child.kill()?;
            child.wait()?;
            return Ok(None);
        }
        thread::sleep(LOOKED_AT_EVERY);
    }
    child.wait_with_output().map(Some)
}

/// The first two numbers of a version; `None` of one by date or commit, which is rather new.
fn numbers(version: &str) -> Option<(u32, u32)> {
    let mut parts = version.trim_start_matches('n').split(['.', '-', '+']);
    let major: u32 = parts.next()?.parse().ok()?;
    // Builds of a day begin with the year.
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
