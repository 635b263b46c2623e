//! One moving thing in pictures: a coloured ball, a light in the dark, a drone against the sky.
//!
//! A [`BallFinder`] looks at the pictures of one camera in their order and keeps a few candidates of each; [`BallFinder::finish`]
//! then decides which of them are one thing that moves, and gives at most one [`BallSighting`] per frame, as
//! [`crate::points`] takes them ([`sightings`], [`sightings_text`]).
//!
//! In one picture: a mask by colour, brightness or motion, row by row; connected blobs of it; of each blob of a credible
//! size the outline, found below the pixel along rays from its middle; and the circle that the outline is. With a lens the
//! circle is fitted to the tangent rays themselves, so that neither perspective nor distortion moves the centre: the outline
//! of a sphere is a circle about its centre on the unit sphere, and an ellipse about another point in the picture
//! ([`outline_offset_px`] says how far off). Where a ball moves during the exposure, what covers a pixel for half of that
//! time is about the circle of its middle: edges are looked for farther around the softer they are, and the centre is that
//! of the middle of the exposure. Blobs below [`SMALLEST_OUTLINE_PX`] have no outline worth the name: their centre is the
//! mean of what covers each pixel.
//!
//! Over frames: candidates are linked where one can have become the other, links that never moved are scenery, and of things
//! that are there at the same time the rounder one is the ball. What is left out is left out: a camera that does not see the
//! ball gives no sighting.

mod appearance;
mod background;
mod blobs;
mod candidate;
mod chart;
mod colour;
mod error;
mod finder;
mod mask;
mod outline;
mod picture;
mod round;
mod track;

pub use appearance::Appearance;
pub use candidate::SMALLEST_OUTLINE_PX;
pub use chart::{BallLens, outline_offset_px};
pub use colour::{ColourRange, hsv};
pub use error::BallError;
pub use finder::{
    BallFinder, BallRequest, BallSighting, FINDER_REVISION, sightings, sightings_text,
};
pub use picture::{Picture, PixelLayout};

#[cfg(test)]
pub(crate) mod tests;
