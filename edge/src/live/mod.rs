//! The pure parts of an edge that runs live: which tick it is, which boxes are in force, how much may be sent, and the
//! health of the cameras.
//!
//! Time is an argument everywhere, as microseconds of a clock that the caller reads; the same calls give the
//! same answers. The shell that reads clocks, cameras and sockets is `node::live`.

pub mod budget;
pub mod capture;
pub mod delivery;
pub mod detection_schedule;
pub mod failures;
pub mod health;
pub mod newest_boxes;
pub mod own_boxes;
pub mod rate;
pub mod refusal;
pub mod round_robin;
pub mod tick_clock;
pub mod timecode;

pub use farfield_proto::tick::{Micros, SECOND_US};
