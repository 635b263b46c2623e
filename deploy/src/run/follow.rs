//! Whoever looks on while the nodes of a run work.

use farfield_fusion::node::{LinkProgress, Progress};
use farfield_node::process::say;

/// How much fusion shall tell of each tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ProgressDetail {
    /// How many persons there are.
    Counts,
    /// Where they are, too.
    Bodies,
}

/// Shows a run under way.
pub(crate) trait Follow {
    /// What it wants to hear of each tick.
    fn detail(&self) -> ProgressDetail;

    /// A tick is done.
    fn tick(&mut self, progress: &Progress);

    /// Live, once a second: how the edges are heard.
    fn links(&mut self, _links: &LinkProgress) {}

    /// Whether what a node has said, under its name, is for whoever looks on.
    fn wants(&self, _said: &str) -> bool {
        true
    }

    /// A line for the operator.
    fn tell(&mut self, line: &str) {
        say(format_args!("{line}"));
    }

    /// There will be no more ticks.
    fn finish(&mut self);
}
