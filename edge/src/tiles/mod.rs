//! Tiled detection: the parts of a picture that the detector runs on one by one. In the whole picture, scaled down to
//! the detector's input, people far away would be too small to be found.
//!
//! From the calibration and the field alone a [`plan`] computes how tall a person who stands anywhere in the field is
//! in each part of a picture. The whole picture is always one window; where a person would be less than
//! [`TALL_ENOUGH_PX`] tall in it, overlapping [`crate::inference::DetectorWindow`]s at a finer scale (tiles) are
//! added. The detections of all windows are [`merged`] to one list. Pure: no picture is touched here.

mod cells;
mod merge;
mod plan;
mod standing;
#[cfg(test)]
mod tests;

pub use self::merge::{merged, thinned_out};
pub use self::plan::{TilePlan, plan};

/// Height of a standing person in a detector's input, pixels, from which no finer window is needed: the smaller people
/// are, the more of them small detectors miss (for the embedded one, `sim/network/README.md` has the shares by size).
pub const TALL_ENOUGH_PX: f64 = 48.0;
