//! Recordings as files: who writes them, when, for how long they are kept.

mod file;
mod filler;
mod head;
mod on_demand;
mod queue;
mod retention;
mod thread;
mod unended;

pub use self::file::{OWN_RECORDING, check_place, is_for_many};
pub(super) use self::file::{RecordingFile, RecordingPlace};
pub(super) use self::head::head;
pub use self::on_demand::{RecordingOnDemand, RecordingsOnDemand};
#[cfg(test)]
pub(super) use self::queue::RecordingQueue;
pub(super) use self::thread::RecordingThread;
pub use self::unended::without_end;
