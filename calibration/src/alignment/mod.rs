//! From a world of its own, whose place, turn and size are arbitrary, to the venue: metres, z up, the floor at zero.
//!
//! What is known comes as [`Anchors`]: places of cameras and points, distances, and what was clicked in pictures ([`Marks`]): the
//! marks and lines of a [`farfield_proto::court::Court`] by name, other places, points of the floor, the ends of a wand. [`fit_marks`] lays the cameras on
//! all of it; where nothing is known but lengths and the floor, [`wand_scale`] and [`floor`] say how long and which way is up.

mod anchors;
mod click;
mod floor;
mod mark_file;
mod mark_fit;
mod mark_start;
mod marks;
mod sight;
mod similarity;
mod wand;

pub use anchors::{Alignment, Anchors, KnownDistance, KnownPoint};
pub use click::Click;
pub use floor::{Floor, floor};
pub use mark_fit::{MarkFit, MarkResidual, fit_marks};
pub use marks::{ClickedLength, ClickedPoint, FoundPlace, Known, KnownMark, MarkFreedom, Marks};
pub use similarity::{Similarity, SimilarityError, mirrored_rms, rms};
pub use wand::{WandScale, wand_scale};

#[cfg(test)]
mod tests;
