//! Persons: how they are found among the sightings of several viewpoints, measured, followed, and
//! let go.
//!
//! ```text
//!   sightings -> witness -> association -> reconstruct, plausibility -> birth: SightedPerson
//!   SightedPerson of some ticks, or points given by hand -> observed
//!             -> proportions (segment), initial_pose (limbs) -> fit: skeleton and first pose
//!   skeleton, pose -> track, with its life, in the crowd -> told: poses and boxes
//!   tentative: trial (contradiction, still) -> recognise: who was here before (memory)
//!   what nothing explains -> lookout: which cameras look again
//! ```
//!
//! Everything is compared in the world, in metres: cameras differ, and people lie, crouch and stand
//! on their hands.

pub(crate) mod aims;
pub mod birth;
pub mod contests;
pub mod crowd;
pub mod fit;
mod ghosts;
pub mod journal;
pub mod life;
pub mod method;
pub mod observed;
pub mod separation;
pub mod track;

mod association;
mod contradiction;
mod exchange;
mod explain;
pub(crate) mod feet;
mod initial_pose;
mod limbs;
mod lookout;
#[cfg(test)]
mod meeting_fixture;
mod memory;
mod plausibility;
mod proportions;
mod recognise;
mod reconstruct;
mod remeasure;
#[cfg(test)]
mod scene;
mod segment;
mod settle;
mod sites;
mod still;
mod told;
mod trial;
mod witness;
