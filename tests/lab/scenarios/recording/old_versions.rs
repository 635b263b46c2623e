//! Recordings are kept for years: what any version of the messages has written is read, and solved again.

use farfield_proto::wire::{OLDEST_READ, VERSION};

use super::replayed;
use crate::data::checkout;

#[test]
fn a_recording_of_every_earlier_version_is_solved_again() {
    for version in OLDEST_READ..VERSION {
        let file = checkout().join(format!("proto/golden/v{version}/recording.mcap"));
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let said = replayed(&file, &out, &[]);
        assert_eq!(said["replay"]["unreadable"], 0, "version {version}: {said}");
        assert_eq!(
            said["replay"]["missing_sets"], 0,
            "version {version}: {said}"
        );
        let text = std::fs::read_to_string(out.join("poses.jsonl")).unwrap();
        // Two people at each of 13 ticks.
        assert_eq!(text.lines().count(), 26, "version {version}");
        println!("a recording of version {version} is read and solved");
    }
}
