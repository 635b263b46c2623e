//! Pixels in, patches out: what runs in the edge box of one viewpoint.
//!
//! The core ([`choose`], [`crop`], [`gaussian_maps`], [`peaks`], [`pipeline`], [`tiles`]) computes and never waits;
//! [`source`] reads frames, [`network`] runs ONNX, and `node` owns Zenoh, time and threads.
//! This crate never sees another viewpoint, and never a 3D pose.

pub mod choose;
pub mod crop;
#[cfg(feature = "network")]
pub mod detector;
#[cfg(test)]
mod fixtures;
pub mod gaussian_maps;
pub mod inference;
pub mod live;
#[cfg(feature = "network")]
pub mod network;
#[cfg(feature = "node")]
pub mod node;
pub mod peaks;
pub mod pipeline;
pub mod ring;
pub mod source;
pub mod tiles;
