//! What the page knows in advance: the venue, its keys, and how bodies are described.

use std::collections::BTreeMap;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::key::Keys;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;

use crate::protocol::tick::JointGrid;
use crate::skeleton::Skeleton;

/// Content of the keys that the page uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Topic {
    /// The people of a tick.
    Poses,
    /// Identity events.
    Events,
    /// Matches of people to the venue's subjects.
    Namings,
    /// Maps of a viewpoint.
    Patches(ViewpointIndex),
    /// Sightings of a viewpoint.
    Sightings(ViewpointIndex),
    /// Boxes for a viewpoint.
    Boxes(ViewpointIndex),
    /// Status of fusion (`None`) or of an edge.
    Status(Option<ViewpointIndex>),
}

/// Data that stays constant while the page is served.
#[derive(Debug)]
pub(crate) struct Context {
    pub(crate) venue: Venue,
    pub(crate) skeleton: Skeleton,
    pub(crate) grid: JointGrid,
    topics: BTreeMap<String, Topic>,
}

impl Context {
    pub(crate) fn new(venue: Venue, skeleton: Skeleton) -> Self {
        let keys = Keys::new(&venue.name);
        let mut topics = BTreeMap::from([
            (keys.pose(), Topic::Poses),
            (keys.event(), Topic::Events),
            (keys.naming(), Topic::Namings),
            (keys.status(FUSION), Topic::Status(None)),
        ]);
        for (index, viewpoint) in venue.viewpoints.iter().enumerate() {
            let (index, name) = (ViewpointIndex(index as u16), &viewpoint.name);
            topics.extend([
                (keys.patch(name), Topic::Patches(index)),
                (keys.sighting(name), Topic::Sightings(index)),
                (keys.boxes(name), Topic::Boxes(index)),
                (keys.status(name), Topic::Status(Some(index))),
            ]);
        }
        Self {
            grid: JointGrid::of_field(venue.field.min_m, venue.field.max_m),
            skeleton,
            topics,
            venue,
        }
    }

    /// The topic of a key; `None` if the page does not use it.
    pub(crate) fn topic(&self, key: &str) -> Option<Topic> {
        self.topics.get(key).copied()
    }

    /// Name of fusion or of an edge.
    pub(crate) fn node_name(&self, node: Option<ViewpointIndex>) -> &str {
        let viewpoint = node.map(|index| self.venue.viewpoints.get(usize::from(index.0)));
        viewpoint.map_or(FUSION, |known| {
            known.map_or("?", |viewpoint| &viewpoint.name)
        })
    }

    /// The venue's limit for a link, bytes per second.
    pub(crate) fn budget_bytes_per_s(&self) -> Option<f64> {
        let budget = self.venue.parameters.link.budget_bytes_per_s;
        (budget > 0.0).then_some(budget)
    }

    /// The compression level that the venue configures.
    pub(crate) fn usual_level(&self) -> u8 {
        let configured = self.venue.parameters.link.quality;
        configured.unwrap_or(CompressionLevel::DEFAULT).number()
    }
}
