//! Balls in pictures that were drawn from a known centre.

mod centre;
pub(crate) mod render;
mod scene;
mod speed;
