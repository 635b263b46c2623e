//! Bodies with volume, from joints alone: what pictures show, and what hides what.
//!
//! A [`Volume`] is made of [`Cone`]s laid between the 29 joints of one moment; a [`Build`] says
//! how wide they are and what the person wears. Nothing of fusion's skeletal model is used, and
//! the joints may come from any clip.

mod axes;
mod build;
mod cone;
mod limbs;
mod trunk;
mod volume;

pub use build::{Build, Color, Hair, ShirtPattern};
pub use cone::{BodyPart, Cone};
pub use volume::Volume;

#[cfg(test)]
pub(crate) mod standing;
#[cfg(test)]
mod tests;
