//! What the ends of the nodes mean for the run: how it ended, and who is to blame.

use anyhow::anyhow;
use farfield_node::process::{EXIT_INTERRUPTED, EXIT_REFUSED, NodeError};
use farfield_proto::tick::Tick;

use super::children::{Exit, FUSION};

/// How a run ended.
#[derive(Debug)]
pub(crate) enum RunVerdict {
    /// Fusion has worked on every tick.
    Done,
    /// Someone asked the run to stop.
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

/// The ends of the nodes as they come.
#[derive(Debug, Default)]
pub(super) struct NodeEnds {
    /// Fusion has ended, and all was well.
    fusion_done: bool,
    /// Nodes that ended badly without having been killed by the run, in order.
    failures: Vec<Exit>,
}

/// What the run had told a node before it ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NodeTold {
    Nothing,
    ToLeave,
    /// It was killed: its end says nothing.
    Killed,
}

/// What an end means while the others still run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sign {
    Well,
    Bad,
}

impl NodeEnds {
    /// Notes the end of a node.
    pub(super) fn take(&mut self, exit: Exit, told: NodeTold) -> Sign {
        let well = match (exit.code(), told) {
            (Some(0), _) | (None, NodeTold::Killed) => true,
            (Some(code), _) if code == i32::from(EXIT_INTERRUPTED) => told != NodeTold::Nothing,
            _ => false,
        };
        self.fusion_done |= exit.node == FUSION && exit.code() == Some(0);
        if well {
            return Sign::Well;
        }
        self.failures.push(exit);
        Sign::Bad
    }

    /// How the run ended, whose last reported tick is `last`.
    pub(super) fn verdict(&self, interrupted: bool, last: Option<Tick>) -> RunVerdict {
        // An interrupted fusion that failed at its last files has not ended well.
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

    /// Who was ended from outside comes first, as the others only miss it. Fusion's words say the rest:
    /// it hears from every edge why it fails, and then tells the others, which fail in turn.
    fn blame(&self, last: Option<Tick>) -> String {
        let ended: Vec<&Exit> = self.failures.iter().filter(|e| was_ended(e)).collect();
        let by_fusion = self
            .failures_with_a_reason()
            .find(|exit| exit.node == FUSION);
        // A fusion that was ended itself has no words: the edges' are but its echo.
        let echo = ended.iter().any(|exit| exit.node == FUSION);
        let words = by_fusion.or_else(|| self.failures_with_a_reason().next().filter(|_| !echo));
        let lines: Vec<String> = ended
            .into_iter()
            .chain(words)
            .map(|e| told(e, last))
            .collect();
        lines.join("\n")
    }

    /// The failures with a reason of their own.
    fn failures_with_a_reason(&self) -> impl Iterator<Item = &Exit> {
        self.failures.iter().filter(|exit| !was_ended(exit))
    }
}

/// Whether a node was ended by a signal, caught or not.
fn was_ended(exit: &Exit) -> bool {
    exit.code()
        .is_none_or(|code| code == i32::from(EXIT_INTERRUPTED))
}

fn told(exit: &Exit, last: Option<Tick>) -> String {
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

    fn exit(node: &str, raw: i32, said: &str) -> Exit {
        Exit {
            node: node.to_owned(),
            status: Some(ExitStatus::from_raw(raw)),
            said: vec![said.to_owned()],
            outlived: Vec::new(),
        }
    }

    fn code(node: &str, code: i32, said: &str) -> Exit {
        exit(node, code << 8, said)
    }

    fn failed(ends: &NodeEnds, interrupted: bool) -> String {
        match ends.verdict(interrupted, Some(Tick(7))) {
            RunVerdict::Failed(error) => error.to_string(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_run_is_done_when_fusion_says_so() {
        let mut ends = NodeEnds::default();
        assert_eq!(failed(&ends, false), "fusion has not finished");
        ends.take(code(FUSION, 0, ""), NodeTold::Nothing);
        assert!(matches!(ends.verdict(false, None), RunVerdict::Done));
    }

    #[test]
    fn a_fusion_that_somebody_else_has_ended_is_a_failure() {
        let mut ends = NodeEnds::default();
        assert_eq!(
            ends.take(code(FUSION, 130, ""), NodeTold::Nothing),
            Sign::Bad
        );
        ends.take(code("ne", 0, ""), NodeTold::ToLeave);
        assert_eq!(
            failed(&ends, false),
            "fusion was ended by a signal at tick 7"
        );
        let mut asked = NodeEnds::default();
        assert_eq!(
            asked.take(code(FUSION, 130, ""), NodeTold::ToLeave),
            Sign::Well
        );
        assert!(matches!(asked.verdict(true, None), RunVerdict::Interrupted));
    }

    #[test]
    fn whoever_left_first_is_named_first_and_our_own_kill_is_no_failure() {
        let mut ends = NodeEnds::default();
        ends.take(exit("ne", 9, ""), NodeTold::Nothing);
        ends.take(
            code(FUSION, 1, "error: viewpoint ne has left"),
            NodeTold::Nothing,
        );
        ends.take(
            code("sw", 1, "error: fusion has ended the run"),
            NodeTold::ToLeave,
        );
        assert_eq!(ends.take(exit("se", 9, ""), NodeTold::Killed), Sign::Well);
        assert_eq!(
            failed(&ends, false),
            "ne: killed by signal 9\nfusion: viewpoint ne has left"
        );
    }

    #[test]
    fn the_edges_of_a_killed_fusion_are_not_heard() {
        let mut ends = NodeEnds::default();
        ends.take(code("ne", 1, "error: fusion has left"), NodeTold::Nothing);
        ends.take(exit(FUSION, 9, ""), NodeTold::Nothing);
        assert_eq!(failed(&ends, false), "fusion: killed by signal 9");
    }

    #[test]
    fn an_interrupted_fusion_that_cannot_write_its_files_has_failed() {
        let mut ends = NodeEnds::default();
        ends.take(code(FUSION, 1, "error: no space left"), NodeTold::ToLeave);
        assert_eq!(failed(&ends, true), "fusion: no space left");
    }
}
