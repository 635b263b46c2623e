//! The async shell of an edge. It owns Zenoh, time and threads. It processes a tick when fusion's
//! boxes arrive, or in live mode when the tick comes.
//!
//! Stages: load (nothing opened), build (everything that can fail is opened), run, drain.

mod acceleration;
mod attempts;
mod build;
mod config;
mod handout;
mod link;
mod live;
mod lockstep;
mod ring;
mod run;
mod worker;

pub use self::acceleration::{Acceleration, Workers, accelerate, find_workers};
pub use self::build::{Networks, load_networks, probe_sources};
pub use self::config::EdgeArgs;
pub use self::run::main;
