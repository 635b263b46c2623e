//! Rough poses from nothing: the floor under each camera, how two cameras stand to each other, all of them, and their clocks.

pub(super) mod clocks;
pub(super) mod floor_match;
pub(super) mod graph;
pub(super) mod ground;
pub(super) mod pair;
