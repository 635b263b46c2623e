//! Patches in, skeletons and boxes out: what runs in the fusion node.
//!
//! The core is pure: values in, values out, no clock, no socket, no lock. It never sees an image.
//! `node` owns Zenoh, time and threads; [`export`] turns poses into files that others read.

pub mod align;
pub mod assign;
pub mod boxes;
pub mod evidence;
pub mod export;
pub mod ik;
pub mod lattice;
pub mod live;
#[cfg(feature = "node")]
pub mod node;
pub mod occlusion;
pub mod person;
pub mod pipeline;
pub mod predict;
#[cfg(feature = "recording")]
pub mod recording;
pub mod skeleton;
pub mod smooth;
pub mod smoother;
pub mod triangulate;
pub mod uncertainty;
