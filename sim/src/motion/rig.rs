//! Recognises a skeleton by the names of its bones, and places the 29 joints on it.
//!
//! **Bones are joints.** Shoulder, elbow, wrist, hip, knee and ankle are the origins of their
//! bones. The neck is the origin of the (lowest) neck bone, the scapula the origin of the collar
//! bone. The pelvis is the midpoint of the hips. Names are known in their usual forms (`LeftUpLeg`,
//! `left_hip`, `lThigh`, `CC_Base_L_Thigh`, `mixamorig:LeftLeg`).
//!
//! **Joints without a bone** are points fixed to the nearest bone, in shares of the clip's stature
//! (see below), forward, left and up relative to the bone in the neutral pose:
//!
//! | joint | position |
//! | --- | --- |
//! | spine (lumbosacral joint) | the first bone above the pelvis if it is 0.03-0.10 above the hips, else 0.07 above their midpoint |
//! | eyes | their bones; else 0.050 in front of, 0.015 above and 0.018 to the side of the head |
//! | head (between the ears) | 0.050 behind and 0.015 below the midpoint of the eyes; without eye bones 0.10 above the neck, in the head's axes |
//! | nose | 0.013 in front of and 0.022 below the midpoint of the eyes |
//! | ears | 0.042 to the side of the head |
//! | scapula, without collar bone | 0.02 in front of, 0.01 below and 0.02 to the side of the neck, fixed to the bone that carries the neck |
//! | hand | mean of the finger bones attached to the wrist (without the thumb), else the wrist's end site, else 0.05 beyond the wrist |
//! | heel | 0.035 below and 0.032 behind the ankle |
//! | toe (tip of the foot) | 0.035 below and 0.12 in front of the ankle in the neutral pose, fixed to the toe bone if any; a toe bone's own end site if it is 0.09-0.16 in front of the ankle. Without toe bones the toes bend at the ball of the foot (0.073 in front of the ankle) if they would be below the floor |
//!
//! There are four kinds of skeleton:
//!
//! * **iClone** (`CC_Base_*`): y up. Its zero pose is not a pose of a person: every bone runs along
//!   its own y. The axes are those of the rig: for trunk and head x left, y up, z forward. The
//!   foot's y runs along it, 15.5 degrees below the level when the foot is flat (measured over the
//!   standing frames of such clips); the toes' y is level. Fingers, single toes, twist and share
//!   bones are ignored.
//! * **Poser** (`lButtock`, `lShldr`: the Daz form of CMU's clips): the zero pose is a T-pose. The
//!   clips start in it and ring for a few frames, so [`Family::lead_frames`] are skipped. The
//!   abdomen bone is far above the sacrum, so the spine is placed by the table.
//! * **`DeepMimic`**: 15 joints, faces +x in its zero pose, arms hanging; no head, eyes or toes.
//! * **Standard names**: all other skeletons with the usual names whose zero pose stands upright, y
//!   or z up.
//!
//! The last three share one rule. In the zero pose every bone has the axes of the file; up is y or
//! z, whichever the body extends along; left is from the right hip to the left one.
//!
//! **Stature** is the sum of the segments. T is the path of the bones from the midpoint of the hips
//! to the neck, L is thigh and shank (mean of both sides), and H is the path from the neck to the
//! head bone and on to the height of the eyes. Then S = (L + T + H) / 0.90, because 0.035 are below
//! the ankle and 0.065 above the eyes. Without eyes S = (L + T) / 0.785, because 0.10 are from the
//! neck to the head and 0.08 above.

mod names;
mod placing;

use std::path::Path;

use farfield_fusion::body::skeleton::N_JOINTS;
use farfield_proto::toml_file::FileError;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use self::names::NamedBones;
use self::placing::Placing;
use super::bvh::Bvh;

/// The kind of skeleton of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Family {
    /// Reallusion iClone, `CC_Base_*`.
    Iclone,
    /// Poser and Daz: `lButtock`, `lShldr`.
    Poser,
    /// Usual names, upright zero pose; `DeepMimic` is one of them.
    Standard,
}

impl Family {
    /// Frames at the start of a file that are not motion: a T-pose, and the filter's ringing from
    /// it.
    pub const fn lead_frames(self) -> usize {
        match self {
            Self::Poser => 8,
            Self::Iclone | Self::Standard => 0,
        }
    }
}

/// A joint of the body: a point fixed to a bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BonePoint {
    /// The bone that carries it.
    pub bone: usize,
    /// Position in that bone's axes, file units.
    pub offset: Vector3<f64>,
}

