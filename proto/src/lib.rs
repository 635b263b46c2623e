//! What both sides of Farfield must agree on: ids and ticks, typed coordinate frames, the camera
//! model, the calibration and venue files, boxes, the patch codec, messages and key expressions.
//!
//! No I/O beyond parsing text that the caller has read, no clock, no async. A type that only one
//! node uses lives in that node, not here.

pub mod bounding_box;
pub mod calibration;
pub mod camera;
pub mod decision;
pub mod endpoint;
pub mod fill;
pub mod frames;
pub mod grid;
pub mod handout;
pub mod histogram;
pub mod id;
pub mod key;
pub mod keypoints;
pub mod live;
pub mod message;
pub mod model_card;
pub mod patch;
pub mod tick;
pub mod toml_file;
pub mod transport;
pub mod venue;
pub mod wire;
