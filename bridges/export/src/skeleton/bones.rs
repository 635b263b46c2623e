//! The bones: the joint at which each begins, and the link of the body that carries it.

use farfield_fusion::body::skeleton::{Joint, Link};

/// Number of bones.
pub const N_BONES: usize = 20;

/// A bone of the export skeleton. It begins at its [`Bone::joint`]; the only exception is the ball
/// of the foot, which is not one of our joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[expect(
    missing_docs,
    reason = "the names are the documentation: see the table"
)]
pub enum Bone {
    Hips,
    Spine,
    Neck,
    Head,
    LeftClavicle,
    LeftUpperArm,
    LeftForearm,
    LeftHand,
    RightClavicle,
    RightUpperArm,
    RightForearm,
    RightHand,
    LeftThigh,
    LeftShank,
    LeftFoot,
    LeftToes,
    RightThigh,
    RightShank,
    RightFoot,
    RightToes,
}

/// A row of the table: bone, parent, first joint, link.
type BoneRow = (Bone, Option<Bone>, Joint, Link);

const TABLE: [BoneRow; N_BONES] = {
    use Bone as B;
    [
        (B::Hips, None, Joint::Pelvis, Link::Pelvis),
        (B::Spine, Some(B::Hips), Joint::Spine, Link::Trunk),
        (B::Neck, Some(B::Spine), Joint::Neck, Link::Head),
        (B::Head, Some(B::Neck), Joint::Head, Link::Head),
        (
            B::LeftClavicle,
            Some(B::Spine),
            Joint::LeftScapula,
            Link::LeftScapula,
        ),
        (
            B::LeftUpperArm,
            Some(B::LeftClavicle),
            Joint::LeftShoulder,
            Link::LeftUpperArm,
        ),
        (
            B::LeftForearm,
            Some(B::LeftUpperArm),
            Joint::LeftElbow,
            Link::LeftForearm,
        ),
        (
            B::LeftHand,
            Some(B::LeftForearm),
            Joint::LeftWrist,
            Link::LeftForearm,
        ),
        (
            B::RightClavicle,
            Some(B::Spine),
            Joint::RightScapula,
            Link::RightScapula,
        ),
        (
            B::RightUpperArm,
            Some(B::RightClavicle),
            Joint::RightShoulder,
            Link::RightUpperArm,
        ),
        (
            B::RightForearm,
            Some(B::RightUpperArm),
            Joint::RightElbow,
            Link::RightForearm,
        ),
        (
            B::RightHand,
            Some(B::RightForearm),
            Joint::RightWrist,
            Link::RightForearm,
        ),
        (B::LeftThigh, Some(B::Hips), Joint::LeftHip, Link::LeftThigh),
        (
            B::LeftShank,
            Some(B::LeftThigh),
            Joint::LeftKnee,
            Link::LeftShank,
        ),
        (
            B::LeftFoot,
            Some(B::LeftShank),
            Joint::LeftAnkle,
            Link::LeftFoot,
        ),
        (
            B::LeftToes,
            Some(B::LeftFoot),
            Joint::LeftToe,
            Link::LeftFoot,
        ),
        (
            B::RightThigh,
            Some(B::Hips),
            Joint::RightHip,
            Link::RightThigh,
        ),
        (
            B::RightShank,
            Some(B::RightThigh),
            Joint::RightKnee,
            Link::RightShank,
        ),
        (
            B::RightFoot,
            Some(B::RightShank),
            Joint::RightAnkle,
            Link::RightFoot,
        ),
        (
            B::RightToes,
            Some(B::RightFoot),
            Joint::RightToe,
            Link::RightFoot,
        ),
    ]
};

impl Bone {
    /// All bones, parents before children, depth first.
    pub const ALL: [Self; N_BONES] = {
        let mut all = [Self::Hips; N_BONES];
        let mut i = 0;
        while i < N_BONES {
            all[i] = TABLE[i].0;
            i += 1;
        }
        all
    };

    /// Its index in arrays by bone.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The parent bone; none for the hips.
    pub const fn parent(self) -> Option<Self> {
        TABLE[self as usize].1
    }

    /// The joint at which it begins. The toes begin at the ball of the foot and end at this joint.
    pub const fn joint(self) -> Joint {
        TABLE[self as usize].2
    }

    /// The link of the body that carries it.
    pub const fn link(self) -> Link {
        TABLE[self as usize].3
    }

    /// Whether it never rotates relative to its parent: the body model has no wrist, toe or upper
    /// neck.
    pub fn is_static(self) -> bool {
        self.parent()
            .is_some_and(|parent| parent.link() == self.link())
    }

    /// Its child bones, in order.
    pub fn children(self) -> impl Iterator<Item = Self> {
        Self::ALL
            .into_iter()
            .filter(move |bone| bone.parent() == Some(self))
    }

    /// The side of an arm bone below the clavicle; the rest pose raises these.
    pub(crate) const fn raised_side(self) -> Option<Raised> {
        match self {
            Self::LeftUpperArm | Self::LeftForearm | Self::LeftHand => Some(Raised::Left),
            Self::RightUpperArm | Self::RightForearm | Self::RightHand => Some(Raised::Right),
            _ => None,
        }
    }
}

/// The side of an arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Raised {
    Left,
    Right,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_in_enum_order_and_depth_first() {
        fn visit(bone: Bone, into: &mut Vec<Bone>) {
            into.push(bone);
            for child in bone.children() {
                visit(child, into);
            }
        }
        let mut depth_first = Vec::new();
        visit(Bone::Hips, &mut depth_first);
        assert_eq!(depth_first, Bone::ALL);
        for (i, bone) in Bone::ALL.into_iter().enumerate() {
            assert_eq!(bone.index(), i);
        }
    }

    #[test]
    fn hands_toes_and_head_are_static() {
        let named: Vec<Bone> = Bone::ALL
            .into_iter()
            .filter(|bone| bone.is_static())
            .collect();
        let expected = [
            Bone::Head,
            Bone::LeftHand,
            Bone::RightHand,
            Bone::LeftToes,
            Bone::RightToes,
        ];
        assert_eq!(named, expected);
    }
}
