//! Streams poses live in the protocols of other programs.
//!
//! [`Streams`] is the entry point: start it with a list of [`StreamSpec`], pass the poses of each
//! tick, read a [`StreamReport`], stop it. Fusion never waits for it: a slot holds the newest tick,
//! and every stream and every client is a task that reads the slot when it can. Slow clients skip
//! ticks, which is counted. A client that hangs is disconnected after ten seconds and does not
//! affect others.
//!
//! | module | content |
//! | --- | --- |
//! | [`people`] | unique names, and fixed places |
//! | [`frame`] | input of all streams: people of a tick, pose of the export skeleton, roster |
//! | [`qtm`] | real-time protocol of Qualisys Track Manager: TCP, XML, components |
//! | [`vmc`] | Virtual Motion Capture: OSC over UDP, one person per port |
//! | [`websocket`] | JSON for other programs |
//! | [`foxglove`] | Foxglove's WebSocket protocol, for Foxglove and Lichtblick |
//! | [`psn`] | PosiStageNet: positions of people, for lighting desks |
//! | `over_zenoh` | JSON on Zenoh keys, and ROS 2 through `rmw_zenoh`; feature `zenoh` |
//! | [`lsl`] | Lab Streaming Layer, for laboratory recorders |
//! | [`ros`] | ROS 2 messages |
//!
//! Encoders are pure: a frame in, bytes out. None of these protocols has authentication, so streams
//! stay on the loopback unless an address is given ([`StreamSpec::leaves_this_machine`]).

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
mod slot;
mod spec;
mod streams;
pub mod synthetic;
pub mod vmc;
mod wall_clock;
pub mod websocket;

pub use frame::{Frame, FrameMaker, PersonFrame, Roster, RosterEntry, VenueFacts};
pub use spec::{SpecError, StreamKind, StreamSpec, VMC_PORTS};
pub use streams::{StreamError, StreamReport, Streams};
