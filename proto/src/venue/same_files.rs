//! Compares the files of another node with one's own, by the fingerprints in statuses.

use super::VenueHash;
use crate::message::Status;

/// The fingerprints of a node's own files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OwnFiles<'a> {
    /// Of the venue file.
    pub venue: &'a str,
    /// Of the calibration.
    pub calibration: &'a str,
    /// Required prefix of the other node's network fingerprint; `None` if it does not matter.
    pub networks: Option<&'a str>,
}

/// A file that differs on the other node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OtherFile {
    /// Which file: "venue file", "calibration" or "network".
    pub what: &'static str,
    /// The other node's fingerprint.
    pub theirs: String,
    /// One's own fingerprint.
    pub ours: String,
}

impl<'a> From<&'a VenueHash> for OwnFiles<'a> {
    fn from(hashes: &'a VenueHash) -> Self {
        Self {
            venue: &hashes.venue,
            calibration: &hashes.calibration,
            networks: None,
        }
    }
}

impl<'a> From<&'a Status> for OwnFiles<'a> {
    fn from(own: &'a Status) -> Self {
        Self {
            venue: &own.venue_hash,
            calibration: &own.calibration_hash,
            networks: None,
        }
    }
}

impl OwnFiles<'_> {
    /// The first file that differs on the node with status `theirs`; `None` when all are equal.
    pub fn other_file(&self, theirs: &Status) -> Option<OtherFile> {
        // The fingerprint of networks ends with the backend's name; without networks it is empty.
        let networks = theirs.network_hash.rsplit_once('+');
        let networks = self.networks.zip(networks);
        let files = [
            Some(("venue file", self.venue, theirs.venue_hash.as_str())),
            Some((
                "calibration",
                self.calibration,
                theirs.calibration_hash.as_str(),
            )),
            networks.map(|(ours, (theirs, _backend))| ("network", ours, theirs)),
        ];
        let other = files
            .into_iter()
            .flatten()
            .find(|(_, ours, theirs)| ours != theirs);
        other.map(|(what, ours, theirs)| OtherFile {
            what,
            theirs: theirs.to_owned(),
            ours: ours.to_owned(),
        })
    }
}
