//! Trial of a library in a separate process. A truncated, broken or hanging library ends only that
//! process, and the next place is tried.
//!
//! The process is this program again, so its `main` calls [`super::answer_trial`] first. In
//! programs that do not, libraries are loaded without a trial.

use std::io::{BufRead as _, BufReader, Read};
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use crate::guarded::{first_line, guarded};

/// First argument of the trial process; the library is the second.
const TRY: &str = "--try-onnxruntime";
/// Prefix of its answer; the rest is the problem, empty if the library is usable.
const ANSWER: &str = "farfield tried it:";
/// Longest time for loading: 35 MB take seconds from a slow card or a network drive.
const PATIENCE: Duration = Duration::from_secs(10);
/// Most bytes read. An answer is a line, but libraries can also print.
const MAX_BYTES: u64 = 1 << 16;

/// Whether this program answers trials when started again.
static ANSWERS: AtomicBool = AtomicBool::new(false);

/// In a trial process: tries a library with `load` and returns the exit code. Otherwise `None`.
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

/// Checks that a process can load the library at `path`.
///
/// # Errors
/// The reason if it cannot.
pub(super) fn accepts(path: &Path) -> Result<(), String> {
    if !ANSWERS.load(Ordering::Relaxed) {
        return Ok(());
    }
    let program = std::env::current_exe().map_err(|error| {
        format!("it cannot be tried, because this program's file is gone: {error}")
    })?;
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
    // Its output after the answer is ignored.
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

/// The problem in the answer, empty for none; `None` if the process ends without an answer.
fn answer_in(stdout: impl Read) -> Option<String> {
    let lines = BufReader::new(stdout.take(MAX_BYTES)).split(b'\n');
    lines.map_while(Result::ok).find_map(|line| {
        let line = String::from_utf8_lossy(&line);
        let (_, problem) = line.split_once(ANSWER)?;
        Some(problem.trim().to_owned())
    })
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// The result for a library whose process runs `script`.
    fn trial_of(script: &str) -> Result<(), String> {
        let mut shell = Command::new("sh");
        shell.args(["-c", script, "sh"]);
        accepts_within(shell, Path::new("/x.so"), Duration::from_secs(2))
    }

    #[test]
    fn a_trial_that_dies_hangs_or_refuses_is_reported() {
        assert_eq!(trial_of(&format!("echo '{ANSWER}'")), Ok(()));
        let written = format!("echo hello; printf 'and {ANSWER}'; kill -SEGV $$");
        assert_eq!(
            trial_of(&written),
            Ok(()),
            "what comes after the answer does not count"
        );
        let refused = trial_of(&format!("echo \"{ANSWER}$2 is no library\""));
        assert_eq!(refused, Err("/x.so is no library".to_owned()));
        for (script, words) in [
            ("kill -BUS $$", "SIGBUS"),
            ("exit 3", "exit status: 3"),
            ("exec sleep 60", "longer than 2 s"),
            ("exec yes", "ends a process"),
        ] {
            let problem = trial_of(script).unwrap_err();
            assert!(problem.contains(words), "{script}: {problem}");
        }
    }
}
