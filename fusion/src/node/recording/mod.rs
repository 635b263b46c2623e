//! Recordings as files: who writes them, when, for how long they are kept.

mod filler;
mod head;
mod place;
mod queue;
mod retention;
mod thread;

pub(super) use self::head::head;
pub(super) use self::place::Place;
pub use self::place::check_place;
pub(super) use self::thread::RecordingThread;
