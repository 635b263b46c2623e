//! The one skeleton of all exports: 20 bones at our joints, in a T-pose with identity rest rotations.
//!
//! Bone frames at rest are all parallel to the body: x forward, y left, z up, palms down, feet flat. So a bone's
//! rotation against its parent is the identity at rest, and what a program draws when it ignores the motion is a
//! T-pose. [`Rig`] is a person's skeleton at rest, [`Motion`] one pose of it, [`BoneNames`] what bones are called.
//!
//! ```text
//!   world_from_bone(t) = world_from_link(t) R_rest⁻¹            R_rest: link from neutral (arms hang) to rest
//!   head_m(bone) = head_m(parent) + world_from_bone(parent) rest_offset_m(bone)
//! ```

mod angles;
mod bones;
mod motion;
mod names;
mod rig;

pub use angles::{Angles, angles_of, pose_of, zxy, zxy_rotation};
pub use bones::{Bone, N_BONES};
pub use motion::{Motion, links_of};
pub use names::BoneNames;
pub use rig::{Offsets, RestPose, Rig};

#[cfg(test)]
pub(crate) mod tests;
