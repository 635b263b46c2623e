//! Our own bundle adjustment: cameras and the path of points that they saw, made to agree.
//!
//! A camera is proto's pinhole with OpenCV's lens ([`CameraState`]); which of its numbers may move is said per camera
//! ([`Free`]). What was seen is a set of points, one smooth path in time ([`Path`]), so that cameras which are not
//! synchronised are adjusted with their clocks, or a rigid body that was carried about. Points are eliminated by the Schur complement, the reduced matrix of the
//! cameras is dense (28 cameras are 196 unknowns), and steps are damped (Levenberg and Marquardt). Nothing depends on
//! threads, clocks or hash order: the same input gives the same bits.
//!
//! Residuals are distorted pixels over their standard deviation; [`Loss`] says how those that do not fit count.

mod band;
mod camera_state;
mod covariance;
mod loss;
mod normal;
mod path;
mod problem;
mod projection;
mod solve;

pub use camera_state::{CameraState, Observation};
pub use covariance::{CameraSigma, Covariance, Degenerate, covariance};
pub use loss::Loss;
pub use path::{Bodies, Path, Spline};
pub use problem::{AdjustedCamera, Block, Free, Problem};
pub use projection::{PARAMETERS, Projected};
pub use solve::{Limits, Outcome, adjust};

#[cfg(test)]
mod tests;
