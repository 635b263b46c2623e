//! Calibration of a wide field: how each camera sees (intrinsics), and where it stands (extrinsics). Pure: values and text
//! in, values and text out.

pub mod adjustment;
pub mod alignment;
pub mod ball;
pub mod board;
pub mod formats;
pub mod geometry;
pub mod people;
pub mod points;
pub mod report;
