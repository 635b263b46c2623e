//! Whether another node holds the same files: told by the fingerprints that statuses carry.

use super::VenueHash;
use crate::message::Status;

/// The fingerprints of a node's own files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OwnFiles<'a> {
    /// Of the venue file.
    pub venue: &'a str,
    /// Of the calibration.
    pub calibration: &'a str,
    /// How the fingerprint of the networks must begin that the other node runs; `None` where it does not matter.
    pub networks: Option<&'a str>,
}

/// A file that the other node holds otherwise.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OtherFile {
    /// Which file: "venue file", "calibration" or "network".
    pub what: &'static str,
    /// The fingerprint of the other node's.
    pub theirs: String,
    /// The fingerprint of one's own.
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
    /// The first file that the node which says `theirs` holds otherwise; `None` when all are the same.
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
