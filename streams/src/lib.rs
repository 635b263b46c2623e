//! Poses as live streams in the protocols that other programs speak.
//!
//! | module | what |
//! | --- | --- |
//! | [`frame`] | what all streams draw from: a tick's persons, the export skeleton's pose, the roster |
//! | [`qtm`] | the real-time protocol of Qualisys Track Manager: TCP, XML, components |
//!
//! Encoders are pure: a frame in, bytes out. None of these protocols knows keys: streams keep to the loopback unless an
//! address says otherwise ([`StreamSpec::leaves_this_machine`]).

pub mod frame;
pub mod qtm;
mod spec;
pub mod synthetic;

pub use frame::{Frame, FrameMaker, PersonFrame, Roster, RosterEntry, VenueFacts};
pub use spec::{SpecError, StreamKind, StreamSpec, VMC_PORTS};
