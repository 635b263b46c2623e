//! Comparison of the files of an edge and fusion.

use anyhow::anyhow;
use farfield_node::process::NodeError;
use farfield_proto::message::Status;
use farfield_proto::venue::same_files::{OtherFile, OwnFiles};

/// Compares the fingerprints of this edge's files with fusion's.
///
/// # Errors
/// [`NodeError::Refused`] with the first difference.
pub(super) fn compare_files(own: &Status, fusion: &Status) -> Result<(), NodeError> {
    let Some(OtherFile { what, theirs, ours }) = OwnFiles::from(own).other_file(fusion) else {
        return Ok(());
    };
    Err(NodeError::Refused(anyhow!(
        "fusion holds another {what} than viewpoint {}: its fingerprint there is {theirs}, here {ours}; start this edge with --from-fusion to fetch it, or copy the same file to both",
        own.node
    )))
}
