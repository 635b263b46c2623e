//! Balls in pictures drawn with a known centre.

mod centre;
pub(crate) mod render;
mod scene;
