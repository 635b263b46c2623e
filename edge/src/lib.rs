//! Pixels in, patches out: the software of the edge computer of one viewpoint.
//!
//! Read [`pipeline`] first: [`pipeline::EdgePipeline::step`] computes one tick, from frames and
//! boxes to patches and sightings. It calls the other parts in order: [`choose`] (the camera for a
//! person), [`crop`] (from a box in a [`picture`] to network input), [`inference`] (interfaces of
//! networks), [`tiles`] (where the detector runs), [`gaussian_maps`] (sources without pixels),
//! [`peaks`]. Then read [`live`]: decisions by clock and link, with time as an argument.
//! [`thumbnail`] makes small pictures for people, if the venue allows it.
//!
//! These modules compute and never wait. [`source`] reads frames, `network` and `detector` run
//! ONNX, [`ring`] defines the layout of the edge's store, and `node` owns Zenoh, clock, files and
//! threads. This crate never sees another viewpoint or a 3D pose.

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
