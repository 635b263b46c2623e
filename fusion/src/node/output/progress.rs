//! What an operator, or the process that started the node, sees of a run under way.

use std::io::Write as _;
use std::time::{Duration, Instant};

use farfield_node::clock;
use farfield_node::process::{Managed, say};
use farfield_proto::message::live::EdgeLink;
use farfield_proto::message::{PersonPose, PoseSet};
use farfield_proto::tick::Tick;
use farfield_proto::transport::endpoint::{is_any_address, port, scheme};
use serde::{Deserialize, Serialize};

use super::tally::PassedBytes;

/// One line of JSON on the standard output of a managed fusion node.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// The node listens here.
    Listening(Vec<String>),
    /// What the operator is to be told, a line each.
    Said(Vec<String>),
    /// All nodes are ready; the run goes over these ticks.
    Started {
        /// The first tick.
        from: Tick,
        /// One past the last; `None` live, when nobody has said when to end.
        to: Option<Tick>,
    },
    /// A tick is done.
    Tick(Progress),
    /// Live, once a second: how the edges are heard.
    Links(LinkProgress),
}

/// How a live run is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinkProgress {
    /// From the capture of pictures to the poses made of them, in the last second, microseconds: median
    /// and 99th percentile.
    pub delay_us: Option<(u32, u32)>,
    /// The edges, in the order of the venue's viewpoints.
    pub edges: Vec<EdgeLink>,
}

/// How far a run is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// The tick that is done.
    pub tick: Tick,
    /// Persons at that tick.
    pub persons: usize,
    /// Payload bytes since the start, over all links.
    pub bytes: u64,
    /// Those of them that the edges have sent: patches and sightings.
    #[serde(default)]
    pub edge_bytes: u64,
    /// Where the persons are, when the node was started with `--report-bodies`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<Body>,
}

/// One person of a tick, as it looks to a live listener.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// The id.
    pub person: u32,
    /// The 29 joints, world, metres, in the order of the skeletal model.
    pub joints_m: Vec<[f32; 3]>,
}

impl From<&PersonPose> for Body {
    fn from(pose: &PersonPose) -> Self {
        Self {
            person: pose.person.0,
            joints_m: pose.joints_m.clone(),
        }
    }
}

/// What a managed node says of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::node) enum Detail {
    /// How many persons there are.
    Counts,
    /// Where they are, too.
    Bodies,
}

/// Where fusion listens, in words: an endpoint of all addresses that gives none is reached from this machine alone.
fn places(asked: &[String], endpoints: Vec<String>) -> String {
    let is_given = |asked: &str| {
        let mut endpoints = endpoints.iter();
        endpoints.any(|it| (scheme(it), port(it)) == (scheme(asked), port(asked)))
    };
    let unseen = asked
        .iter()
        .filter(|it| is_any_address(it) && !is_given(it));
    let unseen: Vec<String> = unseen
        .map(|it| format!("{it}: this machine alone, no other address is up"))
        .collect();
    endpoints
        .into_iter()
        .chain(unseen)
        .collect::<Vec<_>>()
        .join(", ")
}

/// How often a node started by hand says how far it is.
const EVERY: Duration = Duration::from_secs(5);

/// Reports to whoever started the node.
pub(in crate::node) struct Reporter {
    managed: Managed,
    detail: Detail,
    last: Option<Instant>,
    delay_us: Option<(u32, u32)>,
}

impl Reporter {
    pub(in crate::node) fn new(managed: Managed, detail: Detail) -> Self {
        Self {
            managed,
            detail,
            last: None,
            delay_us: None,
        }
    }

    /// Fusion listens at `endpoints`, because it was `asked` to.
    pub(in crate::node) fn listening(&self, asked: &[String], endpoints: Vec<String>) {
        match self.managed {
            Managed::Yes => send(&Report::Listening(endpoints)),
            Managed::No => say(format_args!(
                "fusion listens on {}",
                places(asked, endpoints)
            )),
        }
    }

    /// Lines for the operator.
    pub(in crate::node) fn said(&self, lines: &[String]) {
        match self.managed {
            Managed::Yes if lines.is_empty() => {}
            Managed::Yes => send(&Report::Said(lines.to_owned())),
            Managed::No => lines.iter().for_each(|line| say(format_args!("{line}"))),
        }
    }

    pub(in crate::node) fn waiting(&self, missing: &[&str]) {
        if self.managed == Managed::No {
            say(format_args!("waiting for {}", missing.join(", ")));
        }
    }

    /// The ticks begin; `to` is one past the last, if there is one.
    pub(in crate::node) fn started(&self, from: Tick, to: Option<Tick>) {
        match (self.managed, to) {
            (Managed::Yes, to) => send(&Report::Started { from, to }),
            (Managed::No, Some(to)) => say(format_args!("the run begins: ticks {from}..{to}")),
            (Managed::No, None) => say(format_args!("the run begins: tick {from}")),
        }
    }

    /// Live, once a second: the delay of the poses, and how the edges are heard.
    pub(in crate::node) fn links(&mut self, delay_us: Option<(u32, u32)>, edges: Vec<EdgeLink>) {
        if self.managed == Managed::Yes {
            send(&Report::Links(LinkProgress { delay_us, edges }));
        } else {
            self.delay_us = delay_us;
        }
    }

    /// A tick is done, after which `bytes` of payload have passed over all links.
    pub(in crate::node) fn tick(&mut self, poses: &PoseSet, bytes: PassedBytes) {
        if self.managed == Managed::Yes {
            let bodies = match self.detail {
                Detail::Counts => Vec::new(),
                Detail::Bodies => poses.persons.iter().map(Body::from).collect(),
            };
            send(&Report::Tick(Progress {
                tick: poses.tick,
                persons: poses.persons.len(),
                bytes: bytes.total,
                edge_bytes: bytes.from_edges,
                bodies,
            }));
            return;
        }
        let now = clock::now();
        if self
            .last
            .is_none_or(|last| now.duration_since(last) >= EVERY)
        {
            self.last = Some(now);
            let delay = self.delay_us.map_or_else(String::new, |(p50_us, p99_us)| {
                let [p50, p99] = [p50_us, p99_us].map(|us| f64::from(us) / 1e3);
                format!(", delay {p50:.0} ms (99 %: {p99:.0} ms)")
            });
            say(format_args!(
                "tick {}, {} persons, {} kB{delay}",
                poses.tick,
                poses.persons.len(),
                bytes.total / 1000
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Symptom: on a machine whose network was off, "fusion listens on " and nothing more.
    #[test]
    fn an_endpoint_of_all_addresses_without_any_is_named_with_who_reaches_it() {
        let listening = |asked: &[&str], given: &[&str]| {
            let [asked, given] = [asked, given].map(|all| all.iter().map(|it| (*it).to_owned()));
            places(&asked.collect::<Vec<_>>(), given.collect())
        };
        assert_eq!(
            listening(&["tcp/[::]:7511"], &[]),
            "tcp/[::]:7511: this machine alone, no other address is up"
        );
        assert_eq!(
            listening(
                &["quic/0.0.0.0:7447", "tcp/127.0.0.1:1"],
                &["tcp/127.0.0.1:1"]
            ),
            "tcp/127.0.0.1:1, quic/0.0.0.0:7447: this machine alone, no other address is up"
        );
        assert_eq!(
            listening(&["quic/0.0.0.0:7447"], &["quic/10.0.0.7:7447"]),
            "quic/10.0.0.7:7447"
        );
    }
}
