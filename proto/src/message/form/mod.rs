//! How messages are written where that is not field by field: the short forms of what there is most of.

mod boxes;
mod patches;
pub(super) mod sightings;
