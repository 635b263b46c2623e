//! What both sides of Farfield must agree on.
//!
//! Read [`message`] first: its types are everything that nodes send to each other, and name most of what else is here.
//! [`wire`] is how they become bytes, [`key`] and [`transport`] under which names and settings these travel, [`patch`]
//! the codec of the maps inside. [`frames`] and [`camera`] are the geometry, [`venue`], [`calibration`] and
//! [`model_card`] the files of a venue, [`id`] and [`tick`] what everything is numbered by.
//!
//! No file, no clock, no socket, no async: text in, values out; whoever opens files is `farfield-node` or the caller. A
//! type that only one node uses lives in that node, not here.

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
