//! From a world of its own, whose place, turn and size are arbitrary, to the venue: metres, z up, the floor at zero.

mod anchors;
mod similarity;

pub use anchors::{Alignment, Anchors, Click, KnownDistance, KnownPoint};
pub use similarity::{Similarity, SimilarityError, mirrored_rms, rms};
