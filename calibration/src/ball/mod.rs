//! Finds one moving thing in pictures: a coloured ball, a light in the dark, a drone against the sky.
//!
//! A [`BallFinder`] processes the pictures of one camera in order and keeps a few candidates of each. [`BallFinder::finish`]
//! then decides which of them are one moving thing, and returns at most one [`BallSighting`] per frame, in a form that
//! [`crate::points`] takes ([`sightings`], [`sightings_text`]).
//!
//! Steps in one picture:
//!
//! 1. A mask by colour, brightness or motion, row by row.
//! 2. Connected blobs of the mask.
//! 3. The outline of each blob of a plausible size, with subpixel accuracy, along rays from its middle.
//! 4. A circle fitted to the outline. With a lens it is fitted to the tangent rays, so that neither perspective nor distortion
//!    moves the centre: on the unit sphere the outline of a ball is a circle about its centre, in the picture it is an ellipse
//!    about another point ([`outline_offset_px`] gives the difference).
//!
//! If a ball moves during the exposure, the pixels that it covers for half of that time lie about the circle of its middle
//! position. Soft edges are therefore searched over a wider range, and the centre is that at the middle of the exposure. Blobs
//! below [`SMALLEST_OUTLINE_PX`] have no usable outline; their centre is the mean weighted by the covered share of each pixel.
//!
//! Steps over frames: candidates are linked where one can follow the other; tracks that never move are scenery; of several
//! things at the same time the rounder one is the ball. A camera that does not see the ball gives no sighting.

mod background;
mod blobs;
mod candidate;
mod chart;
mod colour;
mod finder;
mod mask;
mod outline;
mod picture;
mod round;
mod track;

pub use candidate::SMALLEST_OUTLINE_PX;
pub use chart::{BallLens, outline_offset_px};
pub use colour::{ColourRange, hsv};
pub use finder::{
    BallFinder, BallRequest, BallSighting, FINDER_REVISION, sightings, sightings_text,
};
pub use mask::Appearance;
pub use picture::{BallError, Picture, PixelLayout};

#[cfg(test)]
pub(crate) mod tests;
