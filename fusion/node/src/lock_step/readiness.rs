//! Readiness of the edges, and whether all nodes have the same files. Without I/O: statuses in, an answer out.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use farfield_proto::message::Status;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::venue::same_files::{OtherFile, OwnFiles};

/// Reason why a run cannot begin.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum NotReady {
    /// An edge has another file than fusion.
    #[error(
        "viewpoint {viewpoint} holds another {} than fusion: its fingerprint there is {}, here {}; start that edge with --from-fusion to fetch it, or copy the same file to both",
        other.what, other.theirs, other.ours
    )]
    OtherFile { viewpoint: String, other: OtherFile },
    /// Two edges run different networks, whose maps are not comparable.
    #[error(
        "viewpoints {first} and {second} run different networks: {first_hash} and {second_hash}"
    )]
    OtherNetwork {
        first: String,
        first_hash: String,
        second: String,
        second_hash: String,
    },
    /// Two running edges have the same name.
    #[error("two nodes have the name {0}")]
    TwoOfAName(String),
    /// A node is not in the venue.
    #[error("a node named {0} is not a viewpoint of the venue")]
    UnknownNode(String),
    /// The sources do not contain the requested ticks.
    #[error(
        "viewpoint {viewpoint} has ticks {from}..{to}, but {asked_from}..{asked_to} are requested"
    )]
    TicksOutside {
        viewpoint: String,
        from: Tick,
        to: Tick,
        asked_from: Tick,
        asked_to: Tick,
    },
    /// The sources have different ticks, and no ticks are requested.
    #[error(
        "viewpoint {first} has ticks {first_from}..{first_to}, viewpoint {second} {second_from}..{second_to}; use --ticks A..B inside both"
    )]
    OtherTicks {
        first: String,
        first_from: Tick,
        first_to: Tick,
        second: String,
        second_from: Tick,
        second_to: Tick,
    },
    /// All sources are live.
    #[error("no viewpoint has a recorded source, so lock-step needs --ticks A..B")]
    NoTicks,
}

/// The state at the start of a run.
#[derive(Debug)]
pub(crate) struct Start {
    /// The ticks of the run.
    pub(crate) ticks: Range<Tick>,
    /// The status of every edge, by name.
    pub(crate) edges: Vec<Status>,
}

/// Collects a ready status of every viewpoint.
#[derive(Debug)]
pub(crate) struct Readiness {
    venue_hash: String,
    calibration_hash: String,
    /// Prefix of the fingerprint of an edge's networks, if known.
    models: Option<String>,
    requested: Option<Range<Tick>>,
    nodes: BTreeMap<String, Option<Status>>,
    processes: BTreeMap<String, Processes>,
}

/// The processes that used one name. A restarted edge may send before the departure of the old one arrives. If the old process
/// sends again, it never left.
#[derive(Debug)]
struct Processes {
    current: u64,
    former: BTreeSet<u64>,
}

/// Whether a status counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ProcessState {
    Known,
    /// The first status of a process that replaces another. If both run, the other sends before the next one.
    Follower,
}

impl Readiness {
    /// Waits for the viewpoints of `venue`; `requested` are the ticks, if any were requested.
    pub(crate) fn new(venue: &Venue, requested: Option<Range<Tick>>) -> Self {
        let nodes = venue
            .viewpoints
            .iter()
            .map(|v| (v.name.clone(), None))
            .collect();
        Self {
            venue_hash: venue.hashes.venue.clone(),
            calibration_hash: venue.hashes.calibration.clone(),
            models: None,
            requested,
            nodes,
            processes: BTreeMap::new(),
        }
    }

    /// From now on refuses edges whose network fingerprint does not begin with `models`, if given.
    pub(crate) fn expect_models(&mut self, models: Option<&str>) {
        self.models = models.map(str::to_owned);
    }

    /// Adds the status of a node.
    pub(crate) fn receive(&mut self, status: &Status) -> Result<(), NotReady> {
        let viewpoint = status.node.clone();
        if !self.nodes.contains_key(&viewpoint) {
            return Err(NotReady::UnknownNode(viewpoint));
        }
        let own = OwnFiles {
            venue: &self.venue_hash,
            calibration: &self.calibration_hash,
            networks: self.models.as_deref(),
        };
        if let Some(other) = own.other_file(status) {
            return Err(NotReady::OtherFile { viewpoint, other });
        }
        self.check_network(status)?;
        self.check_ticks(status)?;
        let is_counted = self.check_process(status)? == ProcessState::Known && status.ready;
        if is_counted || self.is_stored_of_another(status) {
            self.nodes
                .insert(viewpoint, is_counted.then(|| status.clone()));
        }
        Ok(())
    }

