//! Persons: how they are found among the sightings of several viewpoints, measured, followed, and
//! let go.
//!
//! ```text
//!   sightings -> witness -> association -> reconstruct, plausibility -> birth: SightedPerson
//!   SightedPerson of some ticks, or points given by hand -> observed
//!             -> proportions (segment), initial_pose (limbs) -> fit: skeleton and first pose
//!   skeleton, pose -> track, with its life, in the crowd
//! ```
//!
//! Everything is compared in the world, in metres: cameras differ, and people lie, crouch and stand
//! on their hands.

pub mod birth;
pub mod crowd;
pub mod fit;
mod ghosts;
pub mod journal;
pub mod life;
pub mod observed;
pub mod track;

mod association;
mod feet;
mod initial_pose;
mod limbs;
mod plausibility;
mod proportions;
mod reconstruct;
mod remeasure;
#[cfg(test)]
mod scene;
mod segment;
mod settle;
mod sites;
mod witness;
