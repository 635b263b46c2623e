//! Trained networks from the packages of others.
//!
//! Farfield contains no trained weights of others. [`convert`] makes ONNX files of theirs.
//!
//! No module runs a network: the edge does.

pub mod convert;
#[cfg(test)]
mod fixture;
mod onnx;
mod tflite;

pub use self::tflite::TfliteError;
