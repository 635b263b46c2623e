//! Simulated venues, whose truth is known exactly: people who move, and cameras that see them.
//!
//! Read [`scene`] first: a [`scene::Scene`] says who is where at any time, as a pure function of time, and what the
//! cameras are. Then [`simulated`]: the cameras of a scene as sources of a venue, by which an edge runs on them as on
//! real ones.
//!
//! | module | what |
//! | --- | --- |
//! | [`motion`] | motion clips as anatomical joints over time |
//! | [`body`] | bodies with volume, laid around the joints |
//! | [`render`] | pictures of these bodies, for edges that run networks |
//! | [`faults`], [`fault_profile`] | maps made from the truth without pictures, with the faults that networks have |
//! | [`maps_file`] | such maps made beforehand and kept in a file |
//! | [`recorded_venue`] | what edges send of a crowd, kept in memory, for whoever measures fusion |
//! | [`embedded`] | the clips, scenes and networks that the program carries |
//! | [`walker`], [`keypoint_venue`] | a person who walks in a circle, and a small venue of such people, for tests |
//! | [`look_at`] | where a camera is that looks at something |

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
pub mod recorded_venue;
pub mod render;
pub mod scene;
pub mod simulated;
pub mod walker;
