//! Rendered people to train and measure the embedded networks: crops for the pose network, images for the detector. A
//! training set is a number of files of records.

mod camera;
pub(super) mod crops;
pub(super) mod frames;
mod people;
mod photo;
mod scenery;
mod shards;
