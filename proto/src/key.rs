//! Zenoh key expressions, all under the venue's name.

/// Builds the key expressions of one venue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Keys {
    venue: String,
}

impl Keys {
    /// Keys under the venue `name`, which the venue file has checked with [`is_key_chunk`].
    pub fn new(name: &str) -> Self {
        Self {
            venue: name.to_owned(),
        }
    }

    /// Patch sets of a viewpoint.
    pub fn patch(&self, viewpoint: &str) -> String {
        format!("{}/patch/{viewpoint}", self.venue)
    }

    /// Patch sets of all viewpoints.
    pub fn patches(&self) -> String {
        self.patch("*")
    }

    /// Boxes for a viewpoint.
    pub fn boxes(&self, viewpoint: &str) -> String {
        format!("{}/box/{viewpoint}", self.venue)
    }

    /// Sightings of a viewpoint.
    pub fn sighting(&self, viewpoint: &str) -> String {
        format!("{}/sighting/{viewpoint}", self.venue)
    }

    /// Sightings of all viewpoints.
    pub fn sightings(&self) -> String {
        self.sighting("*")
    }

    /// Thumbnails of the cameras of a viewpoint.
    pub fn thumbnail(&self, viewpoint: &str) -> String {
        format!("{}/thumbnail/{viewpoint}", self.venue)
    }

    /// Thumbnails of all viewpoints.
    pub fn thumbnails(&self) -> String {
        self.thumbnail("*")
    }

    /// Poses of a tick.
    pub fn pose(&self) -> String {
        format!("{}/pose", self.venue)
    }

    /// Poses of the fixed-lag smoother.
    pub fn smooth(&self) -> String {
        format!("{}/smooth", self.venue)
    }

    /// Queries for the venue's files, which fusion answers.
    pub fn config(&self) -> String {
        format!("{}/config", self.venue)
    }

    /// The sets that fusion used for a tick.
    pub fn decision(&self) -> String {
        format!("{}/decision", self.venue)
    }

    /// Identity events of a tick.
    pub fn event(&self) -> String {
        format!("{}/event", self.venue)
    }

    /// Matches of people with the venue's subjects at a tick.
    pub fn naming(&self) -> String {
        format!("{}/naming", self.venue)
    }

    /// All keys of the venue.
    pub fn all(&self) -> String {
        format!("{}/**", self.venue)
    }

    /// Queries for the sets that an edge has stored.
    pub fn fill(&self, viewpoint: &str) -> String {
        format!("{}/fill/{viewpoint}", self.venue)
    }

    /// Status of a node.
    pub fn status(&self, node: &str) -> String {
        format!("{}/status/{node}", self.venue)
    }

    /// Status of all nodes.
    pub fn statuses(&self) -> String {
        self.status("*")
    }

    /// Liveliness token of a node.
    pub fn alive(&self, node: &str) -> String {
        format!("{}/alive/{node}", self.venue)
    }

    /// Liveliness tokens of all nodes.
    pub fn all_alive(&self) -> String {
        self.alive("*")
    }
}

/// Whether `name` can be one chunk of a key expression: not empty, at most 64 bytes, and only ASCII
/// letters, digits, `-`, `_` and `.`.
pub fn is_key_chunk(name: &str) -> bool {
    let allowed = |b: u8| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'_' | b'.');
    !name.is_empty() && name.len() <= 64 && name.bytes().all(allowed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_special_characters_are_not_chunks() {
        for bad in ["", "a/b", "a*", "$x", "a b", "über", "q?"] {
            assert!(!is_key_chunk(bad), "{bad:?}");
        }
        assert!(is_key_chunk("north-east_1.a"));
    }

    #[test]
    fn keys_start_with_the_venue() {
        let keys = Keys::new("hall-3");
        assert_eq!(keys.patch("ne"), "hall-3/patch/ne");
        assert_eq!(keys.sightings(), "hall-3/sighting/*");
        assert_eq!(keys.fill("ne"), "hall-3/fill/ne");
        assert_eq!(keys.thumbnail("ne"), "hall-3/thumbnail/ne");
        assert_eq!(keys.smooth(), "hall-3/smooth");
        assert_eq!(keys.config(), "hall-3/config");
        assert_eq!(keys.event(), "hall-3/event");
        assert_eq!(keys.naming(), "hall-3/naming");
    }
}
