//! The pure parts of a live edge: current tick, current boxes, sending rates, and camera health.
//!
//! Time is always an argument, in microseconds of a clock that the caller reads. Equal calls give
//! equal results. The shell that reads clocks, cameras and sockets is `node::live`.

pub mod budget;
pub mod capture;
pub mod delivery;
pub mod detection_schedule;
pub mod failures;
pub mod health;
pub mod newest_boxes;
pub mod own_boxes;
pub mod rate;
pub mod round_robin;
pub mod tick_clock;
pub mod timecode;

pub use farfield_proto::tick::{Micros, SECOND_US};
