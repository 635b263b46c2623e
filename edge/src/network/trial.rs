//! Tries a library in a process of its own. One that is cut off, broken or hangs while it is loaded ends that process, and
//! the next place is tried.
//!
//! The process is this program again, so its `main` calls [`super::answer_trial`] first. In a program that does not, libraries
//! are loaded untried.

use std::io::{BufRead as _, BufReader, Read};
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use crate::guarded::{first_line, guarded};

/// First argument of the process that tries; the library is the second.
const TRY: &str = "--try-onnxruntime";
/// What it answers before the problem; without a problem the library can be used.
const ANSWER: &str = "farfield tried it:";
/// How long loading may take: one of 35 MB takes seconds from a slow card or a network drive.
const PATIENCE: Duration = Duration::from_secs(10);
/// An answer is a line, and libraries may write some of their own.
const MOST_BYTES: u64 = 1 << 16;

/// Whether this program answers when it is started again to try a library.
static ANSWERS: AtomicBool = AtomicBool::new(false);

/// Tries a library with `load` and returns the exit code, where this process was started for that; `None` of any other
/// process.
pub(super) fn answer(load: impl FnOnce(&Path) -> Result<(), String>) -> Option<ExitCode> {
    let mut args = std::env::args_os().skip(1);
    if args.next().is_none_or(|first| first != TRY) {
        ANSWERS.store(true, Ordering::Relaxed);
        return None;
    }
    // The message of a panic is the answer.
    std::panic::set_hook(Box::new(|_| ()));
    let path = args.next().unwrap_or_default();
    let problem = guarded(|| load(Path::new(&path))).err();
    println!("{ANSWER}{}", first_line(&problem.unwrap_or_default()));
    Some(ExitCode::SUCCESS)
}

/// Whether a process that loads the library at `path` comes through it.
///
/// # Errors
/// Why it does not.
pub(super) fn accepts(path: &Path) -> Result<(), String> {
    if !ANSWERS.load(Ordering::Relaxed) {
        return Ok(());
    }
    let program = std::env::current_exe()
        .map_err(|error| format!("it cannot be tried, as this program's file is gone: {error}"))?;
    accepts_within(Command::new(program), path, PATIENCE)
}

fn accepts_within(mut program: Command, path: &Path, patience: Duration) -> Result<(), String> {
    let process = program
        .arg(TRY)
        .arg(path)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn();
    let mut process = process.map_err(|error| format!("it cannot be tried: {error}"))?;
    let (sender, answer) = sync_channel(1);
    let stdout = process.stdout.take();
    std::thread::spawn(move || sender.send(stdout.and_then(answer_in)));
    let answer = answer.recv_timeout(patience);
    // Of what it does after its answer, or without one, nothing is wanted.
    process.kill().ok();
    let ended = process.wait();
    match answer {
        Ok(Some(problem)) if problem.is_empty() => Ok(()),
        Ok(Some(problem)) => Err(problem),
        Err(RecvTimeoutError::Timeout) => Err(format!(
            "loading it takes longer than {} s",
            patience.as_secs_f64()
        )),
        Ok(None) | Err(RecvTimeoutError::Disconnected) => {
            let ended = ended.map_or_else(|error| error.to_string(), |it| it.to_string());
            Err(format!(
                "loading it ends a process ({ended}): the file is cut off or broken"
            ))
        }
    }
}

/// The problem that is answered, empty for none; `None` where the process ends without an answer.
fn answer_in(stdout: impl Read) -> Option<String> {
    let lines = BufReader::new(stdout.take(MOST_BYTES)).split(b'\n');
    lines.map_while(Result::ok).find_map(|line| {
        let line = String::from_utf8_lossy(&line);
        let (_, problem) = line.split_once(ANSWER)?;
        Some(problem.trim().to_owned())
    })
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// What is said of a library whose process runs `script`.
    fn tried(script: &str) -> Result<(), String> {
        let mut shell = Command::new("sh");
        shell.args(["-c", script, "sh"]);
        accepts_within(shell, Path::new("/x.so"), Duration::from_secs(2))
    }

    #[test]
    fn a_process_that_dies_hangs_or_refuses_is_the_reason() {
        assert_eq!(tried(&format!("echo '{ANSWER}'")), Ok(()));
        let written = format!("echo hello; printf 'and {ANSWER}'; kill -SEGV $$");
        assert_eq!(
            tried(&written),
            Ok(()),
            "what comes after the answer does not count"
        );
        let refused = tried(&format!("echo \"{ANSWER}$2 is no library\""));
        assert_eq!(refused, Err("/x.so is no library".to_owned()));
        for (script, words) in [
            ("kill -BUS $$", "SIGBUS"),
            ("exit 3", "exit status: 3"),
            ("exec sleep 60", "longer than 2 s"),
            ("exec yes", "ends a process"),
        ] {
            let problem = tried(script).unwrap_err();
            assert!(problem.contains(words), "{script}: {problem}");
        }
    }
}
