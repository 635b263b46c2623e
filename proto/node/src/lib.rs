//! What the shell of every Farfield node needs, written once: edge, fusion and recorder are processes with
//! the same clock, the same signals, the same log and a session with each other.
//!
//! Start with [`process`]: how a node ends, and what it says then. [`session`] is how it speaks with others. [`clock`] is the only file of the
//! workspace's nodes that reads the machine's clock.

pub mod clock;
pub mod endpoints;
pub mod files;
pub mod log;
pub mod process;
pub mod runtime;
pub mod session;
