//! The simulated venue of Farfield: people whose truth is a pure function of time, and cameras that see
//! them.

pub mod body;
pub mod embedded;
mod embedded_files;
pub mod fault_profile;
pub mod faults;
pub mod keypoint_venue;
pub mod look_at;
pub mod maps_file;
pub mod motion;
mod normal;
pub mod render;
pub mod scene;
pub mod simulated;
pub mod walker;
