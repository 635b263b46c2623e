//! A person's body: the skeletal model, pose fitting to points in space, and measurement of a body.
//!
//! ```text
//!   points in space -> observed -> proportions (segment), limbs -> fit: skeleton and first pose
//!   the first seconds of a track -> measured: link lengths; sites: places of the network's keypoints
//!   a set of keypoints -> determined: what it can determine of a body; a pose -> stature
//! ```
//!
//! Everything is compared in the world, in metres: cameras differ, and people lie, crouch and stand
//! on their hands.

pub mod determined;
pub mod fit;
#[cfg(any(test, feature = "fixtures"))]
pub mod fixture;
pub mod ik;
mod limbs;
pub mod measured;
pub mod observed;
pub mod prior;
pub(crate) mod proportions;
pub(crate) mod segment;
mod sites;
pub mod skeleton;
pub(crate) mod stature;
