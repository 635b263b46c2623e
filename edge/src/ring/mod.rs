//! The edge's store of its own sets: a ring of segments. Each record has its length and checksum,
//! so that an incomplete record of a killed edge is recognised.
//!
//! [`record`] defines the bytes, [`index`] the locations. Files are opened in `node::ring`.
//!
//! ```text
//!   segment = magic (8)  number (8)  record*
//!   record  = length of the message (4)  checksum of what follows (4)  session (8)  tick (8)  kind (1)  message
//! ```
//!
//! Numbers are little-endian. A segment ends before the first incomplete record.

pub mod index;
pub mod record;
