//! The pure parts of fusion's live mode: which tick is stepped when and over what, how every edge's clock
//! and link are, and how far ahead its boxes are made.
//!
//! No clock here: times are passed in, as [`Micros`] of the venue's clock, and the same calls give the
//! same answers. The shell that reads the clock and the sockets is `node::live`.

pub mod arrivals;
pub mod edge;
pub mod edge_clock;
pub mod gather;
pub mod horizon;
pub mod membership;
pub mod meter;
pub mod pace;
pub mod queue;
pub mod tick_time;

/// Microseconds since 1970 by the venue's clock, which is fusion's; and spans of it.
pub type Micros = i64;

/// Microseconds of a second.
pub const SECOND_US: Micros = 1_000_000;
