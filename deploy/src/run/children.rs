//! The nodes as child processes: each in its own process group; a node leaves when its standard input closes.

use std::ffi::OsString;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{ExitStatus, Stdio};

use anyhow::Context as _;
use farfield_fusion_node::{OWN_RECORDING, Report};
use farfield_node::process::{LineKind, NodeLine};
use tokio::io::{AsyncBufReadExt as _, AsyncRead, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::debug;

use super::check::{RunPace, RunPlan};
use super::node_lines::{LineDetail, read};
use super::progress::ProgressDetail;
use crate::listeners::page_access;

/// Subfolder of the results where edges keep their rings during a run.
pub(super) const RINGS: &str = "ring";
/// Name of fusion among the nodes.
pub(super) const FUSION: &str = "fusion";
/// Queue of events; when it is full, the pipes hold back the nodes.
const QUEUE: usize = 256;

/// Events of the nodes.
#[derive(Debug)]
pub(super) enum NodeEvent {
    /// A report of fusion.
    Report(Report),
    /// A message from the standard error of a node.
    Line { node: String, line: NodeLine },
    /// A node has ended.
    Exited(Exit),
}

/// The end of a node.
#[derive(Debug)]
pub(super) struct Exit {
    pub(super) node: String,
    pub(super) status: Option<ExitStatus>,
    /// The error with which it ended. If there was none, what it wrote before the run began.
    pub(super) error: String,
    /// The last error after which it kept running. It was printed.
    pub(super) survived_error: String,
}

impl Exit {
    pub(super) fn code(&self) -> Option<i32> {
        self.status.and_then(|status| status.code())
    }

    /// Whether it gave no reason and was not killed by a signal.
    pub(super) fn has_no_reason(&self) -> bool {
        self.error.is_empty() && self.survived_error.is_empty() && self.code().is_some()
    }

    /// The reason of the end: the node's own error, if it wrote one.
    pub(super) fn reason(&self) -> String {
        // A node that was killed did not end because of an earlier error.
        let use_survived = self.error.is_empty() && self.code().is_some();
        let error = if use_survived {
            &self.survived_error
        } else {
            &self.error
        };
        match self.status {
            Some(status) if error.is_empty() => status.signal().map_or_else(
                || status.to_string(),
                |signal| format!("killed by signal {signal}"),
            ),
            None if error.is_empty() => "its exit status is unknown".to_owned(),
            _ => error.clone(),
        }
    }
}

/// Starts nodes and collects their output.
pub(super) struct Children {
    tasks: TaskTracker,
    kill: CancellationToken,
    events: mpsc::Sender<NodeEvent>,
    detail: LineDetail,
}

impl Children {
    /// Starts nothing yet. Events of all nodes arrive at the returned receiver.
    pub(super) fn new(detail: LineDetail) -> (Self, mpsc::Receiver<NodeEvent>) {
        let (events, received) = mpsc::channel(QUEUE);
        (
            Self {
                tasks: TaskTracker::new(),
                kill: CancellationToken::new(),
                events,
                detail,
            },
            received,
        )
    }

    /// Starts fusion on this machine, with its results in `out`.
    pub(super) fn start_fusion(
        &self,
        plan: &RunPlan,
        out: &Path,
        progress: ProgressDetail,
    ) -> anyhow::Result<ChildStdin> {
        let mut command = node(plan, FUSION)?;
        command.args(plan.place().words()).arg("--out").arg(out);
        if plan.pace == RunPace::Live {
            command.arg("--live");
        }
        if let Some(record) = &plan.record {
            let own = || out.join(OWN_RECORDING);
            // One word, so that no value is taken for an option.
            let mut word = OsString::from("--record=");
            word.push(record.clone().unwrap_or_else(own));
            command.arg(word);
        }
        if progress == ProgressDetail::Bodies {
            command.arg("--report-bodies");
        }
        command.args(plan.listeners.words());
        command.envs(
            plan.listeners
                .page_token
                .as_ref()
                .map(page_access::token_for_node),
        );
        command.stdout(Stdio::piped());
        self.start(FUSION, command)
    }

    /// Starts the edge of a viewpoint. Live, it keeps its ring below `out` during the run.
    pub(super) fn start_edge(
        &self,
        plan: &RunPlan,
        out: &Path,
        viewpoint: &str,
        endpoint: &str,
    ) -> anyhow::Result<ChildStdin> {
        let mut command = node(plan, "edge")?;
        command
            .args(["--viewpoint", viewpoint, "--connect", endpoint])
            .stdout(Stdio::null());
        if plan.pace == RunPace::Live {
            command.arg("--ring").arg(out.join(RINGS).join(viewpoint));
        }
        self.start(viewpoint, command)
    }

    /// Kills every node that still runs.
    pub(super) fn kill(&self) {
        self.kill.cancel();
    }

    fn start(&self, name: &str, mut command: Command) -> anyhow::Result<ChildStdin> {
        let mut child = command
            .spawn()
            .with_context(|| format!("starting {name}"))?;
        debug!(name, process = child.id(), "node started");
        let stdin = child.stdin.take().context("a child's standard input")?;
        self.tasks.spawn(follow(
            name.to_owned(),
            self.detail,
            child,
            self.events.clone(),
            self.kill.clone(),
        ));
        Ok(stdin)
    }
}

fn node(plan: &RunPlan, kind: &str) -> anyhow::Result<Command> {
    let binary = std::env::current_exe().context("finding this program's own file")?;
    let mut command = Command::new(binary);
    command.arg(kind).arg(&plan.venue_path);
    command.args(["--managed", "--lines-for-parent"]);
    if let Some(ticks) = &plan.ticks {
        let ticks = format!("{}..{}", ticks.start, ticks.end);
        command.arg("--ticks").arg(ticks);
    }
    // An own process group: Ctrl-C reaches only this process, which ends the nodes in order.
    command.process_group(0).kill_on_drop(true);
    command.stdin(Stdio::piped()).stderr(Stdio::piped());
    Ok(command)
}

/// Task: one node from start to end.
async fn follow(
    node: String,
    detail: LineDetail,
    mut child: Child,
    events: mpsc::Sender<NodeEvent>,
    kill: CancellationToken,
) {
    let stdout = child.stdout.take();
    let stderr = child.stderr.take();
    let reports = async {
        if let Some(stdout) = stdout {
            forward_reports(stdout, &events).await;
        }
    };
    let errors = async {
        match stderr {
            Some(stderr) => forward_errors(&node, stderr, detail, &events).await,
            None => LastErrors::default(),
        }
    };
    let wait = async {
        tokio::select! {
            status = child.wait() => status.ok(),
            () = kill.cancelled() => {
                drop(child.start_kill());
                child.wait().await.ok()
            }
        }
    };
    let ((), errors, status) = tokio::join!(reports, errors, wait);
    debug!(node, status = ?status.map(|it| it.to_string()), "node ended");
    let exit = Exit {
        node,
        status,
        error: errors.last,
        survived_error: errors.survived,
    };
    drop(events.send(NodeEvent::Exited(exit)).await);
}

async fn forward_reports(stdout: impl AsyncRead + Unpin, events: &mpsc::Sender<NodeEvent>) {
    let mut lines = BufReader::new(stdout).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        match serde_json::from_str(&line) {
            Ok(report) => drop(events.send(NodeEvent::Report(report)).await),
            Err(error) => debug!(%line, %error, "not a report"),
        }
    }
}

