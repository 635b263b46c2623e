//! Lab Streaming Layer outlet: discovered by UDP, sent by TCP, with a clock that inlets can query.
//!
//! Source: the protocol of `liblsl`, version 1.10, with the older 1.00 for inlets that support no
//! more; <https://labstreaminglayer.readthedocs.io>; metadata as in XDF,
//! <https://github.com/sccn/xdf/wiki>.
//!
//! There is one stream of the type `MoCap` with constant channels: the tick, and for each of
//! [`PLACES`] people an id, whether the person is seen, and the joints ([`sample`]). A new person
//! gets the first free place and keeps it. An empty place has the id 0 and NaN as values. People
//! beyond [`PLACES`] get no place.
//!
//! | module | content |
//! | --- | --- |
//! | [`info`] | description of the stream, in XML |
//! | [`query`] | evaluation of inlets' queries |
//! | [`request`] | requests of inlets, by TCP and UDP |
//! | [`sample`] | values of a frame, as channels and bytes |
//! | `outlet`, `server` | the newest sample with its stamp, and the queue of an inlet; the tasks |

pub mod info;
mod outlet;
pub mod query;
pub mod request;
pub mod sample;
mod server;

pub(crate) use self::server::serve;

/// People whose joints have channels.
pub const PLACES: u16 = 8;
/// Supported protocol version, hundredths.
pub const VERSION: u32 = 110;
/// Oldest supported protocol version, hundredths.
pub const OLD_VERSION: u32 = 100;
/// Port for discovery queries on this machine, by broadcast and by multicast.
pub const DISCOVERY_PORT: u16 = 16571;
/// Number of ports of an outlet from the first one; inlets try them on known machines.
pub const PORTS: u16 = 32;
