//! The ring on disk: messages that a live edge sent or could not send. Fusion fetches them after an
//! outage.
//!
//! Its own thread writes and reads it, so the pipeline never waits for the disk.

mod fill;
mod store;
mod thread;

pub(super) use self::fill::answer_questions;
pub(super) use self::thread::{RingHandle, RingThread};
