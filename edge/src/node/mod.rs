//! The async shell of an edge: it owns Zenoh, time and threads, and works on a tick when fusion's boxes
//! for it arrive.
//!
//! Load (nothing opened) -> build (everything that can fail is opened) -> run -> drain.

mod build;
mod clock;
mod config;
mod frames_at;
mod link;
mod lockstep;
mod process;
mod run;
mod worker;

pub use self::build::{Networks, load_networks, probe_sources};
pub use self::config::EdgeArgs;
pub use self::run::main;
