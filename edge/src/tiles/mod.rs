//! Tiled detection: the parts of a picture on which the detector runs separately. In the whole
//! picture, scaled to the detector's input, distant people are too small to be detected.
//!
//! From the calibration and the field a [`plan`] computes the height of a standing person at each
//! place of a picture. The whole picture is always one window. Where a person would be less than
//! [`TALL_ENOUGH_PX`] tall in it, finer overlapping [`crate::inference::DetectorWindow`]s (tiles)
//! are added. The detections of all windows are [`merged`] into one list. This module is pure and
//! reads no pixels.

mod merge;
mod plan;
mod standing;
#[cfg(test)]
mod tests;

pub use self::merge::{merged, thinned_out};
pub use self::plan::{TilePlan, plan};

/// Height of a standing person in a detector's input, pixels, from which no finer window is needed.
/// Small detectors miss more people the smaller these are (`sim/network/README.md` has the shares
/// by size for the embedded one).
pub const TALL_ENOUGH_PX: f64 = 48.0;
