//! What protocols need to know of people beyond their poses: names that differ, and places that are kept.

pub(crate) mod names;
pub mod places;
