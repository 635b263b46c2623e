//! One tick of one person: from the patches of all views to the pose and its prediction.
//!
//! ```text
//!   patches -> estimator: one person from tick to tick
//!   patches -> evidence: views -> predict, occlusion: expected keypoints and weights of views
//!           -> left_right_swap, peak_assignment: owners of peaks -> lattice: keypoints
//!           -> keypoint_targets -> inverse kinematics -> joint_filter -> separation, feet -> inverse kinematics
//!           -> uncertainty
//! ```
//!
//! Nothing here knows ids or phases; persons interact only at barriers.

pub mod estimator;
pub mod evidence;
pub(crate) mod feet;
pub mod joint_filter;
pub(crate) mod keypoint_targets;
pub mod lattice;
pub(crate) mod left_right_swap;
#[cfg(test)]
pub(crate) mod meeting_fixture;
pub mod occlusion;
pub mod peak_assignment;
pub mod predict;
pub mod separation;
pub mod triangulate;
pub mod uncertainty;
