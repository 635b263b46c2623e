//! Whether an edge and fusion hold the same files.

use anyhow::anyhow;
use farfield_node::process::NodeError;
use farfield_proto::message::Status;

/// Compares the files of this edge with fusion's.
///
/// # Errors
/// [`NodeError::Refused`] with the first that differs.
pub(super) fn compare_files(own: &Status, fusion: &Status) -> Result<(), NodeError> {
    let files = [
        ("venue file", &own.venue_hash, &fusion.venue_hash),
        (
            "calibration",
            &own.calibration_hash,
            &fusion.calibration_hash,
        ),
    ];
    for (what, ours, theirs) in files {
        if ours != theirs {
            return Err(NodeError::Refused(anyhow!(
                "fusion holds another {what} than viewpoint {}: its fingerprint there is {theirs}, here {ours}; start this edge with --from-fusion to fetch it, or copy the same file to both",
                own.node
            )));
        }
    }
    Ok(())
}