    /// Removes a node that left before the start.
    pub(crate) fn forget(&mut self, node: &str) {
        if let Some(status) = self.nodes.get_mut(node) {
            *status = None;
        }
    }

    /// The viewpoints that are not ready yet.
    pub(crate) fn missing(&self) -> Vec<&str> {
        self.nodes
            .iter()
            .filter(|(_, status)| status.is_none())
            .map(|(name, _)| name.as_str())
            .collect()
    }

    /// The statuses of the ready nodes.
    pub(crate) fn ready(&self) -> impl Iterator<Item = &Status> {
        self.nodes.values().flatten()
    }

    /// The ticks of the run; `None` while a node is missing.
    pub(crate) fn ticks(&self) -> Result<Option<Range<Tick>>, NotReady> {
        if !self.missing().is_empty() {
            return Ok(None);
        }
        if let Some(requested) = &self.requested {
            return Ok(Some(requested.clone()));
        }
        let mut recorded = self
            .ready()
            .filter_map(|s| s.ticks.map(|ticks| (&s.node, ticks)));
        let (first, [from, to]) = recorded.next().ok_or(NotReady::NoTicks)?;
        if let Some((second, [second_from, second_to])) =
            recorded.find(|(_, ticks)| *ticks != [from, to])
        {
            let (first, second) = (first.clone(), second.clone());
            return Err(NotReady::OtherTicks {
                first,
                first_from: from,
                first_to: to,
                second,
                second_from,
                second_to,
            });
        }
        Ok(Some(from..to))
    }

    fn check_process(&mut self, status: &Status) -> Result<ProcessState, NotReady> {
        let processes = self
            .processes
            .entry(status.node.clone())
            .or_insert_with(|| Processes {
                current: status.process,
                former: BTreeSet::new(),
            });
        if processes.current == status.process {
            return Ok(ProcessState::Known);
        }
        if processes.former.contains(&status.process) {
            return Err(NotReady::TwoOfAName(status.node.clone()));
        }
        processes.former.insert(processes.current);
        processes.current = status.process;
        Ok(ProcessState::Follower)
    }

    fn is_stored_of_another(&self, status: &Status) -> bool {
        let stored = self.nodes.get(&status.node).and_then(Option::as_ref);
        stored.is_some_and(|stored| stored.process != status.process)
    }

    fn check_network(&self, status: &Status) -> Result<(), NotReady> {
        let other = self.ready().find(|s| {
            // A viewpoint of keypoint files runs no network, and matches any.
            s.node != status.node
                && !s.network_hash.is_empty()
                && !status.network_hash.is_empty()
                && s.network_hash != status.network_hash
        });
        other.map_or(Ok(()), |other| {
            Err(NotReady::OtherNetwork {
                first: other.node.clone(),
                first_hash: other.network_hash.clone(),
                second: status.node.clone(),
                second_hash: status.network_hash.clone(),
            })
        })
    }

