//! Pixels in, patches out: what runs in the edge box of one viewpoint.
//!
//! Read [`pipeline`] first: [`pipeline::EdgePipeline::step`] is one tick from frames and boxes to patches and
//! sightings, and calls the other parts in order: [`choose`] (which camera serves a person), [`crop`] (box in a [`picture`] to network
//! input), [`inference`] (what is asked of networks), [`tiles`] (where the detector runs), [`gaussian_maps`] (sources
//! without pixels), [`peaks`]. Then [`live`]: what an edge decides by its clock and its link, with time as an argument.
//! [`thumbnail`] makes pictures small for people to look at, where the venue allows it.
//!
//! These compute and never wait. [`source`] reads frames, `network` and `detector` run ONNX, [`ring`] is the layout of
//! the edge's store, and `node` owns Zenoh, clock, files and threads. This crate never sees another viewpoint, and
//! never a 3D pose.

pub mod box_parts;
pub mod choose;
pub mod crop;
#[cfg(feature = "network")]
pub mod detector;
#[cfg(test)]
mod fixtures;
pub mod gaussian_maps;
#[cfg(feature = "network")]
mod guarded;
pub mod inference;
pub mod live;
#[cfg(feature = "network")]
pub mod network;
#[cfg(feature = "node")]
pub mod node;
pub mod peaks;
pub mod picture;
pub mod pipeline;
pub mod ring;
pub mod source;
pub mod thumbnail;
pub mod tiles;
