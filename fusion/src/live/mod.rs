//! The pure parts of fusion's live mode: which tick is stepped when and with which messages, the
//! state of every edge's clock and link, and how far ahead its boxes are made.
//!
//! No clock here: times are arguments, as [`Micros`] of the venue's clock, and the same calls give
//! the same results. The shell that reads the clock and the sockets is `live` in the crate `fusion/node`.

pub mod arrivals;
pub mod cameras;
pub mod common_plan;
pub mod edge;
#[cfg(any(test, feature = "fixtures"))]
pub mod fixture;
pub mod gather;
pub mod horizon;
pub mod late_detections;
pub mod membership;
pub mod meter;
pub mod pace;
pub mod queue;
pub mod shedding;
pub mod target_latency;
pub mod tick_time;

pub use farfield_proto::tick::{Micros, SECOND_US};
