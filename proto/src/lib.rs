//! The shared definitions of both sides of Farfield.
//!
//! Read [`message`] first: its types are everything that nodes send to each other. [`wire`]
//! converts them to bytes, [`key`] and [`transport`] define keys and settings, and [`patch`] is the
//! codec of the maps. [`frames`] and [`camera`] are the geometry. [`venue`], [`calibration`] and
//! [`model_card`] are the files of a venue. [`id`] and [`tick`] are its identifiers.
//!
//! The crate uses no file, clock, socket or async code: functions take text or values and return
//! values. `farfield-node` or the caller opens files. A type that only one node uses is defined in
//! that node.

pub mod bounding_box;
pub mod calibration;
pub mod camera;
pub mod court;
pub mod finding;
pub mod frames;
pub mod grid;
pub mod id;
pub mod key;
pub mod keypoints;
pub mod message;
pub mod model_card;
pub mod order_statistics;
pub mod patch;
pub mod person_name;
pub mod plain_text;
pub mod plausibility;
pub mod printed;
pub mod secrets;
pub mod subject;
pub mod tick;
pub mod toml_file;
pub mod transport;
pub mod venue;
pub mod wire;
