//! Poses as live streams in the protocols that other programs speak.
//!
//! [`Streams`] is the whole of it: started with a list of [`StreamSpec`], given a tick's poses at a time, asked for a
//! [`StreamReport`], stopped. Fusion's shell gives it what it publishes and never waits for it: between the two is a slot
//! that holds the newest tick, and every stream, and every client of one, is a task that reads it when it can. Who is slow
//! skips ticks, which is counted; who hangs is left after ten seconds, and harms nobody meanwhile.
//!
//! | module | what |
//! | --- | --- |
//! | [`people`] | names that differ, places that are kept |
//! | [`frame`] | what all streams draw from: a tick's persons, the export skeleton's pose, the roster |
//! | [`qtm`] | the real-time protocol of Qualisys Track Manager: TCP, XML, components |
//! | [`vmc`] | Virtual Motion Capture: OSC over UDP, one person per port |
//! | [`websocket`] | JSON for everybody else |
//! | [`foxglove`] | Foxglove's WebSocket protocol, for its program and Lichtblick |
//! | [`psn`] | PosiStageNet: where people are, for lighting desks |
//! | `over_zenoh` | JSON on a key, and ROS 2 by `rmw_zenoh`; with the feature `zenoh` |
//! | [`lsl`] | Lab Streaming Layer, for recorders of laboratories |
//! | [`ros`] | messages of ROS 2 |
//!
//! Encoders are pure: a frame in, bytes out. None of these protocols knows keys: streams keep to the loopback unless an
//! address says otherwise ([`StreamSpec::leaves_this_machine`]).

mod connection;
pub mod foxglove;
pub mod frame;
pub mod lsl;
#[cfg(feature = "zenoh")]
mod over_zenoh;
pub mod people;
pub mod psn;
pub mod qtm;
pub mod ros;
mod server;
mod shell;
mod slot;
mod spec;
mod streams;
pub mod synthetic;
mod udp;
pub mod vmc;
mod wall_clock;
pub mod websocket;

pub use frame::{Frame, FrameMaker, PersonFrame, Roster, RosterEntry, VenueFacts};
pub use spec::{SpecError, StreamKind, StreamSpec, VMC_PORTS};
pub use streams::{StreamError, StreamReport, Streams};
