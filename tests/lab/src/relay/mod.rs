//! A relay of datagrams between an edge and fusion. It simulates a radio bridge that is slow, far, noisy or cut, and counts
//! the traffic of both sides.
//!
//! [`RelayLink`] models one direction: a bounded queue before a rate, then loss, delay and reordering. It has no socket and no
//! clock; time is an argument, and the same seed gives every datagram the same fate. [`UdpRelay`] connects two of them to
//! sockets.

#[cfg(test)]
mod laws;
mod link;
mod meter;
mod udp;

pub use link::{Counts, Impairment, RelayLink, on_the_wire};
pub use meter::ByteMeter;
pub use udp::{Direction, UdpRelay};
