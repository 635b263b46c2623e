//! Forward kinematics and the analytic Jacobian.
//!
//! Every DoF but the root's translation is a rotation about a world axis `a` (not always a unit
//! vector) through a centre `c`, so a point `p` on a link below it moves by a × (p - c) per unit.

use nalgebra::{Matrix3, Vector3};

use super::dof::{Axis, DofMotion, LINKS, N_DOF, N_ROOT_DOF};
use super::joint::{Joint, Link, N_JOINTS, N_LINKS};
use super::model::{Pose, Site, Skeleton};
use super::shoulder::turn_about;

/// The 29 joints of one person, world, metres, in the order of [`Joint`].
pub type Joints = [Vector3<f64>; N_JOINTS];

/// A body in one pose: filled by [`Skeleton::forward`], reused from call to call.
#[derive(Debug, Clone)]
pub struct Kinematics {
    /// The joints in the world, metres, indexed by [`Joint::index`].
    pub joints_m: [Vector3<f64>; N_JOINTS],
    /// World from link, indexed by `Link as usize`.
    pub rotations: [Matrix3<f64>; N_LINKS],
    /// World axis per DoF: angular velocity per unit of the DoF (for the root's translation the
    /// direction of the motion).
    pub axes: [Vector3<f64>; N_DOF],
    /// Centre of each DoF's rotation in the world, metres.
    pub centres_m: [Vector3<f64>; N_DOF],
}

impl Default for Kinematics {
    fn default() -> Self {
        Self {
            joints_m: [Vector3::zeros(); N_JOINTS],
            rotations: [Matrix3::identity(); N_LINKS],
            axes: [Vector3::zeros(); N_DOF],
            centres_m: [Vector3::zeros(); N_DOF],
        }
    }
}

impl Kinematics {
    /// A joint in the world, metres.
    pub fn joint_m(&self, joint: Joint) -> Vector3<f64> {
        self.joints_m[joint.index()]
    }

    /// World from link.
    pub fn rotation(&self, link: Link) -> &Matrix3<f64> {
        &self.rotations[link as usize]
    }

    /// A keypoint's site in the world, metres.
    pub fn site_m(&self, site: &Site) -> Vector3<f64> {
        self.joint_m(site.joint) + self.rotation(site.joint.link()) * site.offset_m
    }

    /// The Jacobian column of a world point (metres) that `dof` moves: its motion per unit of the
    /// DoF (of all 40). For other points the column is zero, and this is not valid; see
    /// [`chain_of`](super::chain_of).
    pub fn moving_column(&self, dof: usize, point_m: &Vector3<f64>) -> Vector3<f64> {
        if dof < 3 {
            self.axes[dof]
        } else {
            self.axes[dof].cross(&(point_m - self.centres_m[dof]))
        }
    }

    /// The Jacobian column of a world point (metres) that is fixed to `link`, for any DoF.
    #[cfg(test)]
    pub(crate) fn column(&self, dof: usize, link: Link, point_m: &Vector3<f64>) -> Vector3<f64> {
        if super::chain_of(link).contains(&dof) {
            self.moving_column(dof, point_m)
        } else {
            Vector3::zeros()
        }
    }
}

impl Skeleton {
    /// Places every joint, link, axis and centre for `pose`. No allocation; about a microsecond.
    pub fn forward(&self, pose: &Pose, into: &mut Kinematics) {
        let mut origins_m = [Vector3::zeros(); N_LINKS];
        for (l, spec) in LINKS.iter().enumerate() {
            let parent = spec.parent as usize;
            let (mut rotation, origin_m) = if let DofMotion::Free = spec.motion {
                (
                    pose.root_rotation.to_rotation_matrix().into_inner(),
                    pose.root_m,
                )
            } else {
                let up = into.rotations[parent];
                (
                    up,
                    origins_m[parent] + up * self.offset_m[spec.origin.index()],
                )
            };
            let first = spec.first_dof;
            match spec.motion {
                DofMotion::Free => {
                    for (k, direction) in Matrix3::identity().column_iter().enumerate() {
                        into.axes[k] = direction.into_owned();
                        into.axes[3 + k] = rotation.column(k).into_owned();
                        into.centres_m[3 + k] = origin_m;
                    }
                }
                DofMotion::Turns(turns) => {
                    for (k, turn) in turns.iter().enumerate() {
                        let column = match turn.axis {
                            Axis::X => 0,
                            Axis::Y => 1,
                            Axis::Z => 2,
                        };
                        into.axes[first + k] = rotation.column(column) * turn.sign;
                        into.centres_m[first + k] = origin_m;
                        let angle = turn.sign * pose.dof[first - N_ROOT_DOF + k];
                        turn_about(&mut rotation, turn.axis, angle);
                    }
                }
                DofMotion::Shoulder(side) => {
                    let q = &pose.dof[first - N_ROOT_DOF..first - N_ROOT_DOF + 3];
                    let state = self.shoulders[side as usize].evaluate(q);
                    for (k, axis) in state.axes.iter().enumerate() {
                        into.axes[first + k] = rotation * axis;
                        into.centres_m[first + k] = origin_m;
                    }
                    rotation *= state.rotation;
                }
            }
            into.rotations[l] = rotation;
            origins_m[l] = origin_m;
        }
        for joint in Joint::ALL {
            let l = joint.link() as usize;
            into.joints_m[joint.index()] =
                origins_m[l] + into.rotations[l] * self.offset_m[joint.index()];
        }
    }
}
