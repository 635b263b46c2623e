//! From a world of its own, whose place, turn and size are arbitrary, to the venue: metres, z up, the floor at zero.
//!
//! What is known comes as [`Anchors`]: places of cameras and points, distances, and what was clicked in pictures ([`Marks`]): the
//! marks and lines of a [`farfield_proto::court::Court`] by name, other places, points of the floor, the ends of a wand. [`fit_marks`] lays the cameras on
//! all of it; where nothing is known but lengths and the floor, [`wand_scale`] and [`floor`] say how long and which way is up.
//! While pictures are clicked, [`ClickedFile`] is what there is so far, and [`fit_one_camera`] whether one camera's marks agree.

mod anchors;
mod click;
mod clicked_file;
mod floor;
mod mark_file;
mod mark_fit;
mod mark_start;
mod marks;
mod one_camera;
mod sight;
mod similarity;
mod wand;

pub(crate) use anchors::Lost;
pub use anchors::{Alignment, Anchors, KnownDistance, KnownPoint};
pub use click::Click;
pub use clicked_file::{ClickedChange, ClickedFile};
pub use floor::{Floor, floor};
pub use mark_file::LengthBetween;
pub use mark_fit::{MarkFit, MarkResidual, fit_marks};
pub use marks::{ClickedLength, ClickedPoint, FoundPlace, Known, KnownMark, MarkFreedom, Marks};
pub use one_camera::{
    HalfTurn, LEAST_MARKS, OneCameraError, OneCameraFit, drawn_lines, drawn_marks, fit_one_camera,
};
pub use similarity::{Similarity, SimilarityError, mirrored_rms, rms};
pub use wand::{WandScale, wand_scale};

#[cfg(test)]
mod one_camera_tests;
#[cfg(test)]
mod tests;
