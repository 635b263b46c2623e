//! The skeletal model: 29 joints, 40 degrees of freedom, constant link lengths per person.
//!
//! Coordinates are the world's (metres, z up); link frames are x forward, y left, z up in the
//! neutral pose. Angles are radians. The model computes with a quaternion at the root and swing and
//! twist at the shoulders; what it reports are the angles of [`ANGLE_NAMES`].

pub mod angles;
pub mod dof;
mod joint;
mod kinematics;
mod model;
pub mod range_of_motion;
mod shoulder;

pub use angles::{ANGLE_NAMES, N_ANGLES, reported_angles};
pub use dof::{N_DOF, N_JOINT_DOF, N_ROOT_DOF, chain_of};
pub use joint::{Joint, Link, N_JOINTS, N_LINKS, Side};
pub use kinematics::{Joints, Kinematics};
pub use model::{
    Pose, Proportions, ProportionsError, Site, Skeleton, shoulder_coordinates, sites_of,
};
pub use range_of_motion::RangeOfMotion;
pub(crate) use shoulder::wrap;

#[cfg(test)]
mod tests;
