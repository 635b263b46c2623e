//! Watches the nodes of a run: starts them in order, shows their progress, and ends them together.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion_node::Report;
use farfield_node::process::{EXIT_REFUSED, LineKind, NodeError, NodeLine};
use farfield_proto::tick::Tick;
use tokio::process::ChildStdin;
use tokio::runtime::Runtime;
use tokio::time::{Instant, sleep_until};

use super::check::{RunPace, RunPlan};
use super::children::{Children, Exit, FUSION, NodeEvent, RINGS};
use super::node_lines::{LineDetail, NodeLines};
use super::progress::Follow;
use super::verdict::{LastRequest, NodeEnds, NodeOutcome, RunEnd};
use crate::signals::Signals;

/// Time for the nodes to finish their files and leave.
const GRACE: Duration = Duration::from_secs(10);

/// Live: delay before an edge that has ended is started again.
const START_AGAIN: Duration = Duration::from_secs(1);

/// Runs all nodes to their end, with the results in `out`. `follow` receives every tick.
///
/// # Errors
/// When a node cannot be started or watched.
pub(super) async fn watch(
    plan: &RunPlan,
    out: &Path,
    signals: &mut Signals,
    follow: &mut dyn Follow,
) -> anyhow::Result<RunEnd> {
    let detail = LineDetail::from_environment();
    let (children, mut events) = Children::new(detail);
    let mut watch = RunWatch {
        plan,
        out,
        children,
        inputs: BTreeMap::new(),
        follow,
        detail,
        lines: NodeLines::new(detail),
        started: false,
        last: None,
        interrupted: false,
        killed: false,
        leave_by: None,
        endpoint: String::new(),
        start_again: None,
        ends: NodeEnds::default(),
    };
    let input = watch
        .children
        .start_fusion(plan, out, watch.follow.detail())?;
    watch.inputs.insert(FUSION.to_owned(), Some(input));
    while !watch.inputs.is_empty() {
        let leave_by = watch.leave_by;
        let start_again = watch.start_again.as_ref().map(|(at, _)| *at);
        tokio::select! {
            event = events.recv() => watch.take(event.context("the nodes are out of sight")?)?,
            () = signals.next(), if !watch.interrupted => watch.interrupt(),
            () = sleep_until(leave_by.unwrap_or_else(Instant::now)), if leave_by.is_some() => {
                watch.leave_by = None;
                watch.killed = true;
                watch.children.kill();
            }
            () = sleep_until(start_again.unwrap_or_else(Instant::now)), if start_again.is_some() => {
                watch.start_those_that_ended()?;
            }
        }
    }
    // For a run that has not begun: these lines came before its end.
    watch.print_early();
    // The rings are useless once fusion's session is over.
    drop(std::fs::remove_dir_all(out.join(RINGS)));
    watch.follow.finish();
    Ok(RunEnd {
        verdict: watch.ends.verdict(watch.interrupted, watch.last),
        last: watch.last,
    })
}

struct RunWatch<'a> {
    plan: &'a RunPlan,
    /// Where the results go.
    out: &'a Path,
    children: Children,
    /// Nodes that run. `None`: the node was asked to leave.
    inputs: BTreeMap<String, Option<ChildStdin>>,
    follow: &'a mut dyn Follow,
    detail: LineDetail,
    lines: NodeLines,
    started: bool,
    last: Option<Tick>,
    interrupted: bool,
    killed: bool,
    /// When nodes that still run are killed.
    leave_by: Option<Instant>,
    /// Where fusion listens.
    endpoint: String,
    /// Live: when the edges of these viewpoints are started again.
    start_again: Option<(Instant, Vec<String>)>,
    ends: NodeEnds,
}

