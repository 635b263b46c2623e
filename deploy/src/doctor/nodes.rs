//! Which farfield the nodes of a venue run, where it runs now.

use std::time::Duration;

use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;

use super::ports::VenueRuns;
use crate::report_lines::ReportLines;
use crate::status::{NodeInShort, join_for_a_moment};

const NODES: &str = "nodes";
/// How long fusion may take to answer: who waits for a diagnosis does not wait for a venue that does not run.
const ANSWER: Duration = Duration::from_millis(1500);

/// What mends a venue that cannot be joined, where it has keys, and where it has none.
const WITH_KEYS: &str = "mend what is said of the keys; a machine that has those of another node alone: farfield status VENUE --node NAME";
const WITHOUT_KEYS: &str = "farfield certs VENUE --out certs, then `[security] certificates = \"certs\"` and quic/ in `[fusion]`";

/// The same where endpoints are given.
const GIVEN: &str = "look at `--connect`: it is PROTOCOL/HOST:PORT, as in `[fusion] listen`";

/// Joins `venue` for a moment as somebody who only listens, at `connect` or where the venue file says.
pub(super) fn look_at_nodes(
    venue: &Venue,
    connect: &[String],
    report: &mut ReportLines,
) -> VenueRuns {
    match join_for_a_moment(venue, connect, ANSWER) {
        Ok(Some(nodes)) => {
            judge_nodes(&venue.name, &nodes, report);
            if connect.is_empty() && nodes.iter().any(|node| node.name == FUSION) {
                return VenueRuns::Now;
            }
        }
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
            match (venue.security.certificates.is_some(), connect.is_empty()) {
                (_, false) => GIVEN,
                (true, true) => WITH_KEYS,
                (false, true) => WITHOUT_KEYS,
            },
        ),
    }
    VenueRuns::No
}

/// What is said where looking did not come to its end.
pub(super) fn not_looked_at() -> (ReportLines, VenueRuns) {
    let mut report = ReportLines::default();
    let text = "not looked at: it has failed inside this program";
    report.warn(NODES, text, "farfield status VENUE");
    (report, VenueRuns::No)
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
