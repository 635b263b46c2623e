//! Aligns cameras with an arbitrary world to the venue: metres, z up, the floor at zero.
//!
//! [`Anchors`] hold the known facts: places of cameras and points, distances, and clicks in pictures ([`Marks`]), that is,
//! marks and lines of a [`farfield_proto::court::Court`] by name, other places, points of the floor, the ends of a wand.
//! [`fit_marks`] fits the cameras to all of them. If only lengths and the floor are known, [`wand_scale`] gives the scale and
//! [`floor`] the direction of up. [`ClickedFile`] holds an incomplete set of clicks; [`fit_one_camera`] checks one camera's marks.

mod anchors;
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
pub use clicked_file::{ClickedChange, ClickedFile};
pub use floor::{Floor, floor};
pub use mark_file::LengthBetween;
pub use mark_fit::{MarkFit, MarkResidual, fit_marks};
pub use marks::{
    Click, ClickedLength, ClickedPoint, FoundPlace, Known, KnownMark, MarkFreedom, Marks,
};
pub use one_camera::{
    HalfTurn, LEAST_MARKS, OneCameraError, OneCameraFit, drawn_lines, drawn_marks, fit_one_camera,
};
pub use similarity::{Similarity, SimilarityError, mirrored_rms, rms};
pub use wand::{WandScale, wand_scale};

#[cfg(test)]
mod one_camera_tests;
#[cfg(test)]
mod tests;