/// The positions of the 29 joints on the bones of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct BoneRig {
    /// The kind of skeleton.
    pub family: Family,
    /// The clip skeleton's own stature, file units.
    pub stature_units: f64,
    /// Rotation from the file's axes to z up.
    pub z_up: UnitQuaternion<f64>,
    /// The joints, by [`Joint`](farfield_fusion::body::skeleton::Joint). The pelvis is the midpoint
    /// of the hips; its entry is ignored.
    pub sites: [BonePoint; N_JOINTS],
    /// The soles under the balls of the left and the right foot, if the rig has no toe bones.
    pub balls: Option<[BonePoint; 2]>,
}

/// Forward, left and up of the neutral pose, as columns in a bone's own axes.
type Axes = Matrix3<f64>;

/// The axes of each part of the body that carries points.
struct BodyAxes {
    body: Axes,
    foot: Axes,
    toe: Axes,
}

/// A smaller body is empty in any unit.
const SHORTEST_UNITS: f64 = 1e-6;

/// Dip of iClone's foot bone when the foot is flat, degrees.
const ICLONE_FOOT_DIP_DEG: f64 = 15.5;

impl BoneRig {
    /// Recognises the skeleton of `bvh`; errors name `path`.
    ///
    /// # Errors
    /// [`FileError`] with the missing joints and the existing bones, or for a zero pose that is not
    /// a person's.
    pub fn recognise(bvh: &Bvh, path: &Path) -> Result<Self, FileError> {
        let named = NamedBones::find(bvh, path)?;
        let family = family(bvh);
        let (axes, z_up) = match family {
            Family::Iclone => (iclone_axes(), y_to_z()),
            Family::Poser | Family::Standard => zero_pose_axes(bvh, &named)
                .ok_or_else(|| FileError::new(path, "found a zero pose that is not of a person, expected one that stands upright, y or z up"))?,
        };
        let placing = Placing::new(bvh, &named, axes);
        if !(placing.stature.is_finite() && placing.stature > SHORTEST_UNITS) {
            return Err(FileError::new(
                path,
                "found bones without length, expected a body",
            ));
        }
        Ok(Self {
            family,
            stature_units: placing.stature,
            z_up,
            sites: placing.sites(),
            balls: named
                .toe
                .is_none()
                .then(|| [placing.ball(0), placing.ball(1)]),
        })
    }
}

fn family(bvh: &Bvh) -> Family {
    let any = |name: &str| bvh.bones.iter().any(|bone| bone.name == name);
    if bvh.bones.iter().any(|b| b.name.starts_with("CC_Base_")) {
        Family::Iclone
    } else if any("lButtock") && any("lShldr") {
        Family::Poser
    } else {
        Family::Standard
    }
}

fn y_to_z() -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2)
}

fn axes_of(forward: Vector3<f64>, up: Vector3<f64>) -> Axes {
    Matrix3::from_columns(&[forward, up.cross(&forward), up])
}

fn iclone_axes() -> BodyAxes {
    let dip = Rotation3::from_axis_angle(&Vector3::x_axis(), ICLONE_FOOT_DIP_DEG.to_radians());
    BodyAxes {
        body: axes_of(Vector3::z(), Vector3::y()),
        foot: axes_of(dip * Vector3::y(), dip * Vector3::z()),
        toe: axes_of(Vector3::y(), Vector3::z()),
    }
}

/// The axes of a rig whose zero pose stands upright; `None` for other poses.
fn zero_pose_axes(bvh: &Bvh, named: &NamedBones) -> Option<(BodyAxes, UnitQuaternion<f64>)> {
    let mut zero: Vec<Vector3<f64>> = Vec::with_capacity(bvh.bones.len());
    for bone in &bvh.bones {
        let parent = bone.parent.map_or(Vector3::zeros(), |parent| zero[parent]);
        zero.push(parent + bone.offset);
    }
    let ankles = (zero[named.ankle[0]] + zero[named.ankle[1]]) / 2.0;
    let height = (zero[named.neck] - ankles).try_normalize(f64::EPSILON)?;
    let (up, z_up) = if height.y > height.z {
        (Vector3::y(), y_to_z())
    } else {
        (Vector3::z(), UnitQuaternion::identity())
    };
    let left = zero[named.hip[0]] - zero[named.hip[1]];
    let left = (left - up * left.dot(&up)).try_normalize(f64::EPSILON)?;
    let body = axes_of(left.cross(&up), up);
    let upright = height.dot(&up) > 0.9;
    upright.then_some((
        BodyAxes {
            body,
            foot: body,
            toe: body,
        },
        z_up,
    ))
}

#[cfg(test)]
mod tests;
