//! Bodies with volume, built from joints alone, for pictures and for occlusion.
//!
//! A [`Volume`] consists of [`Cone`]s between the 29 joints of one moment. A [`Build`] gives their
//! width and the clothes. The module does not use fusion's skeletal model; the joints may come from
//! any clip.

mod build;
mod cone;
mod parts;
mod volume;

pub use build::{Build, Color, Hair, ShirtPattern};
pub use cone::{BodyPart, Cone};
pub use volume::Volume;

#[cfg(test)]
pub(crate) mod standing;
#[cfg(test)]
mod tests;
