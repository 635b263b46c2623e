//! Short forms of the most frequent messages; all other messages are written field by field.

mod boxes;
mod patches;
pub(super) mod sightings;
