//! The nodes as child processes: each in a group of its own, leaving when its standard input closes.

use std::ffi::OsString;
use std::os::unix::process::ExitStatusExt as _;
use std::path::Path;
use std::process::{ExitStatus, Stdio};

use anyhow::Context as _;
use farfield_fusion::node::{OWN_RECORDING, Report};
use tokio::io::{AsyncBufReadExt as _, AsyncRead, BufReader};
use tokio::process::{Child, ChildStdin, Command};
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::debug;

use super::check::{RunPace, RunPlan};
use super::follow::ProgressDetail;
use super::said::{LastWords, SaidDetail};
use crate::listeners::page_token;

/// Folder in that of the results for what edges keep on disk while a run lasts.
pub(super) const RINGS: &str = "ring";
/// Fusion's name among the nodes.
pub(super) const FUSION: &str = "fusion";
/// Events that wait for the loop; the pipes hold back the rest.
const QUEUE: usize = 256;

/// What the nodes do.
#[derive(Debug)]
pub(super) enum NodeEvent {
    /// Fusion reports.
    Report(Report),
    /// A node says a line on its standard error.
    Said { node: String, line: String },
    /// A node has ended.
    Exited(Exit),
}

/// The end of a node.
#[derive(Debug)]
pub(super) struct Exit {
    pub(super) node: String,
    pub(super) status: Option<ExitStatus>,
    /// Its last words: the error with which it ended, which of a log was told, too; or, for want of any, what it said before the
    /// run began, which is told as well.
    pub(super) said: Vec<String>,
    /// The last error that it had said before and lived on for a while. It was told.
    pub(super) outlived: Vec<String>,
}

impl Exit {
    pub(super) fn code(&self) -> Option<i32> {
        self.status.and_then(|status| status.code())
    }

    /// Whether it has given no reason, and was not killed either.
    pub(super) fn is_without_a_word(&self) -> bool {
        self.said.is_empty() && self.outlived.is_empty() && self.code().is_some()
    }

    /// What went wrong, in the node's own words where it had some.
    pub(super) fn reason(&self) -> String {
        // Whoever was killed did not end by an error of long ago.
        let takes_long = self.said.is_empty() && self.code().is_some();
        let said = if takes_long {
            &self.outlived
        } else {
            &self.said
        };
        let said = said.join("\n");
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
    said: SaidDetail,
}

impl Children {
    /// Nothing runs yet; events of what will, and says as much as `said`, come out at the other end.
    pub(super) fn new(said: SaidDetail) -> (Self, mpsc::Receiver<NodeEvent>) {
        let (events, received) = mpsc::channel(QUEUE);
        (
            Self {
                tasks: TaskTracker::new(),
                kill: CancellationToken::new(),
                events,
                said,
            },
            received,
        )
    }

    /// Starts fusion at its place on this machine, with its results in `out`.
    pub(super) fn start_fusion(
        &self,
        plan: &RunPlan,
        out: &Path,
        detail: ProgressDetail,
    ) -> anyhow::Result<ChildStdin> {
        let mut command = node(plan, FUSION)?;
        command.args(plan.place().words()).arg("--out").arg(out);
        if plan.pace == RunPace::Live {
            command.arg("--live");
        }
        if let Some(record) = &plan.record {
            let own = || out.join(OWN_RECORDING);
            // In one word: whatever it is called, it is the value.
            let mut word = OsString::from("--record=");
            word.push(record.clone().unwrap_or_else(own));
            command.arg(word);
        }
        if detail == ProgressDetail::Bodies {
            command.arg("--report-bodies");
        }
        command.args(plan.listeners.words());
        command.envs(plan.listeners.page_token.as_ref().map(page_token::for_node));
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
            (name.to_owned(), self.said),
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
    (node, said): (String, SaidDetail),
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
            Some(stderr) => pass_on(&node, stderr, said, &events).await,
            None => [Vec::new(), Vec::new()],
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
    let ((), [said, outlived], status) = tokio::join!(reports, errors, wait);
    debug!(node, status = ?status.map(|it| it.to_string()), "node ended");
    let exit = Exit {
        node,
        status,
        said,
        outlived,
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

/// Passes on what a node says, but for the last words with which it ends: those, and the last error that it had outlived.
async fn pass_on(
    node: &str,
    stderr: impl AsyncRead + Unpin,
    said: SaidDetail,
    events: &mpsc::Sender<NodeEvent>,
) -> [Vec<String>; 2] {
    let event = |line| NodeEvent::Said {
        node: node.to_owned(),
        line,
    };
    let mut last = LastWords::new(said);
    let mut lines = BufReader::new(stderr).lines();
    loop {
        let outlived_at = last.outlived_at();
        let line = tokio::select! {
            line = lines.next_line() => line,
            () = sleep_until(outlived_at.unwrap_or_else(Instant::now)), if outlived_at.is_some() => {
                for line in last.outlived() {
                    drop(events.send(event(line)).await);
                }
                continue;
            }
        };
        let Ok(Some(line)) = line else {
            return last.at_its_end();
        };
        if let Some(line) = last.take(line, Instant::now()) {
            drop(events.send(event(line)).await);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn what_a_node_says_comes_at_once_and_the_error_with_which_it_ends_at_its_end() {
        let stderr = "the disk is full\nerror: poses.jsonl:\n  no space left\n";
        let (events, mut received) = mpsc::channel(QUEUE);
        let [last, outlived] =
            pass_on("fusion", stderr.as_bytes(), SaidDetail::Notices, &events).await;
        assert_eq!(last, ["error: poses.jsonl:", "  no space left"]);
        assert!(outlived.is_empty());
        drop(events);
        let Some(NodeEvent::Said { node, line }) = received.recv().await else {
            panic!("nothing was said");
        };
        assert_eq!([node, line], ["fusion", "the disk is full"]);
        assert!(received.recv().await.is_none());
    }

    #[test]
    fn a_node_that_takes_long_to_end_does_so_by_its_last_error_unless_it_is_killed() {
        let ended = |raw: i32| Exit {
            node: FUSION.to_owned(),
            status: Some(ExitStatus::from_raw(raw)),
            said: Vec::new(),
            outlived: vec!["error: no space left".to_owned()],
        };
        assert_eq!(ended(1 << 8).reason(), "no space left");
        assert_eq!(ended(9).reason(), "killed by signal 9");
    }
}
