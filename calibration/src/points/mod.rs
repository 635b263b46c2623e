//! Calibration from a single moving point: a ball, a light or a drone that cameras saw from different places.
//!
//! [`calibrate`] needs only lenses and sightings ([`parse`] reads them). If cameras are not synchronised, it finds their clocks.
//! Then it finds relative poses of pairs, adds one camera after the other, and adjusts all together. The result has a report
//! on its accuracy and problems ([`crate::report::Report`]).

mod assess;
mod board;
mod chain;
mod curve;
mod file;
mod freed;
mod halves;
mod outcome;
mod refine;
mod request;
mod timing;
mod venue;
mod view;

pub(crate) use freed::{Bars, ClockUnit, suspects};
pub(crate) use halves::{Apart, halves, knocked_at};
pub(crate) use outcome::check_anchors;
pub(crate) use refine::freedom;
pub(crate) use venue::{Aligned, anchor_findings};

pub use board::CORNERS_PER_INSTANT;
pub use file::{Sighting, parse, parse_multicamselfcal};
pub use outcome::{FoundCamera, PathPoint, PointCalibration, Stage, calibrate, check_request};
pub use request::{CalibrationError, Lenses, PointCamera, PointRequest, RigidBoard, Timing};

#[cfg(test)]
pub(crate) mod tests;
