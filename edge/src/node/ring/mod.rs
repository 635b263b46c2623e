//! The ring on disk: what a live edge sent or could not send, for fusion to fetch after an outage.
//!
//! A thread of its own writes and reads it; the pipeline never waits for the disk.

mod fill;
mod store;
mod thread;

pub(super) use self::fill::answer_questions;
pub(super) use self::thread::{RingHandle, RingThread};
