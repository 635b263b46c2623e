//! What the fuzz targets work on.

pub(super) mod corpus;
pub(super) mod seeds;
