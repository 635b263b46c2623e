//! The fusion node of a venue: patches in, skeletons and boxes out.
//!
//! Read [`pipeline`] first: [`pipeline::Pipeline::step`] turns the patches and sightings of one
//! tick into poses, and into the boxes of the next crops. It calls the other parts:
//!
//! | module | what |
//! | --- | --- |
//! | [`align`] | gathers the messages of a tick from all viewpoints |
//! | [`estimate`] | one tick of one person: lattice search, inverse kinematics, filter, prediction, uncertainty |
//! | [`body`] | the skeleton, its measures, and the inverse kinematics that fit it to points |
//! | [`sightings`] | people that several viewpoints detected without a box |
//! | [`identity`] | who is who: tracks that begin, are confirmed, lost, recognised and dropped |
//! | [`boxes`] | predicted joints as regions of each camera |
//! | [`camera_agreement`] | whether the cameras agree, and why not |
//! | [`smoother`] | poses estimated again with later evidence |
//! | [`export`] | poses as text that other programs read |
//! | [`live`] | what fusion decides by clocks and deadlines, with time as an argument |
//!
//! [`method`] has the data that all persons of a venue share, [`assign`] assigns one set to
//! another. All of these compute and never wait: no clock, no socket, no lock. `recording` (feature
//! `recording`) reads and writes recordings. The crate `fusion/node` is the shell, which owns
//! Zenoh, time, threads and files. This crate never sees an image.

pub mod align;
pub mod assign;
pub mod body;
pub mod boxes;
pub mod camera_agreement;
pub mod estimate;
pub mod export;
pub mod identity;
pub mod journal;
pub mod live;
pub mod method;
pub mod pipeline;
#[cfg(feature = "recording")]
pub mod recording;
pub mod sightings;
pub mod smoother;
