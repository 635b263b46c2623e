//! Calibration of cameras: intrinsics, and extrinsics over a wide field. Pure: values and text in, values and text out.

pub mod adjustment;
pub mod alignment;
pub mod ball;
pub mod board;
pub mod formats;
pub mod geometry;
pub mod people;
pub mod points;
pub mod report;
