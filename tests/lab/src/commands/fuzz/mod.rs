//! What the fuzz targets work on.

pub(super) mod seeds;
