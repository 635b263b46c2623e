//! How a node behaves as a process: what tells it to stop, what it says, its exit code.

use std::fmt;
use std::io::{Read as _, Write as _, stderr, stdout};
use std::process::ExitCode;

use farfield_proto::plain_text;
use farfield_proto::transport::MOST_LINK_HANDLES;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use tokio::signal::unix::{SignalKind, signal};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::debug;

/// Exit code of a run that was interrupted: 128 + SIGINT.
pub const EXIT_INTERRUPTED: u8 = 130;
/// Exit code of what ran and failed.
pub const EXIT_FAILED: u8 = 1;
/// Exit code for wrong input or usage.
pub const EXIT_REFUSED: u8 = 2;

/// Handles that a process asks for at most: more than any venue needs, and few enough for programs that it starts and that
/// go through all of them.
const MOST_HANDLES: u64 = 1 << 16;
/// Handles of a node that are enough whatever strangers do: those of its links, and 256 for files, pages and cameras.
const ENOUGH_HANDLES: u64 = MOST_LINK_HANDLES as u64 + 256;

/// How a node ended when nothing went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// All ticks were worked on.
    Done,
    /// Someone asked it to stop.
    Interrupted,
}

/// Why a node ended early.
#[derive(Debug)]
pub enum NodeError {
    /// Its input is wrong: exit code 2.
    Refused(anyhow::Error),
    /// It ran, and failed: exit code 1.
    Failed(anyhow::Error),
}

impl NodeError {
    /// Wraps what is wrong with the input.
    pub fn refused(error: impl Into<anyhow::Error>) -> Self {
        Self::Refused(error.into())
    }

    /// Wraps what went wrong at work.
    pub fn failed(error: impl Into<anyhow::Error>) -> Self {
        Self::Failed(error.into())
    }
}

impl NodeError {
    /// The exit code that says it.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Refused(_) => EXIT_REFUSED,
            Self::Failed(_) => EXIT_FAILED,
        }
    }
}

impl fmt::Display for NodeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Refused(error) | Self::Failed(error)) = self;
        write!(f, "{error:#}")
    }
}

/// Says on standard error what went wrong, and turns the outcome into the exit code.
pub fn exit_code(outcome: Result<Ending, NodeError>) -> ExitCode {
    match outcome {
        Ok(Ending::Done) => ExitCode::SUCCESS,
        Ok(Ending::Interrupted) => ExitCode::from(EXIT_INTERRUPTED),
        Err(error) => {
            say(format_args!("error: {error}"));
            ExitCode::from(error.exit_code())
        }
    }
}

/// How a command tells what went wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Told {
    /// In words on standard error.
    InWords,
    /// As JSON on standard output, too.
    AsJson,
}

impl Told {
    /// As `--json` was given or not.
    pub fn as_json_if(json: bool) -> Self {
        if json { Self::AsJson } else { Self::InWords }
    }
}

/// [`exit_code`] of a command that may have been asked for JSON.
pub fn exit_code_told(outcome: Result<Ending, NodeError>, told: Told) -> ExitCode {
    if let (Err(error), Told::AsJson) = (&outcome, told) {
        say_json(&error.to_string(), error.exit_code());
    }
    exit_code(outcome)
}

/// Prints an error on standard output as programs read it.
pub fn say_json(error: &str, exit_code: u8) {
    let text = serde_json::json!({ "error": error, "exit_code": exit_code });
    // A reader that has gone wants no more.
    drop(writeln!(
        stdout(),
        "{}",
        plain_text::lines(&text.to_string())
    ));
}

/// Says a line to whoever reads standard error. Text of others may stand in it: see [`plain_text`].
pub fn say(line: fmt::Arguments<'_>) {
    // `eprintln!` would panic when nobody reads any more, or the disk behind it is full.
    drop(writeln!(
        stderr(),
        "{}",
        plain_text::lines(&line.to_string())
    ));
}

/// Raises this process's limit of open handles (sockets, files) to what the system allows it; prints where that may be too
/// little.
pub(crate) fn raise_handle_limit() {
    let limit = getrlimit(Resource::Nofile);
    let most = limit.maximum.unwrap_or(MOST_HANDLES).min(MOST_HANDLES);
    let now = limit.current.unwrap_or(most);
    let raised = Rlimit {
        current: Some(most),
        ..limit
    };
    if now < most && setrlimit(Resource::Nofile, raised).is_err() {
        debug!(now, most, "the limit of open handles stays");
    }
    if now.max(most) < ENOUGH_HANDLES {
        say(format_args!(
            "this process may open {most} handles, {ENOUGH_HANDLES} are recommended: `ulimit -Hn {ENOUGH_HANDLES}`, or `LimitNOFILE={ENOUGH_HANDLES}` in its unit"
        ));
    }
}

/// Cancels `stop` at SIGINT or SIGTERM, and with `managed` when standard input closes: the parent has
/// gone, or wants the node to end.
///
/// # Errors
/// When the signals cannot be listened for, or no thread starts.
pub fn stop_when_told(
    tasks: &TaskTracker,
    stop: &CancellationToken,
    managed: Managed,
) -> std::io::Result<()> {
    let mut interrupt = signal(SignalKind::interrupt())?;
    let mut terminate = signal(SignalKind::terminate())?;
    let stop = stop.clone();
    if managed == Managed::Yes {
        watch_parent(stop.clone())?;
    }
    tasks.spawn(async move {
        tokio::select! {
            _ = interrupt.recv() => {}
            _ = terminate.recv() => {}
            () = stop.cancelled() => {}
        }
        stop.cancel();
    });
    Ok(())
}

/// Whether a parent process holds the node's standard input for as long as the node shall live.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Managed {
    /// Started by hand or by systemd: standard input means nothing.
    No,
    /// Started by `farfield run`.
    Yes,
}

/// A thread of its own: a read of standard input cannot be called off, and must not hold up the end.
fn watch_parent(stop: CancellationToken) -> std::io::Result<()> {
    let watch = move || {
        let mut ignored = [0; 64];
        // An error means the same as the end.
        while matches!(std::io::stdin().read(&mut ignored), Ok(n) if n > 0) {}
        stop.cancel();
    };
    std::thread::Builder::new()
        .name("parent".to_owned())
        .spawn(watch)
        .map(drop)
}