/// The last error that a node survived, and the error with which it ended; empty if there was none.
#[derive(Debug, Default)]
struct LastErrors {
    survived: String,
    last: String,
}

/// Forwards the messages of a node as events, but keeps the error with which it ends: the verdict on the run contains it.
async fn forward_errors(
    node: &str,
    stderr: impl AsyncRead + Unpin,
    detail: LineDetail,
    events: &mpsc::Sender<NodeEvent>,
) -> LastErrors {
    let mut errors = LastErrors::default();
    let mut lines = BufReader::new(stderr).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        let line = read(line);
        match line.kind {
            LineKind::LastError => errors.last.clone_from(&line.text),
            LineKind::Error => errors.survived.clone_from(&line.text),
            _ => {}
        }
        if line.kind != LineKind::LastError || detail == LineDetail::Log {
            let node = node.to_owned();
            drop(events.send(NodeEvent::Line { node, line }).await);
        }
    }
    errors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn messages_are_forwarded_at_once_and_the_last_error_is_returned() {
        let line = |kind, text: &str| {
            let text = text.to_owned();
            serde_json::to_string(&NodeLine { kind, text }).unwrap() + "\n"
        };
        let stderr = line(LineKind::Error, "the disk is full")
            + &line(LineKind::LastError, "poses.jsonl:\n  no space left");
        let (events, mut received) = mpsc::channel(QUEUE);
        let errors =
            forward_errors("fusion", stderr.as_bytes(), LineDetail::Notices, &events).await;
        assert_eq!(errors.last, "poses.jsonl:\n  no space left");
        assert_eq!(errors.survived, "the disk is full");
        drop(events);
        let Some(NodeEvent::Line { node, line }) = received.recv().await else {
            panic!("no line was forwarded");
        };
        assert_eq!([node, line.text], ["fusion", "the disk is full"]);
        assert!(received.recv().await.is_none());
    }

    #[test]
    fn the_last_survived_error_is_the_reason_unless_killed() {
        let ended = |raw: i32| Exit {
            node: FUSION.to_owned(),
            status: Some(ExitStatus::from_raw(raw)),
            error: String::new(),
            survived_error: "no space left".to_owned(),
        };
        assert_eq!(ended(1 << 8).reason(), "no space left");
        assert_eq!(ended(9).reason(), "killed by signal 9");
    }
}
