//! The simulated venue of Farfield: people whose truth is a pure function of time, cameras that
//! see them, and the loop of edges and fusion inside one process, for tests and studies.

pub mod afar;
pub mod body;
#[cfg(feature = "loop")]
pub mod bytes;
#[cfg(feature = "loop")]
pub mod conditions;
pub mod embedded;
pub mod faults;
#[cfg(feature = "loop")]
pub mod in_process;
pub mod keypoint_venue;
#[cfg(feature = "loop")]
pub mod leave_one_out;
#[cfg(feature = "loop")]
pub mod live_venue;
pub mod maps_file;
pub mod motion;
pub mod namespaces;
mod normal;
pub mod relay;
pub mod render;
pub mod ring;
pub mod scene;
pub mod simulated;
#[cfg(feature = "loop")]
pub mod suite;
pub mod view_peaks;
pub mod walker;
