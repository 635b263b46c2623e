//! Names and shape of bodies: joints and their parents, what to draw, ranges of motion.
//!
//! Poses arrive as lists of numbers; the creator of the poses describes here what the numbers mean.
//! This crate assumes no number of joints, keypoints or angles.

use serde::Serialize;

use farfield_proto::wire::MAX_JOINTS;

/// Distance from a limit below which an angle counts as at the limit, radians. Wire numbers have
/// single precision, and exact inverse kinematics ends on the limit itself.
const AT_BOUND_RAD: f32 = 1e-3;
/// Radius of a bone without a known size, metres.
const USUAL_RADIUS_M: f32 = 0.04;

/// Names and shape of the model's bodies.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Skeleton {
    /// The joints, in the order of `PersonPose::joints_m`; at most 64 are shown.
    pub joints: Vec<Joint>,
    /// What to draw: capsules between joints.
    pub bones: Vec<Bone>,
    /// Names of the network's keypoints, in the order of `PersonPose::keypoints_m`.
    pub keypoints: Vec<String>,
    /// The angles, in the order of `PersonPose::angles`.
    pub angles: Vec<Angle>,
}

/// One joint of the model.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Joint {
    /// Its name.
    pub name: String,
    /// Index of the parent joint; `None` for the root.
    pub parent: Option<usize>,
}

/// One part of a body as it is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bone {
    /// The joint at one end.
    pub from: usize,
    /// The joint at the other.
    pub to: usize,
    /// Radius of the capsule, metres.
    pub radius_m: f32,
}

/// One angle that poses report.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Angle {
    /// Its name.
    pub name: String,
    /// Unit of its values.
    pub unit: AngleUnit,
    /// Its range of motion, in its unit; `None` if unlimited.
    pub range: Option<[f32; 2]>,
}

/// The unit of a reported angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum AngleUnit {
    /// Radians.
    #[serde(rename = "rad")]
    Radians,
    /// Metres: the root's translations.
    #[serde(rename = "m")]
    Metres,
}

impl Angle {
    /// Whether `value` is at a limit of the range.
    pub fn is_at_bound(&self, value: f32) -> bool {
        self.range.is_some_and(|[least, most]| {
            value <= least + AT_BOUND_RAD || value >= most - AT_BOUND_RAD
        })
    }
}

/// Radius of the bone that ends in a joint whose name contains the word, metres, for adults.
const RADII_M: [(&str, f32); 12] = [
    ("spine", 0.13),
    ("neck", 0.11),
    ("head", 0.085),
    ("scapula", 0.06),
    ("shoulder", 0.055),
    ("elbow", 0.045),
    ("wrist", 0.035),
    ("hand", 0.03),
    ("hip", 0.09),
    ("knee", 0.07),
    ("ankle", 0.045),
    ("toe", 0.035),
];
/// Joints whose names contain one of these are facial points; they end no bone.
const FACE: [&str; 3] = ["nose", "eye", "ear"];

impl Skeleton {
    /// Builds a skeleton with a bone of adult size from every parent to its child, except in the
    /// face. An invalid parent counts as none; joints beyond the maximum of a pose are dropped.
    pub fn of_tree(
        joints: impl IntoIterator<Item = (String, Option<usize>)>,
        keypoints: Vec<String>,
        angles: Vec<Angle>,
    ) -> Self {
        let joints = joints.into_iter().take(MAX_JOINTS);
        let mut joints: Vec<Joint> = joints
            .map(|(name, parent)| Joint { name, parent })
            .collect();
        let n = joints.len();
        for joint in &mut joints {
            joint.parent = joint.parent.filter(|&parent| parent < n);
        }
        let bones = joints.iter().enumerate();
        let bones = bones.filter_map(|(to, joint)| {
            let is_face = FACE.iter().any(|part| is_part(&joint.name, part));
            let from = joint.parent.filter(|_| !is_face)?;
            let known = RADII_M.iter().find(|(part, _)| joint.name.contains(part));
            let radius_m = known.map_or(USUAL_RADIUS_M, |(_, radius_m)| *radius_m);
            Some(Bone { from, to, radius_m })
        });
        Self {
            bones: bones.collect(),
            joints,
            keypoints,
            angles,
        }
    }
}

/// Whether `part` is a word of `name`: `ear` is in `left_ear`, not in `forearm`.
fn is_part(name: &str, part: &str) -> bool {
    name.split('_').any(|word| word == part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bones_connect_parents_and_children_except_in_faces() {
        let tree = [
            ("pelvis", None),
            ("spine", Some(0)),
            ("head", Some(1)),
            ("left_ear", Some(2)),
            ("forearm", Some(9)),
        ];
        let tree = tree.map(|(name, parent)| (name.to_owned(), parent));
        let skeleton = Skeleton::of_tree(tree, Vec::new(), Vec::new());
        let ends: Vec<_> = skeleton
            .bones
            .iter()
            .map(|bone| (bone.from, bone.to))
            .collect();
        assert_eq!(ends, [(0, 1), (1, 2)]);
        assert_eq!(skeleton.joints[4].parent, None);
    }

    #[test]
    fn an_angle_without_a_range_is_never_at_a_bound() {
        let mut angle = Angle {
            name: "elbow_flex_r".to_owned(),
            unit: AngleUnit::Radians,
            range: Some([-0.1, 2.5]),
        };
        assert!(angle.is_at_bound(2.5) && angle.is_at_bound(-0.1) && !angle.is_at_bound(1.0));
        angle.range = None;
        assert!(!angle.is_at_bound(2.5));
    }
}
