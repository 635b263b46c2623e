//! Patches in, skeletons and boxes out: what runs in the fusion node.
//!
//! The core is pure: values in, values out, no clock, no socket, no lock. It never sees an image.
//! `node` owns Zenoh, time and threads; [`export`] turns poses into files that others read.

pub mod align;
pub mod assign;
pub mod body;
pub mod boxes;
pub mod estimate;
pub mod export;
pub mod identity;
pub mod journal;
pub mod live;
pub mod method;
#[cfg(feature = "node")]
pub mod node;
pub mod pipeline;
#[cfg(feature = "recording")]
pub mod recording;
pub mod sightings;
pub mod smoother;
