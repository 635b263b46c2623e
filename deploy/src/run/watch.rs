//! Watches over the nodes of a run: starts them in order, shows how far they are, and ends them together.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::node::Report;
use farfield_node::process::EXIT_REFUSED;
use farfield_proto::tick::Tick;
use tokio::process::ChildStdin;
use tokio::time::{Instant, sleep_until};

use super::check::{RunPace, RunPlan};
use super::children::{Children, Exit, FUSION, NodeEvent, RINGS};
use super::follow::Follow;
use super::said::{SaidDetail, SaidLines};
use super::verdict::{NodeEnds, NodeTold, RunEnd, Sign};
use crate::signals::Signals;

/// How long the nodes may take to finish their files and leave, once they shall.
const GRACE: Duration = Duration::from_secs(10);

/// Live, an edge that has ended is started again after this.
const START_AGAIN: Duration = Duration::from_secs(1);

/// Runs all nodes to their end, with the results in `out`; `follow` hears of every tick.
///
/// # Errors
/// When a node cannot be started or watched.
pub(super) async fn watch(
    plan: &RunPlan,
    out: &Path,
    signals: &mut Signals,
    follow: &mut dyn Follow,
) -> anyhow::Result<RunEnd> {
    let detail = SaidDetail::of_environment();
    let (children, mut events) = Children::new(detail);
    let mut watch = RunWatch {
        plan,
        out,
        children,
        inputs: BTreeMap::new(),
        follow,
        detail,
        said: SaidLines::new(detail),
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
    // Of a run that has not begun: whatever its end is said to be, this came before it.
    watch.tell_early();
    // They are of no use to anybody once fusion's session is over.
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
    /// Nodes that run. A node whose input is `None` has been asked to leave.
    inputs: BTreeMap<String, Option<ChildStdin>>,
    follow: &'a mut dyn Follow,
    detail: SaidDetail,
    said: SaidLines,
    started: bool,
    last: Option<Tick>,
    interrupted: bool,
    killed: bool,
    /// When whoever still runs is killed.
    leave_by: Option<Instant>,
    /// Where fusion listens.
    endpoint: String,
    /// Live: when these viewpoints' edges are started again.
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
                    self.follow.tell(&place.told(venue, &self.endpoint));
                }
                self.start_edges()?;
            }
            NodeEvent::Report(Report::Notices(lines)) => {
                for line in lines {
                    self.follow.tell(&line);
                }
            }
            NodeEvent::Report(Report::Started { .. }) => {
                self.started = true;
                self.tell_early();
            }
            NodeEvent::Report(Report::Tick(tick)) => {
                self.last = Some(tick.tick);
                self.follow.tick(&tick);
            }
            NodeEvent::Report(Report::Links(links)) => self.follow.links(&links),
            NodeEvent::Said { node, line } => self.hear(&node, line),
            NodeEvent::Exited(exit) => self.exited(exit),
        }
        Ok(())
    }

    fn hear(&mut self, node: &str, line: String) {
        if let Some(line) = self.said.take(node, line, Instant::now()) {
            self.tell_said(&line);
        }
    }

    fn tell_early(&mut self) {
        for line in self.said.begin() {
            self.tell_said(&line);
        }
    }

    fn tell_said(&mut self, line: &str) {
        if self.detail == SaidDetail::Log || self.follow.wants(line) {
            self.follow.tell(line);
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

    /// Live, the others go on without an edge that has ended, and it is started again unless its input is
    /// wrong; false when the run must end.
    fn does_without(&mut self, exit: &Exit) -> bool {
        let others_run = self.inputs.keys().any(|node| *node != FUSION);
        let is_refused = exit.code() == Some(i32::from(EXIT_REFUSED));
        let goes_on = self.plan.pace == RunPace::Live && self.started && self.leave_by.is_none();
        if !goes_on || exit.node == FUSION || exit.code() == Some(0) || is_refused && !others_run {
            return false;
        }
        let ended = format!("{}: {}", exit.node, exit.reason());
        self.follow.tell(&ended);
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
        let told = match self.inputs.remove(&exit.node) {
            _ if self.killed => NodeTold::Killed,
            Some(Some(_)) => NodeTold::Nothing,
            _ => NodeTold::ToLeave,
        };
        let (node, last_words) = (exit.node.clone(), exit.said.clone());
        if exit.is_without_a_word() {
            exit.said = self.said.early_of(&node);
        }
        let sign = self.ends.take(exit, told);
        if sign == Sign::Well && self.detail == SaidDetail::Notices {
            // What failed as it ended is not why it did: no failure of the run says it.
            for line in last_words {
                self.hear(&node, line);
            }
        }
        if is_fusion || (sign == Sign::Bad && !self.started) {
            self.ask_all_to_leave();
        } else if sign == Sign::Bad {
            // Fusion sees it, too, and finishes its files by itself.
            self.leave_soon();
        }
    }

    /// Fusion finishes its files and tells the edges to leave.
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
