//! Simulated venues with exact truth: people who move, and cameras that see them.
//!
//! Read [`scene`] first. A [`scene::Scene`] gives the position of every person as a pure function
//! of time, and the cameras. Then read [`simulated`]: it offers the cameras of a scene as sources
//! of a venue, so that an edge runs on them as on real cameras.
//!
//! | module | content |
//! | --- | --- |
//! | [`motion`] | motion clips as anatomical joints over time |
//! | [`body`] | bodies with volume, built around the joints |
//! | [`render`] | pictures of these bodies, for edges that run networks |
//! | [`faults`], [`fault_profile`] | maps made from the truth without pictures, with the faults of real networks |
//! | [`maps_file`] | such maps, computed in advance and stored in a file |
//! | [`recorded_venue`] | the messages that edges send about a crowd, in memory, to measure fusion |
//! | [`embedded`] | the clips, scenes and networks inside the program |
//! | [`walker`], [`keypoint_venue`] | a person who walks in a circle, and a small venue of such people, for tests |
//! | [`look_at`] | the pose of a camera that points at a target |

pub mod body;
pub mod embedded;
pub mod fault_profile;
pub mod faults;
pub mod keypoint_venue;
pub mod look_at;
pub mod maps_file;
pub mod motion;
mod normal;
pub mod recorded_venue;
pub mod render;
pub mod scene;
pub mod simulated;
pub mod walker;
