//! What the shell of every Farfield node needs, written once: edge, fusion and recorder are processes with
//! the same clock.
//!
//! [`clock`] is the only file of the workspace's nodes that reads the machine's clock.

pub mod clock;
