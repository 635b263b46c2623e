//! How messages are written where that is not field by field: the short forms of what there is most of, and what older
//! versions wrote.

mod boxes;
pub(super) mod older;
mod patches;
pub(super) mod sightings;
