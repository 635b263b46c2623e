//! Calibration from a single moving point: a ball, a light or a drone, that cameras saw from different places.
//!
//! [`calibrate`] starts from nothing but lenses and sightings ([`parse`] reads them): clocks are found where cameras are not
//! synchronised, then relative poses of pairs, then one camera after the other, then all is adjusted to all. The result
//! says how good it is and what speaks against it ([`crate::report::Report`]).

mod assess;
mod board;
mod chain;
mod clocks;
mod curve;
mod error;
mod file;
mod freed;
mod halves;
mod outcome;
mod over_time;
mod refine;
mod request;
mod rigid_board;
mod timing;
mod venue;
mod view;

pub(crate) use freed::{Bars, ClockUnit, suspects};
pub(crate) use halves::{Apart, halves};
pub(crate) use outcome::check_anchors;
pub(crate) use over_time::knocked_at;
pub(crate) use refine::freedom;
pub(crate) use venue::{Laid, of_anchors};

pub use board::CORNERS_PER_INSTANT;
pub use error::CalibrationError;
pub use file::{Sighting, parse, parse_multicamselfcal};
pub use outcome::{FoundCamera, PathPoint, PointCalibration, Stage, calibrate, check_request};
pub use request::{Lenses, PointCamera, PointRequest, Timing};
pub use rigid_board::RigidBoard;

#[cfg(test)]
pub(crate) mod tests;
