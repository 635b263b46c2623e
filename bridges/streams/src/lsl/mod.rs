//! Lab Streaming Layer, as an outlet: found by UDP, sent by TCP, with a clock that inlets can ask for.
//!
//! Source: the protocol as `liblsl` speaks it, version 1.10, with the older 1.00 for inlets that can no more;
//! <https://labstreaminglayer.readthedocs.io>; metadata as XDF's, <https://github.com/sccn/xdf/wiki>.
//!
//! One stream of the type `MoCap`, whose channels never change: the tick, and for each of [`PLACES`] people an id, whether the person is
//! seen, and the joints ([`sample`]). Who comes takes the first free place and keeps it; the numbers of a place that nobody has are
//! not a number, its id is 0. Beyond [`PLACES`] people nobody gets one.
//!
//! | module | what |
//! | --- | --- |
//! | [`info`] | what the stream is, in XML |
//! | [`query`] | whether that is what somebody looks for |
//! | [`request`] | what inlets ask, by TCP and by UDP |
//! | [`sample`] | the numbers of a frame, as channels and as bytes |
//! | `outlet`, `server` | the newest sample, stamped; the tasks |
//! | `unsent` | what waits for one inlet |

pub mod info;
mod outlet;
pub mod query;
pub mod request;
pub mod sample;
mod server;
mod unsent;

pub(crate) use self::server::serve;

/// People whose joints have channels.
pub const PLACES: u16 = 8;
/// The version of the protocol that is spoken, hundredths.
pub const VERSION: u32 = 110;
/// The version that inlets speak which know no other, hundredths.
pub const OLD_VERSION: u32 = 100;
/// The port that inlets ask at who looks for what, on this machine, by broadcast and by multicast.
pub const DISCOVERY_PORT: u16 = 16571;
/// Ports of an outlet, from the first: those that inlets try of a machine that they know.
pub const PORTS: u16 = 32;