impl RunWatch<'_> {
    fn take(&mut self, event: NodeEvent) -> anyhow::Result<()> {
        match event {
            NodeEvent::Report(Report::Listening(endpoints)) => {
                let endpoint = endpoints.into_iter().next();
                self.endpoint = endpoint.context("fusion listens nowhere")?;
                if self.plan.pace == RunPace::Live {
                    let (place, venue) = (self.plan.place(), &self.plan.venue_path);
                    self.follow.print(&place.message(venue, &self.endpoint));
                }
                self.start_edges()?;
            }
            NodeEvent::Report(Report::Notices(lines)) => {
                for line in lines {
                    self.follow.print(&line);
                }
            }
            NodeEvent::Report(Report::Started { .. }) => {
                self.started = true;
                self.print_early();
            }
            NodeEvent::Report(Report::Tick(tick)) => {
                self.last = Some(tick.tick);
                self.follow.tick(&tick);
            }
            NodeEvent::Report(Report::Links(links)) => self.follow.links(&links),
            NodeEvent::Line { node, line } => self.receive(&node, line),
            NodeEvent::Exited(exit) => self.exited(exit),
        }
        Ok(())
    }

    fn receive(&mut self, node: &str, line: NodeLine) {
        if let Some((kind, text)) = self.lines.take(node, line, Instant::now()) {
            self.print_line(kind, &text);
        }
    }

    fn print_early(&mut self) {
        for (kind, text) in self.lines.begin() {
            self.print_line(kind, &text);
        }
    }

    fn print_line(&mut self, kind: LineKind, text: &str) {
        if self.detail == LineDetail::Log || self.follow.wants(kind) {
            self.follow.print(text);
        }
    }

    fn start_edges(&mut self) -> anyhow::Result<()> {
        for viewpoint in &self.plan.venue.viewpoints {
            self.start_edge(&viewpoint.name)?;
        }
        Ok(())
    }

    fn start_edge(&mut self, viewpoint: &str) -> anyhow::Result<()> {
        if self.leave_by.is_some() {
            return Ok(());
        }
        let input = self
            .children
            .start_edge(self.plan, self.out, viewpoint, &self.endpoint)?;
        self.inputs.insert(viewpoint.to_owned(), Some(input));
        Ok(())
    }

    fn start_those_that_ended(&mut self) -> anyhow::Result<()> {
        let ended = self.start_again.take().map(|(_, ended)| ended);
        ended
            .unwrap_or_default()
            .iter()
            .try_for_each(|viewpoint| self.start_edge(viewpoint))
    }

    /// Live, the others continue without an edge that has ended, and it is started again unless its input is wrong.
    /// False
    /// if the run must end.
    fn does_without(&mut self, exit: &Exit) -> bool {
        let others_run = self.inputs.keys().any(|node| *node != FUSION);
        let is_refused = exit.code() == Some(i32::from(EXIT_REFUSED));
        let goes_on = self.plan.pace == RunPace::Live && self.started && self.leave_by.is_none();
        if !goes_on || exit.node == FUSION || exit.code() == Some(0) || is_refused && !others_run {
            return false;
        }
        let ended = format!("{}: {}", exit.node, exit.reason());
        self.follow.print(&ended);
        if !is_refused {
            let at = Instant::now() + START_AGAIN;
            let (_, ended) = self.start_again.get_or_insert((at, Vec::new()));
            ended.push(exit.node.clone());
        }
        true
    }

    fn exited(&mut self, mut exit: Exit) {
        let is_fusion = exit.node == FUSION;
        if self.inputs.get(&exit.node).is_some_and(Option::is_some) {
            let input = self.inputs.remove(&exit.node);
            if self.does_without(&exit) {
                return;
            }
            self.inputs
                .extend(input.map(|input| (exit.node.clone(), input)));
        }
        let request = match self.inputs.remove(&exit.node) {
            _ if self.killed => LastRequest::Kill,
            Some(Some(_)) => LastRequest::Nothing,
            _ => LastRequest::Leave,
        };
        let (node, final_error) = (exit.node.clone(), exit.error.clone());
        if exit.has_no_reason() {
            exit.error = self.lines.early_lines(&node).join("\n");
        }
        let outcome = self.ends.take(exit, request);
        if outcome == NodeOutcome::Well && self.detail == LineDetail::Notices {
            // The verdict of the run does not contain an error of a node that ended well.
            let kind = LineKind::LastError;
            let text = final_error;
            self.receive(&node, NodeLine { kind, text });
        }
        if is_fusion || (outcome == NodeOutcome::Failed && !self.started) {
            self.ask_all_to_leave();
        } else if outcome == NodeOutcome::Failed {
            // Fusion sees it, too, and finishes its files itself.
            self.leave_soon();
        }
    }

    /// Fusion finishes its files and asks the edges to leave.
    fn interrupt(&mut self) {
        self.interrupted = true;
        match self.inputs.get_mut(FUSION) {
            Some(input) => *input = None,
            None => self.ask_all_to_leave(),
        }
        self.leave_soon();
    }

    fn ask_all_to_leave(&mut self) {
        for input in self.inputs.values_mut() {
            *input = None;
        }
        self.leave_soon();
    }

    fn leave_soon(&mut self) {
        self.leave_by.get_or_insert_with(|| Instant::now() + GRACE);
    }
}

/// Runtime and signals of a run. From here on Ctrl-C no longer ends the process.
pub(crate) struct Session {
    runtime: Runtime,
    signals: Signals,
}

impl Session {
    /// Starts the runtime and catches signals.
    ///
    /// # Errors
    /// When the system has no thread left, or signals cannot be caught.
    pub(crate) fn open() -> Result<Self, NodeError> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .enable_all()
            .build();
        let runtime = runtime
            .context("starting the runtime")
            .map_err(NodeError::Failed)?;
        let entered = runtime.enter();
        let signals = Signals::catch()
            .context("catching signals")
            .map_err(NodeError::Failed)?;
        drop(entered);
        Ok(Self { runtime, signals })
    }

    /// Runs all nodes of `plan` to their end, with the results in `out`. `follow` receives every tick.
    ///
    /// # Errors
    /// When a node cannot be started or watched.
    pub(crate) fn watch(
        &mut self,
        plan: &RunPlan,
        out: &Path,
        follow: &mut dyn Follow,
    ) -> Result<RunEnd, NodeError> {
        self.runtime
            .block_on(watch(plan, out, &mut self.signals, follow))
            .map_err(NodeError::Failed)
    }
}
