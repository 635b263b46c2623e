//! The channels of a recording, and their keys.

use farfield_proto::key::Keys;
use farfield_proto::message::fill::SetKind;

/// Contents of a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Content {
    /// Patch or sighting sets as they came.
    Sets(SetKind),
    /// Patch or sighting sets that an edge delivered after an outage.
    Filled(SetKind),
    /// Boxes for a viewpoint.
    Boxes,
    /// The persons of a tick.
    Poses,
    /// The persons of a tick, smoothed with a delay.
    Smoothed,
    /// Status of a node.
    Status,
    /// The sets that fusion used for a tick.
    Decisions,
    /// Identity events of a tick.
    Events,
    /// Results of the comparison with the venue's subjects.
    Namings,
    /// The persons of a tick as JSON.
    JsonPoses,
    /// Nodes that came and went, as JSON.
    Presence,
    /// Status of the recorder, as JSON.
    Recorder,
    /// The people that a session expects from the previous one, as JSON.
    Expected,
}

/// One channel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// The topic: a Zenoh key, or one below it.
    pub topic: String,
    /// Its content.
    pub content: Content,
}

/// Every possible channel of a recording of the venue `name`. Other keys are not recorded, so that
/// an unknown sender cannot fill a file with channels. There is none for thumbnails: recordings
/// have no pictures.
pub fn channels(name: &str, viewpoints: &[&str]) -> Vec<Channel> {
    let keys = Keys::new(name);
    let channel = |topic: String, content| Channel { topic, content };
    let mut all = vec![
        channel(keys.pose(), Content::Poses),
        channel(keys.smooth(), Content::Smoothed),
        channel(keys.decision(), Content::Decisions),
        channel(keys.event(), Content::Events),
        channel(keys.naming(), Content::Namings),
        channel(json_poses(&keys), Content::JsonPoses),
        channel(format!("{name}/recorder"), Content::Recorder),
        channel(expected(name), Content::Expected),
    ];
    for kind in [SetKind::Patches, SetKind::Sightings] {
        for viewpoint in viewpoints {
            all.push(channel(
                live_topic(&keys, viewpoint, kind),
                Content::Sets(kind),
            ));
            all.push(channel(
                filled_topic(&keys, viewpoint, kind),
                Content::Filled(kind),
            ));
        }
    }
    for viewpoint in viewpoints {
        all.push(channel(keys.boxes(viewpoint), Content::Boxes));
    }
    for node in viewpoints.iter().chain(&["fusion"]) {
        all.push(channel(keys.status(node), Content::Status));
        all.push(channel(keys.alive(node), Content::Presence));
    }
    all
}

/// The topic of the people that a session of the venue `name` expects from the previous one.
pub fn expected(name: &str) -> String {
    format!("{name}/expected")
}

/// The topic of the poses as JSON.
pub fn json_poses(keys: &Keys) -> String {
    format!("{}/json", keys.pose())
}

/// The topic of sets that came without a request.
pub fn live_topic(keys: &Keys, viewpoint: &str, kind: SetKind) -> String {
    match kind {
        SetKind::Patches => keys.patch(viewpoint),
        SetKind::Sightings => keys.sighting(viewpoint),
    }
}

/// The topic of sets that were requested.
pub fn filled_topic(keys: &Keys, viewpoint: &str, kind: SetKind) -> String {
    let below = match kind {
        SetKind::Patches => "patch",
        SetKind::Sightings => "sighting",
    };
    format!("{}/{below}", keys.fill(viewpoint))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn topics_are_unique() {
        let all = channels("hall", &["ne", "sw"]);
        let topics: BTreeSet<&str> = all.iter().map(|c| c.topic.as_str()).collect();
        assert_eq!(topics.len(), all.len());
        for topic in [
            "hall/patch/ne",
            "hall/fill/sw/sighting",
            "hall/pose/json",
            "hall/status/fusion",
            "hall/event",
            "hall/naming",
        ] {
            assert!(topics.contains(topic), "{topic}");
        }
    }

    #[test]
    fn there_is_no_channel_for_pictures() {
        let all = channels("hall", &["ne", "sw"]);
        let (keys, pictures) = (Keys::new("hall"), "thumbnail");
        assert!(keys.thumbnail("ne").contains(pictures));
        assert!(all.iter().all(|channel| !channel.topic.contains(pictures)));
    }
}
