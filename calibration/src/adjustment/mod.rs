//! Bundle adjustment of cameras and the path of the points that they saw.
//!
//! A camera is a pinhole with OpenCV's lens ([`CameraState`]); [`Free`] states which of its parameters are adjusted. The points
//! are a set, one smooth path in time ([`Path`]), with which clocks of cameras that are not synchronised are adjusted too, or a
//! moving rigid body. Points are eliminated by the Schur complement, the reduced matrix of the cameras is dense (28 cameras are
//! 196 unknowns), and steps are damped (Levenberg-Marquardt). Nothing depends on threads, clocks or hash order: the same input
//! gives the same bits.
//!
//! Residuals are distorted pixels over their standard deviation; [`Loss`] limits the effect of outliers.

mod band;
mod camera_state;
mod covariance;
mod normal;
mod path;
mod problem;
mod projection;
mod solve;

pub use camera_state::{CameraState, Observation};
pub use covariance::{CameraSigma, Covariance, Degenerate, covariance};
pub use path::{Bodies, Path, Spline};
pub use problem::{AdjustedCamera, Block, Free, Loss, Problem};
pub use projection::{PARAMETERS, Projected};
pub use solve::{Limits, Outcome, adjust};

#[cfg(test)]
mod tests;
