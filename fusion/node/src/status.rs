//! Fusion's own status, and how a failed edge ends a lock-step run.

use anyhow::anyhow;
use farfield_node::process::NodeError;
use farfield_proto::message::Status;
use farfield_proto::message::health::NodeHealth;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::VenueHash;
use farfield_proto::wire;

/// Fusion's own status, with the fingerprints of its files.
pub(super) fn own_status(hashes: &VenueHash) -> Status {
    Status {
        node: FUSION.to_owned(),
        process: 0,
        viewpoint: None,
        release: env!("CARGO_PKG_VERSION").to_owned(),
        ready: true,
        venue_hash: hashes.venue.clone(),
        calibration_hash: hashes.calibration.clone(),
        network_hash: String::new(),
        backend: String::new(),
        ticks: None,
        tick: None,
        unreadable: 0,
        failure: None,
        stages: Vec::new(),
        live: None,
        health: NodeHealth::default(),
        agreement: Vec::new(),
    }
}

/// Fusion's last status, with its failure cut to the maximal length.
pub(super) fn failed_status(hashes: &VenueHash, error: &NodeError) -> Status {
    Status {
        ready: false,
        failure: Some(wire::cut_text(error.to_string())),
        ..own_status(hashes)
    }
}

/// Returns the failure of an edge, if it has one.
pub(super) fn check(status: &Status) -> anyhow::Result<()> {
    match &status.failure {
        Some(failure) if status.viewpoint.is_some() => {
            Err(anyhow!("viewpoint {}: {failure}", status.node))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_failure_is_cut_and_readable_by_the_edges() {
        let hashes = VenueHash {
            venue: "v".to_owned(),
            calibration: "c".to_owned(),
        };
        let error = NodeError::failed(anyhow!("tick 7: {}", "\u{2026}".repeat(5000)));
        let status = failed_status(&hashes, &error);
        let received: Status = wire::decode(&wire::encode(&status)).unwrap();
        assert!(received.failure.unwrap().starts_with("tick 7: \u{2026}"));
        assert!(!received.ready);
    }
}
