//! Pictures of people with volume, for the cameras of a simulated venue.
//!
//! [`paint()`] casts rays at the solids of [`body`](crate::body), tile by tile. The static part, a
//! [`Backdrop`], is painted once per camera. A picture depends only on the scene, the seeds and the
//! time. It has the same bytes on any number of threads.

mod backdrop;
mod cast;
mod figure;
mod grain;
mod look;
mod paint;
mod place;
mod renderer;
mod sensor;
mod shade;
mod view;

pub use backdrop::Backdrop;
pub use figure::{Figure, Print};
pub use paint::{Shot, paint};
pub use place::{Light, Surroundings};
pub use renderer::{RenderSettings, Renderer};
pub use sensor::Sensor;
pub use view::CameraView;

#[cfg(test)]
mod tests;
