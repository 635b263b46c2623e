//! The edge's store of its own sets: a ring of segments. Each record has its length and checksum, so that a record that
//! a killed edge had not finished writing is recognised.
//!
//! [`record`] is the layout of the bytes, [`index`] says what is where. Files are opened in `node::ring`.
//!
//! ```text
//!   segment = magic (8)  number (8)  record*
//!   record  = length of the message (4)  checksum of what follows (4)  session (8)  tick (8)  kind (1)  message
//! ```
//!
//! Numbers are little-endian. A segment ends where no whole record follows.

pub mod index;
pub mod record;
