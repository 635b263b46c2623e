//! Progress reports of a run, for the operator or the parent process.

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
    /// Lines for the operator.
    #[serde(rename = "said")]
    Notices(Vec<String>),
    /// All nodes are ready; the run goes over these ticks.
    Started {
        /// The first tick.
        from: Tick,
        /// One past the last; `None` in a live run without an end.
        to: Option<Tick>,
    },
    /// A tick is finished.
    Tick(Progress),
    /// The state of the edges' links, once a second in a live run.
    Links(LinkProgress),
}

/// State of a live run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LinkProgress {
    /// Delay from the capture of pictures to their poses in the last second, microseconds: median and 99th percentile.
    pub delay_us: Option<(u32, u32)>,
    /// The edges, in the order of the venue's viewpoints.
    pub edges: Vec<EdgeLink>,
}

/// Progress of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// The finished tick.
    pub tick: Tick,
    /// Persons at that tick.
    pub persons: usize,
    /// Payload bytes since the start, over all links.
    pub bytes: u64,
    /// Of these, bytes sent by the edges: patches and sightings.
    #[serde(default)]
    pub edge_bytes: u64,
    /// Positions of the persons, with `--report-bodies`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bodies: Vec<Body>,
}

/// One person of a tick, as a live client gets it.
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

/// Detail of a managed node's report on a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Detail {
    /// The number of persons.
    Counts,
    /// Their positions as well.
    Bodies,
}

/// The open endpoints in words. A requested endpoint of all addresses that yields none is reachable from this machine only.
fn places(requested: &[String], endpoints: Vec<String>) -> String {
    let is_open = |requested: &str| {
        let mut endpoints = endpoints.iter();
        endpoints.any(|it| (scheme(it), port(it)) == (scheme(requested), port(requested)))
    };
    let local = requested
        .iter()
        .filter(|it| is_any_address(it) && !is_open(it));
    let local: Vec<String> = local
        .map(|it| format!("{it}: this machine only, no other address is up"))
        .collect();
    endpoints
        .into_iter()
        .chain(local)
        .collect::<Vec<_>>()
        .join(", ")
}

/// Interval of the reports of a node started by hand.
const EVERY: Duration = Duration::from_secs(5);

/// Reports to the operator or to the parent process.
pub(crate) struct Reporter {
    managed: Managed,
    detail: Detail,
    last: Option<Instant>,
    delay_us: Option<(u32, u32)>,
}

impl Reporter {
    pub(crate) fn new(managed: Managed, detail: Detail) -> Self {
        Self {
            managed,
            detail,
            last: None,
            delay_us: None,
        }
    }

    /// Reports the open `endpoints`, given the `requested` ones.
    pub(crate) fn listening(&self, requested: &[String], endpoints: Vec<String>) {
        match self.managed {
            Managed::Yes => send(&Report::Listening(endpoints)),
            Managed::No => say(format_args!(
                "fusion listens on {}",
                places(requested, endpoints)
            )),
        }
    }

    /// Prints lines for the operator.
    pub(crate) fn notices(&self, lines: &[String]) {
        match self.managed {
            Managed::Yes if lines.is_empty() => {}
            Managed::Yes => send(&Report::Notices(lines.to_owned())),
            Managed::No => lines.iter().for_each(|line| say(format_args!("{line}"))),
        }
    }

    pub(crate) fn waiting(&self, missing: &[&str]) {
        if self.managed == Managed::No {
            say(format_args!("waiting for {}", missing.join(", ")));
        }
    }

    /// Reports the first tick; `to` is one past the last, if there is one.
    pub(crate) fn started(&self, from: Tick, to: Option<Tick>) {
        match (self.managed, to) {
            (Managed::Yes, to) => send(&Report::Started { from, to }),
            (Managed::No, Some(to)) => say(format_args!("the run begins: ticks {from}..{to}")),
            (Managed::No, None) => say(format_args!("the run begins: tick {from}")),
        }
    }

    /// Reports the delay of the poses and the edges' links, once a second in a live run.
    pub(crate) fn links(&mut self, delay_us: Option<(u32, u32)>, edges: Vec<EdgeLink>) {
        if self.managed == Managed::Yes {
            send(&Report::Links(LinkProgress { delay_us, edges }));
        } else {
            self.delay_us = delay_us;
        }
    }

    /// Reports a finished tick; `bytes` is the payload of all links so far.
    pub(crate) fn tick(&mut self, poses: &PoseSet, bytes: PassedBytes) {
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
    // A parent that has ended reads no more; its closed standard input ends this node.
    if let Ok(line) = serde_json::to_string(report) {
        drop(writeln!(std::io::stdout().lock(), "{line}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Symptom: on a machine without a network, "fusion listens on " and no address.
    #[test]
    fn an_endpoint_without_addresses_is_reported_as_local() {
        let listening = |requested: &[&str], open: &[&str]| {
            let [requested, open] =
                [requested, open].map(|all| all.iter().map(|it| (*it).to_owned()));
            places(&requested.collect::<Vec<_>>(), open.collect())
        };
        assert_eq!(
            listening(&["tcp/[::]:7511"], &[]),
            "tcp/[::]:7511: this machine only, no other address is up"
        );
        assert_eq!(
            listening(
                &["quic/0.0.0.0:7447", "tcp/127.0.0.1:1"],
                &["tcp/127.0.0.1:1"]
            ),
            "tcp/127.0.0.1:1, quic/0.0.0.0:7447: this machine only, no other address is up"
        );
        assert_eq!(
            listening(&["quic/0.0.0.0:7447"], &["quic/10.0.0.7:7447"]),
            "quic/10.0.0.7:7447"
        );
    }
}
