//! What an operator, or the process that started the node, sees of a run under way.

use std::io::Write as _;
use std::time::{Duration, Instant};

use farfield_proto::tick::Tick;
use serde::{Deserialize, Serialize};

use super::clock;
use super::process::{Managed, say};

/// One line of JSON on the standard output of a managed fusion node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// The node listens here.
    Listening(Vec<String>),
    /// All nodes are ready; the run goes over these ticks.
    Started {
        /// The first tick.
        from: Tick,
        /// One past the last.
        to: Tick,
    },
    /// A tick is done.
    Tick(Progress),
}

/// How far a run is.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Progress {
    /// The tick that is done.
    pub tick: Tick,
    /// Persons at that tick.
    pub persons: usize,
    /// Payload bytes since the start, over all links.
    pub bytes: u64,
}

/// How often a node started by hand says how far it is.
const EVERY: Duration = Duration::from_secs(5);

/// Reports to whoever started the node.
pub(super) struct Reporter {
    managed: Managed,
    last: Option<Instant>,
}

impl Reporter {
    pub(super) fn new(managed: Managed) -> Self {
        Self {
            managed,
            last: None,
        }
    }

    pub(super) fn listening(&self, endpoints: Vec<String>) {
        match self.managed {
            Managed::Yes => send(&Report::Listening(endpoints)),
            Managed::No => say(format_args!("fusion listens on {}", endpoints.join(", "))),
        }
    }

    pub(super) fn waiting(&self, missing: &[&str]) {
        if self.managed == Managed::No {
            say(format_args!("waiting for {}", missing.join(", ")));
        }
    }

    pub(super) fn started(&self, from: Tick, to: Tick) {
        match self.managed {
            Managed::Yes => send(&Report::Started { from, to }),
            Managed::No => say(format_args!("all viewpoints are ready: ticks {from}..{to}")),
        }
    }

    pub(super) fn tick(&mut self, progress: &Progress) {
        if self.managed == Managed::Yes {
            send(&Report::Tick(progress.clone()));
            return;
        }
        let now = clock::now();
        if self
            .last
            .is_none_or(|last| now.duration_since(last) >= EVERY)
        {
            self.last = Some(now);
            say(format_args!(
                "tick {}, {} persons, {} kB",
                progress.tick,
                progress.persons,
                progress.bytes / 1000
            ));
        }
    }
}

fn send(report: &Report) {
    // A parent that has gone reads nothing more; its closed standard input ends the node.
    if let Ok(line) = serde_json::to_string(report) {
        drop(writeln!(std::io::stdout().lock(), "{line}"));
    }
}
