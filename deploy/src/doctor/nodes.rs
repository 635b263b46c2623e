//! The farfield versions of the nodes of a running venue.

use std::time::Duration;

use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;

use super::ports::VenueRuns;
use crate::report_lines::ReportLines;
use crate::status::{NodeInShort, join_for_a_moment};

const NODES: &str = "nodes";
/// Time for fusion to answer: a diagnosis must not wait long for a venue that does not run.
const ANSWER: Duration = Duration::from_millis(1500);

/// Remedies for a venue that cannot be joined: with keys, and without.
const WITH_KEYS: &str = "fix the problems of the keys; on a machine that has only keys of another node: farfield status VENUE --node NAME";
const WITHOUT_KEYS: &str = "farfield certs VENUE --out certs, then `[security] certificates = \"certs\"` and quic/ in `[fusion]`";

/// The same if endpoints are given.
const GIVEN: &str = "check `--connect`: it is PROTOCOL/HOST:PORT, as in `[fusion] listen`";

/// Joins `venue` for a moment as an observer, at `connect` or at the endpoint of the venue file.
pub(super) fn check_nodes(
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
            format!("no node answers at {}", connect.join(", ")),
            "check that fusion runs and listens there, and that no firewall blocks it",
        ),
        Ok(None) => report.ok(
            NODES,
            format!(
                "no fusion of venue {} answers: it does not run, or runs elsewhere",
                venue.name
            ),
        ),
        Err(error) => report.warn(
            NODES,
            format!("not checked: {error}"),
            match (venue.security.certificates.is_some(), connect.is_empty()) {
                (_, false) => GIVEN,
                (true, true) => WITH_KEYS,
                (false, true) => WITHOUT_KEYS,
            },
        ),
    }
    VenueRuns::No
}

/// The line for a check that panicked.
pub(super) fn not_checked() -> (ReportLines, VenueRuns) {
    let mut report = ReportLines::default();
    let text = "not checked: an internal error of this program";
    report.warn(NODES, text, "farfield status VENUE");
    (report, VenueRuns::No)
}

/// Compares the version of every node with that of this machine.
pub(super) fn judge_nodes(venue: &str, nodes: &[NodeInShort], report: &mut ReportLines) {
    let here = env!("CARGO_PKG_VERSION");
    let reported = nodes.iter().filter(|node| !node.version.is_empty());
    let (same, others): (Vec<&NodeInShort>, Vec<&NodeInShort>) =
        reported.partition(|node| node.version == here);
    if !same.is_empty() {
        let names: Vec<&str> = same.iter().map(|node| node.name.as_str()).collect();
        let names = names.join(", ");
        report.ok(
            NODES,
            format!("nodes of venue {venue} that run farfield {here}, as this machine: {names}"),
        );
    }
    for other in others {
        report.warn(
            NODES,
            format!(
                "{} runs farfield {}, this machine {here}",
                other.name, other.version
            ),
            "install one version on all machines, fusion first; neighbouring message versions work together",
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
