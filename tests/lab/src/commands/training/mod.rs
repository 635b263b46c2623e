//! Rendered people to train and measure the embedded networks on: crops for the pose network, pictures
//! for the detector.

mod camera;
pub(super) mod crops;
pub(super) mod frames;
mod people;
mod photo;
mod scenery;
mod shards;
