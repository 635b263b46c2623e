//! Recordings as files: their writer, places, filling of holes, and retention.

mod file;
mod filler;
mod head;
mod on_demand;
mod queue;
mod retention;
mod thread;

pub use self::file::{OWN_RECORDING, check_place, is_for_many, without_end};
pub(super) use self::file::{RecordingFile, RecordingPlace};
pub(super) use self::head::head;
pub use self::on_demand::{RecordingOnDemand, RecordingsOnDemand};
#[cfg(test)]
pub(super) use self::queue::RecordingQueue;
pub(super) use self::thread::RecordingThread;
