//! Watches over the nodes of a run: starts them in order, shows how far they are, and ends them together.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::node::Report;
use farfield_proto::tick::Tick;
use tokio::process::ChildStdin;
use tokio::time::{Instant, sleep_until};

use super::check::Plan;
use super::children::{Children, Event, Exit, FUSION};
use super::follow::Follow;
use super::signals::Signals;
use super::verdict::{End, Ends, Sign, Told};

/// How long the nodes may take to finish their files and leave, once they shall.
const GRACE: Duration = Duration::from_secs(10);

/// Runs all nodes to their end, with the results in `out`; `follow` hears of every tick.
///
/// # Errors
/// When a node cannot be started or watched.
pub(super) async fn watch(
    plan: &Plan,
    out: &Path,
    signals: &mut Signals,
    follow: &mut dyn Follow,
) -> anyhow::Result<End> {
    let (children, mut events) = Children::new();
    let mut watch = Watch {
        plan,
        children,
        inputs: BTreeMap::new(),
        follow,
        started: false,
        last: None,
        interrupted: false,
        killed: false,
        leave_by: None,
        ends: Ends::default(),
    };
    let input = watch
        .children
        .start_fusion(plan, out, watch.follow.detail())?;
    watch.inputs.insert(FUSION.to_owned(), Some(input));
    while !watch.inputs.is_empty() {
        let leave_by = watch.leave_by;
        tokio::select! {
            event = events.recv() => watch.take(event.context("the nodes are out of sight")?)?,
            () = signals.next(), if !watch.interrupted => watch.interrupt(),
            () = sleep_until(leave_by.unwrap_or_else(Instant::now)), if leave_by.is_some() => {
                watch.leave_by = None;
                watch.killed = true;
                watch.children.kill();
            }
        }
    }
    watch.follow.finish();
    Ok(End {
        verdict: watch.ends.verdict(watch.interrupted, watch.last),
        last: watch.last,
    })
}

struct Watch<'a> {
    plan: &'a Plan,
    children: Children,
    /// Nodes that run. A node whose input is `None` has been asked to leave.
    inputs: BTreeMap<String, Option<ChildStdin>>,
    follow: &'a mut dyn Follow,
    started: bool,
    last: Option<Tick>,
    interrupted: bool,
    killed: bool,
    /// When whoever still runs is killed.
    leave_by: Option<Instant>,
    ends: Ends,
}

impl Watch<'_> {
    fn take(&mut self, event: Event) -> anyhow::Result<()> {
        match event {
            Event::Report(Report::Listening(endpoints)) => {
                let endpoint = endpoints.first().context("fusion listens nowhere")?;
                self.start_edges(endpoint)?;
            }
            Event::Report(Report::Started { .. }) => self.started = true,
            Event::Report(Report::Tick(tick)) => {
                self.last = Some(tick.tick);
                self.follow.tick(&tick);
            }
            Event::Exited(exit) => self.exited(exit),
        }
        Ok(())
    }

    fn start_edges(&mut self, endpoint: &str) -> anyhow::Result<()> {
        if self.leave_by.is_some() {
            return Ok(());
        }
        for viewpoint in &self.plan.venue.viewpoints {
            let input = self
                .children
                .start_edge(self.plan, &viewpoint.name, endpoint)?;
            self.inputs.insert(viewpoint.name.clone(), Some(input));
        }
        Ok(())
    }

    fn exited(&mut self, exit: Exit) {
        let is_fusion = exit.node == FUSION;
        let told = match self.inputs.remove(&exit.node) {
            _ if self.killed => Told::Killed,
            Some(Some(_)) => Told::Nothing,
            _ => Told::ToLeave,
        };
        let sign = self.ends.take(exit, told);
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
