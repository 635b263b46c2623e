//! The skeleton of all exports: 20 bones at our joints, in a T-pose with identity rest rotations.
//!
//! Bone frames at rest are parallel to the body: x forward, y left, z up, palms down, feet flat. So
//! a bone's rotation relative to its parent is the identity at rest, and a program that ignores the
//! motion shows a T-pose. [`Rig`] is a person's skeleton at rest, [`Motion`] one pose of it,
//! [`BoneNames`] the names of the bones.
//!
//! ```text
//!   world_from_bone(t) = world_from_link(t) R_rest⁻¹            R_rest: link from neutral (arms hang) to rest
//!   head_m(bone) = head_m(parent) + world_from_bone(parent) rest_offset_m(bone)
//! ```

mod bones;
mod motion;
mod names;
mod rig;

pub use bones::{Bone, N_BONES};
pub use motion::{Angles, Motion, angles_of, links_of, pose_of, zxy, zxy_rotation};
pub use names::BoneNames;
pub use rig::{Offsets, RestPose, Rig};

#[cfg(test)]
pub(crate) mod tests;
