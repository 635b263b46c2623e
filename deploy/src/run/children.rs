//! The nodes as child processes: each in a group of its own, leaving when its standard input closes.

use std::collections::VecDeque;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{ExitStatus, Stdio};

use anyhow::Context as _;
use farfield_edge::pipeline::BeyondView;
use farfield_fusion::node::Report;
use farfield_node::process::say;
use tokio::io::{AsyncBufReadExt as _, AsyncRead, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::debug;

use super::check::{RunPace, RunPlan};
use super::follow::ProgressDetail;

/// Folder in that of the results for what edges keep on disk while a run lasts.
pub(super) const RINGS: &str = "ring";
/// Fusion's name among the nodes.
pub(super) const FUSION: &str = "fusion";
/// Lines of a node's standard error that are kept, the newest.
const KEPT_LINES: usize = 30;
/// Events that wait for the loop; the pipes hold back the rest.
const QUEUE: usize = 256;

/// What the nodes do.
#[derive(Debug)]
pub(super) enum NodeEvent {
    /// Fusion reports.
    Report(Report),
    /// A node has ended.
    Exited(Exit),
}

/// The end of a node.
#[derive(Debug)]
pub(super) struct Exit {
    pub(super) node: String,
    pub(super) status: Option<ExitStatus>,
    /// The end of its standard error.
    pub(super) said: Vec<String>,
}

impl Exit {
    pub(super) fn code(&self) -> Option<i32> {
        self.status.and_then(|status| status.code())
    }

    /// What went wrong, in the node's own words where it had some.
    pub(super) fn reason(&self) -> String {
        let said = self.said.join("\n");
        let said = said.trim().strip_prefix("error: ").unwrap_or(said.trim());
        match self.status {
            Some(status) if said.is_empty() => status.signal().map_or_else(
                || status.to_string(),
                |signal| format!("killed by signal {signal}"),
            ),
            None if said.is_empty() => "cannot be waited for".to_owned(),
            _ => said.to_owned(),
        }
    }
}

/// Starts nodes and gathers what they say.
pub(super) struct Children {
    tasks: TaskTracker,
    kill: CancellationToken,
    events: mpsc::Sender<NodeEvent>,
}

impl Children {
    /// Nothing runs yet; events of what will come out at the other end.
    pub(super) fn new() -> (Self, mpsc::Receiver<NodeEvent>) {
        let (events, received) = mpsc::channel(QUEUE);
        (
            Self {
                tasks: TaskTracker::new(),
                kill: CancellationToken::new(),
                events,
            },
            received,
        )
    }

    /// Starts fusion on a free port of the loopback, with its results in `out`.
    pub(super) fn start_fusion(
        &self,
        plan: &RunPlan,
        out: &Path,
        detail: ProgressDetail,
    ) -> anyhow::Result<ChildStdin> {
        let mut command = node(plan, FUSION)?;
        command
            .args(["--listen", plan.loopback()])
            .arg("--out")
            .arg(out);
        if plan.pace == RunPace::Live {
            command.arg("--live");
        }
        if let Some(record) = &plan.record {
            let own = || out.join("recording.mcap");
            command
                .arg("--record")
                .arg(record.clone().unwrap_or_else(own));
        }
        if detail == ProgressDetail::Bodies {
            command.arg("--report-bodies");
        }
        command.args(plan.listeners.words());
        command.stdout(Stdio::piped());
        self.start(FUSION, command)
    }

    /// Starts the edge of a viewpoint; live, it keeps its sets below `out` for as long as the run lasts.
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

    /// Ends every node that still runs, at once.
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
    command.arg(kind).arg(&plan.venue_path).arg("--managed");
    if let Some(ticks) = &plan.ticks {
        let ticks = format!("{}..{}", ticks.start, ticks.end);
        command.arg("--ticks").arg(ticks);
    }
    // A group of its own: Ctrl-C reaches this process only, which ends the others in order.
    command.process_group(0).kill_on_drop(true);
    command.stdin(Stdio::piped()).stderr(Stdio::piped());
    Ok(command)
}

/// Task: one node from its start to its end.
async fn follow(
    node: String,
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
            Some(stderr) => keep_last(&node, stderr).await,
            None => Vec::new(),
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
    let ((), said, status) = tokio::join!(reports, errors, wait);
    debug!(node, status = ?status.map(|it| it.to_string()), "node ended");
    drop(
        events
            .send(NodeEvent::Exited(Exit { node, status, said }))
            .await,
    );
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

/// Keeps the last lines for the case of failure; passes all on at once when a log was asked for, else what is not used of
/// a camera.
async fn keep_last(node: &str, stderr: impl AsyncRead + Unpin) -> Vec<String> {
    let log = std::env::var_os("RUST_LOG").is_some();
    let mut kept = VecDeque::with_capacity(KEPT_LINES);
    let mut lines = BufReader::new(stderr).lines();
    while let Ok(Some(line)) = lines.next_line().await {
        if log || line.contains(BeyondView::WORDS) {
            say(format_args!("{node}: {line}"));
        }
        if kept.len() == KEPT_LINES {
            kept.pop_front();
        }
        kept.push_back(line);
    }
    kept.into()
}
