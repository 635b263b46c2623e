//! Our own relay of datagrams, so that loss is loss: between an edge and fusion it stands for a radio
//! bridge that is slow, far, noisy or cut, and counts as a referee what each side has sent.
//!
//! [`RelayLink`] is the model of one direction: a bounded queue before a rate, then loss, delay and
//! disorder. It knows no socket and no clock; time is passed in, and the same seed gives every
//! datagram the same fate. [`UdpRelay`] is the thin shell that puts two of them between sockets.

mod clock;
#[cfg(test)]
mod laws;
mod link;
mod meter;
mod udp;

pub use link::{Counts, Impairment, RelayLink, on_the_wire};
pub use meter::ByteMeter;
pub use udp::{Direction, UdpRelay};
