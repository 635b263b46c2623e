//! What the page knows beforehand: the venue, its keys, how bodies are described.

use std::collections::BTreeMap;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::key::Keys;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;

use crate::protocol::tick::JointGrid;
use crate::skeleton::Skeleton;

/// What a key of the venue carries, as far as the page wants it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Topic {
    /// The persons of a tick.
    Poses,
    /// What changed who is who.
    Events,
    /// Who was taken for a subject of the venue.
    Namings,
    /// Maps of a viewpoint.
    Patches(ViewpointIndex),
    /// Sightings of a viewpoint.
    Sightings(ViewpointIndex),
    /// Boxes for a viewpoint.
    Boxes(ViewpointIndex),
    /// Fusion's status, or that of an edge.
    Status(Option<ViewpointIndex>),
}

/// What does not change while the page is served.
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

    /// What stands under a key; `None`: nothing that the page shows.
    pub(crate) fn topic(&self, key: &str) -> Option<Topic> {
        self.topics.get(key).copied()
    }

    /// The name of a node: fusion's, or an edge's.
    pub(crate) fn node_name(&self, node: Option<ViewpointIndex>) -> &str {
        let viewpoint = node.map(|index| self.venue.viewpoints.get(usize::from(index.0)));
        viewpoint.map_or(FUSION, |known| {
            known.map_or("?", |viewpoint| &viewpoint.name)
        })
    }

    /// What the venue lets a link carry, bytes a second.
    pub(crate) fn budget_bytes_per_s(&self) -> Option<f64> {
        let budget = self.venue.parameters.link.budget_bytes_per_s;
        (budget > 0.0).then_some(budget)
    }

    /// The compression level that the venue asks for.
    pub(crate) fn usual_level(&self) -> u8 {
        let asked = self.venue.parameters.link.quality;
        asked.unwrap_or(CompressionLevel::DEFAULT).number()
    }
}
