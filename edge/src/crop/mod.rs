//! From a box and a picture to the network's input: geometry ([`CropGeometry`]) and resampling
//! ([`Cropper`]).
//!
//! Boxes and grids are in undistorted pixels, pictures in distorted ones; the lens is undone while
//! cropping, in one resampling. What lies outside the image is unknown: the network gets its
//! card's mean there, and fusion finds the same cells again from the grid and the camera model,
//! so nothing is sent about them.

mod geometry;
mod reduce;
mod resample;
mod rgb;
mod warp;
mod yuv;

/// Texels per input pixel above which one bilinear tap would skip texels, and four are averaged.
const ONE_TAP_MAX: f64 = 1.1;

pub use geometry::{CropGeometry, CropShape, enclosing_upright};
pub use resample::{Cropper, PixelFormat};
