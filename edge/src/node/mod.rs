//! The async shell of an edge. It owns Zenoh, time and threads. It processes a tick when fusion's
//! boxes arrive, or in live mode when the tick comes.
//!
//! Stages: load (nothing opened), build (everything that can fail is opened), run, drain.

mod acceleration;
mod attempts;
mod beyond_view;
mod build;
mod compare;
mod config;
mod frames_at;
mod handout;
mod link;
mod live;
mod lockstep;
mod parts;
mod reminder;
mod ring;
mod run;
mod stage_times;
mod worker;
mod workers;

pub use self::acceleration::{Acceleration, accelerate};
pub use self::build::{Networks, load_networks, probe_sources};
pub use self::config::EdgeArgs;
pub use self::run::main;
pub use self::workers::{Workers, find_workers};
