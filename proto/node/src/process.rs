//! A node as a process: stop signals, messages, exit code.

use std::fmt;
use std::io::{Read as _, Write as _, stderr, stdout};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use farfield_proto::plain_text;
use farfield_proto::transport::MOST_LINK_HANDLES;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde::{Deserialize, Serialize};
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

/// Largest number of handles that a process requests: more than any venue needs, and small enough
/// for child programs that loop over all of them.
const MOST_HANDLES: u64 = 1 << 16;
/// Handles that are enough for a node in any case: those of its links, and 256 for files, pages and
/// cameras.
const ENOUGH_HANDLES: u64 = MOST_LINK_HANDLES as u64 + 256;

/// How a node ended without an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// All ticks were processed.
    Done,
    /// The node was asked to stop.
    Interrupted,
}

/// Why a node ended early.
#[derive(Debug)]
pub enum NodeError {
    /// Its input is wrong: exit code 2.
    Refused(anyhow::Error),
    /// It ran and failed: exit code 1.
    Failed(anyhow::Error),
}

impl NodeError {
    /// Wraps an error of the input.
    pub fn refused(error: impl Into<anyhow::Error>) -> Self {
        Self::Refused(error.into())
    }

    /// Wraps an error at run time.
    pub fn failed(error: impl Into<anyhow::Error>) -> Self {
        Self::Failed(error.into())
    }
}

impl NodeError {
    /// The exit code of this error.
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

/// Prints the error to standard error and converts the outcome to the exit code.
pub fn exit_code(outcome: Result<Ending, NodeError>) -> ExitCode {
    match outcome {
        Ok(Ending::Done) => ExitCode::SUCCESS,
        Ok(Ending::Interrupted) => ExitCode::from(EXIT_INTERRUPTED),
        Err(error) => {
            say_as(LineKind::LastError, format_args!("{error}"));
            ExitCode::from(error.exit_code())
        }
    }
}

/// How a command reports an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorFormat {
    /// As text on standard error.
    Text,
    /// Also as JSON on standard output.
    Json,
}

impl ErrorFormat {
    /// The format for the value of `--json`.
    pub fn as_json_if(json: bool) -> Self {
        if json { Self::Json } else { Self::Text }
    }
}

/// As [`exit_code`], for a command with a `--json` flag.
pub fn exit_code_with_format(outcome: Result<Ending, NodeError>, format: ErrorFormat) -> ExitCode {
    if let (Err(error), ErrorFormat::Json) = (&outcome, format) {
        say_json(&error.to_string(), error.exit_code());
    }
    exit_code(outcome)
}

/// Prints an error on standard output as JSON.
pub fn say_json(error: &str, exit_code: u8) {
    let text = serde_json::json!({ "error": error, "exit_code": exit_code });
    // The reader may be gone.
    drop(writeln!(
        stdout(),
        "{}",
        plain_text::lines(&text.to_string())
    ));
}

/// The kind of a message on standard error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LineKind {
    /// Any other message for the operator.
    Notice,
    /// A doubtful value in the venue's files: every process that reads them prints it.
    FileFinding,
    /// A part of a camera's pictures that is not used.
    UnusedPictures,
    /// An error after which the process goes on.
    Error,
    /// The error with which the process ends.
    LastError,
}

/// A message that a node writes for its parent process, as one line of JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeLine {
    /// Its kind.
    pub kind: LineKind,
    /// The message without the word for its kind; it may have several lines.
    pub text: String,
}

/// The text for the operator.
impl fmt::Display for NodeLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let word = match self.kind {
            LineKind::Notice | LineKind::UnusedPictures => "",
            LineKind::FileFinding => "doubtful: ",
            LineKind::Error | LineKind::LastError => "error: ",
        };
        write!(f, "{word}{}", self.text)
    }
}

/// Whether this process writes its messages as JSON, for a parent process.
static IS_FOR_PARENT: AtomicBool = AtomicBool::new(false);

/// From now on this process writes each message as a [`NodeLine`].
pub fn write_lines_for_parent() {
    IS_FOR_PARENT.store(true, Ordering::Relaxed);
}

/// Prints a message to standard error. It may contain foreign text: see [`plain_text`].
pub fn say(line: fmt::Arguments<'_>) {
    say_as(LineKind::Notice, line);
}

/// As [`say`], for a message of this kind.
pub fn say_as(kind: LineKind, text: fmt::Arguments<'_>) {
    let text = plain_text::lines(&text.to_string());
    let line = NodeLine { kind, text };
    let json = || serde_json::to_string(&line).ok();
    let is_for_parent = IS_FOR_PARENT.load(Ordering::Relaxed);
    let shown = is_for_parent.then(json).flatten();
    let shown = shown.unwrap_or_else(|| line.to_string());
    // `eprintln!` would panic when standard error is closed or its disk is full.
    drop(writeln!(stderr(), "{shown}"));
}

/// Raises this process's limit of open handles (sockets, files) as far as the system allows; warns
/// if the limit may be too low.
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

/// Cancels `stop` at SIGINT or SIGTERM, and with `managed` also when standard input closes, because
/// the parent is gone or wants the node to end.
///
/// # Errors
/// When the signal handlers cannot be installed, or no thread can be started.
pub fn stop_on_signal(
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

/// Whether a parent process keeps the node's standard input open as long as the node should live.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Managed {
    /// Started by hand or by systemd: standard input has no meaning.
    No,
    /// Started by `farfield run`.
    Yes,
}

/// A separate thread: a blocking read of standard input cannot be cancelled and must not delay the
/// end.
fn watch_parent(stop: CancellationToken) -> std::io::Result<()> {
    let watch = move || {
        let mut ignored = [0; 64];
        // An error counts as the end.
        while matches!(std::io::stdin().read(&mut ignored), Ok(n) if n > 0) {}
        stop.cancel();
    };
    std::thread::Builder::new()
        .name("parent".to_owned())
        .spawn(watch)
        .map(drop)
}
