//! Rough poses without a start: the floor under each camera, relative poses of two cameras, all cameras, and their clocks.

pub(super) mod clocks;
pub(super) mod floor_match;
pub(super) mod graph;
pub(super) mod ground;
pub(super) mod pair;
