//! What an edge keeps of its sets: a ring of segments, each record with its length and checksum, so that
//! what a killed edge had not finished writing is told from what it had.
//!
//! [`record`] is the bytes, [`index`] what is where. Files are the shell's affair.
//!
//! ```text
//!   segment = magic (8)  number (8)  record*
//!   record  = length of the message (4)  checksum of what follows (4)  session (8)  tick (8)  kind (1)  message
//! ```
//!
//! Numbers are little-endian. A segment ends where no whole record follows.

pub mod index;
pub mod record;
