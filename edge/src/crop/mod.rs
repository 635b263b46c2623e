//! From a box and a picture to the network's input: geometry ([`CropGeometry`]) and resampling
//! ([`Cropper`]).
//!
//! Boxes and grids are in undistorted pixels, pictures in distorted ones. The distortion is removed
//! in the one resampling of the crop. Pixels outside the image are unknown: the network gets its
//! card's mean there. Fusion derives the same cells from the grid and the camera model, so they are
//! not transmitted.

mod geometry;
mod reduce;
mod resample;
mod rgb;
mod warp;
mod yuv;

/// Texels per input pixel above which one bilinear tap would skip texels, so that four taps are
/// averaged.
const ONE_TAP_MAX: f64 = 1.1;

pub use geometry::{CropGeometry, CropShape, enclosing_upright};
pub use resample::{Cropper, PixelFormat};
