//! Which farfield the nodes of a venue run, where it runs now.

use std::time::Duration;

use farfield_proto::venue::Venue;

use crate::report_lines::ReportLines;
use crate::status::{NodeInShort, join_for_a_moment};

const NODES: &str = "nodes";
/// How long fusion may take to answer: who waits for a diagnosis does not wait for a venue that does not run.
const ANSWER: Duration = Duration::from_millis(1500);

/// Joins `venue` for a moment as somebody who only listens, at `connect` or where the venue file says.
pub(super) fn look_at_nodes(venue: &Venue, connect: &[String], report: &mut ReportLines) {
    match join_for_a_moment(venue, connect, ANSWER) {
        Ok(Some(nodes)) => judge_nodes(&venue.name, &nodes, report),
        Ok(None) if !connect.is_empty() => report.warn(
            NODES,
            format!("nobody answers at {}", connect.join(", ")),
            "look whether fusion runs and listens there, and whether the way is open",
        ),
        Ok(None) => report.ok(
            NODES,
            format!(
                "no fusion of venue {} answers: it does not run, or elsewhere",
                venue.name
            ),
        ),
        Err(error) => report.warn(
            NODES,
            format!("not looked at: {error}"),
            "farfield status VENUE --node NAME, with a node whose keys this machine has",
        ),
    }
}

/// What is said where looking did not come to its end.
pub(super) fn not_looked_at() -> ReportLines {
    let mut report = ReportLines::default();
    let text = "not looked at: it has failed inside this program";
    report.warn(NODES, text, "farfield status VENUE");
    report
}

/// Holds what every node runs to what this machine runs.
pub(super) fn judge_nodes(venue: &str, nodes: &[NodeInShort], report: &mut ReportLines) {
    let here = env!("CARGO_PKG_VERSION");
    let told = nodes.iter().filter(|node| !node.version.is_empty());
    let (same, others): (Vec<&NodeInShort>, Vec<&NodeInShort>) =
        told.partition(|node| node.version == here);
    if !same.is_empty() {
        let names: Vec<&str> = same.iter().map(|node| node.name.as_str()).collect();
        let names = names.join(", ");
        report.ok(
            NODES,
            format!("of venue {venue} run farfield {here}, as this machine: {names}"),
        );
    }
    for other in others {
        report.warn(
            NODES,
            format!(
                "{} runs farfield {}, this machine {here}",
                other.name, other.version
            ),
            "bring all boxes to one version, fusion first; neighbouring versions of messages work together",
        );
    }
    for node in nodes {
        if let Some(trouble) = &node.trouble {
            report.warn(
                NODES,
                format!("{}: {trouble}", node.name),
                "farfield status VENUE",
            );
        }
    }
}
