//! Parts of pictures that a detector looks at one by one, because in the whole picture, made small
//! for its input, people far away would be too small to be found.
//!
//! From the calibration and the field alone a [`plan`] knows how tall somebody who stands anywhere in
//! the field is in each part of a picture. The whole picture is one pass always; where a person would
//! be less than [`TALL_ENOUGH_PX`] in it, overlapping [`crate::inference::DetectorWindow`]s at a finer scale are added. What all
//! passes find is [`merged`] to one list. Pure: no picture is touched here.

mod cells;
mod merge;
mod plan;
mod standing;
#[cfg(test)]
mod tests;

pub use self::merge::{merged, thinned_out};
pub use self::plan::{TilePlan, plan};

/// Height of a standing person in a detector's input, pixels, from which its pass over the picture is
/// enough: the smaller people are, the more of them small detectors miss (for the embedded one,
/// `tests/network/README.md` has the shares by size).
pub const TALL_ENOUGH_PX: f64 = 48.0;
