//! Verdict on a run from the ends of its nodes: how it ended, and which node caused a failure.

use anyhow::anyhow;
use farfield_node::process::{EXIT_INTERRUPTED, EXIT_REFUSED, NodeError};
use farfield_proto::tick::Tick;

use super::children::{Exit, FUSION};

/// How a run ended.
#[derive(Debug)]
pub(crate) enum RunVerdict {
    /// Fusion has worked on every tick.
    Done,
    /// The run was asked to stop.
    Interrupted,
    Failed(NodeError),
}

/// The end of a run.
#[derive(Debug)]
pub(crate) struct RunEnd {
    pub(crate) verdict: RunVerdict,
    /// The last tick that fusion has reported.
    pub(crate) last: Option<Tick>,
}

/// The ends of the nodes so far.
#[derive(Debug, Default)]
pub(super) struct NodeEnds {
    /// Fusion has ended with success.
    fusion_done: bool,
    /// Nodes that failed and were not killed by the run, in order.
    failures: Vec<Exit>,
}

/// The last request of the run to a node before it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LastRequest {
    Nothing,
    Leave,
    /// The run killed it: its exit status has no meaning.
    Kill,
}

/// Whether a node ended well while the others still run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NodeOutcome {
    Well,
    Failed,
}

impl NodeEnds {
    /// Records the end of a node.
    pub(super) fn take(&mut self, exit: Exit, request: LastRequest) -> NodeOutcome {
        let well = match (exit.code(), request) {
            (Some(0), _) | (None, LastRequest::Kill) => true,
            (Some(code), _) if code == i32::from(EXIT_INTERRUPTED) => {
                request != LastRequest::Nothing
            }
            _ => false,
        };
        self.fusion_done |= exit.node == FUSION && exit.code() == Some(0);
        if well {
            return NodeOutcome::Well;
        }
        self.failures.push(exit);
        NodeOutcome::Failed
    }

    /// How the run ended; its last reported tick is `last`.
    pub(super) fn verdict(&self, interrupted: bool, last: Option<Tick>) -> RunVerdict {
        // An interrupted fusion that could not write its last files has failed.
        let fusion_failed = self
            .failures_with_a_reason()
            .any(|exit| exit.node == FUSION);
        if interrupted && !fusion_failed {
            return RunVerdict::Interrupted;
        }
        if self.failures.is_empty() {
            return if self.fusion_done {
                RunVerdict::Done
            } else {
                RunVerdict::Failed(NodeError::Failed(anyhow!("fusion has not finished")))
            };
        }
        let message = anyhow!(self.blame(last));
        let refused = |exit: &Exit| exit.code() == Some(i32::from(EXIT_REFUSED));
        RunVerdict::Failed(if self.failures.iter().any(refused) {
            NodeError::Refused(message)
        } else {
            NodeError::Failed(message)
        })
    }

    /// A node that a signal ended comes first, as the others only miss it. Fusion's error has the rest: fusion receives
    /// the
    /// reason of every edge that fails, and then ends the other edges, which fail in turn.
    fn blame(&self, last: Option<Tick>) -> String {
        let ended: Vec<&Exit> = self.failures.iter().filter(|e| was_ended(e)).collect();
        let by_fusion = self
            .failures_with_a_reason()
            .find(|exit| exit.node == FUSION);
        // A fusion that was ended itself has no reason, and the edges only report that it has left.
        let echo = ended.iter().any(|exit| exit.node == FUSION);
        let cause = by_fusion.or_else(|| self.failures_with_a_reason().next().filter(|_| !echo));
        let lines: Vec<String> = ended
            .into_iter()
            .chain(cause)
            .map(|e| described(e, last))
            .collect();
        lines.join("\n")
    }

    fn failures_with_a_reason(&self) -> impl Iterator<Item = &Exit> {
        self.failures.iter().filter(|exit| !was_ended(exit))
    }
}

/// Whether a node was ended by a signal, caught or not.
fn was_ended(exit: &Exit) -> bool {
    exit.code()
        .is_none_or(|code| code == i32::from(EXIT_INTERRUPTED))
}

fn described(exit: &Exit, last: Option<Tick>) -> String {
    if exit.code() == Some(i32::from(EXIT_INTERRUPTED)) {
        let at = last.map_or_else(String::new, |tick| format!(" at tick {tick}"));
        return format!("{} was ended by a signal{at}", exit.node);
    }
    format!("{}: {}", exit.node, exit.reason())
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt as _;
    use std::process::ExitStatus;

    use super::*;

    fn exit(node: &str, raw: i32, error: &str) -> Exit {
        Exit {
            node: node.to_owned(),
            status: Some(ExitStatus::from_raw(raw)),
            error: error.to_owned(),
            survived_error: String::new(),
        }
    }

    fn code(node: &str, code: i32, error: &str) -> Exit {
        exit(node, code << 8, error)
    }

    fn failed(ends: &NodeEnds, interrupted: bool) -> String {
        match ends.verdict(interrupted, Some(Tick(7))) {
            RunVerdict::Failed(error) => error.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_run_is_done_when_fusion_exits_with_success() {
        let mut ends = NodeEnds::default();
        assert_eq!(failed(&ends, false), "fusion has not finished");
        ends.take(code(FUSION, 0, ""), LastRequest::Nothing);
        assert!(matches!(ends.verdict(false, None), RunVerdict::Done));
    }

    #[test]
    fn a_fusion_ended_from_outside_is_a_failure() {
        let mut ends = NodeEnds::default();
        assert_eq!(
            ends.take(code(FUSION, 130, ""), LastRequest::Nothing),
            NodeOutcome::Failed
        );
        ends.take(code("ne", 0, ""), LastRequest::Leave);
        assert_eq!(
            failed(&ends, false),
            "fusion was ended by a signal at tick 7"
        );
        let mut requested = NodeEnds::default();
        assert_eq!(
            requested.take(code(FUSION, 130, ""), LastRequest::Leave),
            NodeOutcome::Well
        );
        assert!(matches!(
            requested.verdict(true, None),
            RunVerdict::Interrupted
        ));
    }

    #[test]
    fn the_node_that_left_first_is_named_first_and_a_kill_by_the_run_is_no_failure() {
        let mut ends = NodeEnds::default();
        ends.take(exit("ne", 9, ""), LastRequest::Nothing);
        ends.take(
            code(FUSION, 1, "viewpoint ne has left"),
            LastRequest::Nothing,
        );
        ends.take(
            code("sw", 1, "fusion has ended the run"),
            LastRequest::Leave,
        );
        assert_eq!(
            ends.take(exit("se", 9, ""), LastRequest::Kill),
            NodeOutcome::Well
        );
        assert_eq!(
            failed(&ends, false),
            "ne: killed by signal 9\nfusion: viewpoint ne has left"
        );
    }

    #[test]
    fn errors_of_edges_are_ignored_if_fusion_was_killed() {
        let mut ends = NodeEnds::default();
        ends.take(code("ne", 1, "fusion has left"), LastRequest::Nothing);
        ends.take(exit(FUSION, 9, ""), LastRequest::Nothing);
        assert_eq!(failed(&ends, false), "fusion: killed by signal 9");
    }

    #[test]
    fn an_interrupted_fusion_that_cannot_write_its_files_has_failed() {
        let mut ends = NodeEnds::default();
        ends.take(code(FUSION, 1, "no space left"), LastRequest::Leave);
        assert_eq!(failed(&ends, true), "fusion: no space left");
    }
}