    fn check_ticks(&self, status: &Status) -> Result<(), NotReady> {
        let (Some(requested), Some([from, to])) = (&self.requested, status.ticks) else {
            return Ok(());
        };
        if requested.start >= from && requested.end <= to {
            return Ok(());
        }
        let viewpoint = status.node.clone();
        Err(NotReady::TicksOutside {
            viewpoint,
            from,
            to,
            asked_from: requested.start,
            asked_to: requested.end,
        })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use farfield_proto::message::health::NodeHealth;

    pub(in crate::lock_step) fn readiness(requested: Option<Range<Tick>>) -> Readiness {
        let nodes = [("a".to_owned(), None), ("b".to_owned(), None)].into();
        Readiness {
            venue_hash: "v1".to_owned(),
            calibration_hash: "c1".to_owned(),
            models: None,
            requested,
            nodes,
            processes: BTreeMap::new(),
        }
    }

    fn status(node: &str) -> Status {
        Status {
            node: node.to_owned(),
            process: 1,
            viewpoint: None,
            release: String::new(),
            ready: true,
            venue_hash: "v1".to_owned(),
            calibration_hash: "c1".to_owned(),
            network_hash: "n1".to_owned(),
            backend: "tract".to_owned(),
            ticks: Some([Tick(0), Tick(100)]),
            tick: None,
            unreadable: 0,
            failure: None,
            stages: Vec::new(),
            live: None,
            health: NodeHealth::default(),
            agreement: Vec::new(),
        }
    }

    #[test]
    fn an_edge_with_another_network_is_refused_by_name() {
        let mut readiness = readiness(None);
        readiness.expect_models(Some("n1+d1"));
        let mut same = status("a");
        same.network_hash = "n1+d1+onnxruntime".to_owned();
        readiness.receive(&same).unwrap();
        let mut other = status("b");
        other.network_hash = "n2+d1+onnxruntime".to_owned();
        let text = readiness.receive(&other).unwrap_err().to_string();
        assert!(text.contains("viewpoint b"), "{text}");
        assert!(text.contains("--from-fusion"), "{text}");
        // Keypoint files need no network.
        other.network_hash = String::new();
        readiness.receive(&other).unwrap();
    }

    #[test]
    fn the_run_begins_when_every_viewpoint_is_ready() {
        let mut readiness = readiness(None);
        readiness.receive(&status("a")).unwrap();
        assert_eq!(readiness.ticks(), Ok(None));
        readiness
            .receive(&Status {
                ready: false,
                ..status("b")
            })
            .unwrap();
        assert_eq!(readiness.missing(), ["b"]);
        readiness.receive(&status("b")).unwrap();
        assert_eq!(readiness.ticks(), Ok(Some(Tick(0)..Tick(100))));
        readiness.forget("a");
        assert_eq!(readiness.missing(), ["a"]);
    }

    #[test]
    fn two_edges_with_one_name_are_refused_but_one_may_restart() {
        let mut readiness = readiness(None);
        let second = Status {
            process: 2,
            ..status("a")
        };
        readiness.receive(&status("a")).unwrap();
        readiness.receive(&status("b")).unwrap();
        readiness.receive(&second).unwrap();
        assert_eq!(readiness.missing(), ["a"], "the first may still run");
        readiness.receive(&second).unwrap();
        assert!(readiness.missing().is_empty());
        let error = readiness.receive(&status("a")).unwrap_err();
        assert_eq!(error, NotReady::TwoOfAName("a".to_owned()));
    }

    #[test]
    fn another_calibration_is_refused_with_viewpoint_and_file() {
        let error = readiness(None)
            .receive(&Status {
                calibration_hash: "c2".to_owned(),
                ..status("b")
            })
            .unwrap_err();
        let NotReady::OtherFile { viewpoint, other } = error else {
            panic!("{error}");
        };
        assert_eq!((viewpoint.as_str(), other.what), ("b", "calibration"));
        assert_eq!((other.theirs.as_str(), other.ours.as_str()), ("c2", "c1"));
    }

    #[test]
    fn different_networks_are_refused_but_keypoint_files_match_any() {
        let mut readiness = readiness(None);
        readiness
            .receive(&Status {
                network_hash: String::new(),
                ..status("a")
            })
            .unwrap();
        readiness.receive(&status("b")).unwrap();
        let error = readiness
            .receive(&Status {
                network_hash: "n2".to_owned(),
                ..status("a")
            })
            .unwrap_err();
        assert!(matches!(error, NotReady::OtherNetwork { .. }));
    }

    #[test]
    fn sources_of_different_lengths_need_ticks_inside_all() {
        let shorter = Status {
            ticks: Some([Tick(0), Tick(90)]),
            ..status("b")
        };
        let mut open = readiness(None);
        open.receive(&status("a")).unwrap();
        open.receive(&shorter).unwrap();
        assert!(matches!(open.ticks(), Err(NotReady::OtherTicks { .. })));
        let mut requested = readiness(Some(Tick(10)..Tick(60)));
        requested.receive(&status("a")).unwrap();
        requested.receive(&shorter).unwrap();
        assert_eq!(requested.ticks(), Ok(Some(Tick(10)..Tick(60))));
        let mut outside = readiness(Some(Tick(10)..Tick(95)));
        assert!(outside.receive(&shorter).is_err());
    }
}
