//! The 29 named points of the model, and the 15 rigid links that carry them.

/// Number of joints.
pub const N_JOINTS: usize = 29;
/// Number of rigid links.
pub const N_LINKS: usize = 15;

/// Left or right half of the body, from the person's view.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Side {
    /// The person's right.
    Right,
    /// The person's left.
    Left,
}

impl Side {
    /// Both, in the order of the degrees of freedom.
    pub const BOTH: [Self; 2] = [Self::Right, Self::Left];

    /// Factor of a rotation about the body's x or z axis that gives the same number the same
    /// meaning on both sides: +1 on the right, -1 on the left.
    pub const fn mirror(self) -> f64 {
        match self {
            Self::Right => 1.0,
            Self::Left => -1.0,
        }
    }
}

/// A rigid part of the body. At rest all link frames are parallel: x forward, y left, z up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(missing_docs, reason = "the names are the documentation")]
pub enum Link {
    Pelvis,
    Trunk,
    Head,
    RightScapula,
    RightUpperArm,
    RightForearm,
    RightThigh,
    RightShank,
    RightFoot,
    LeftScapula,
    LeftUpperArm,
    LeftForearm,
    LeftThigh,
    LeftShank,
    LeftFoot,
}

impl Link {
    /// All links, parents before children.
    pub const ALL: [Self; N_LINKS] = [
        Self::Pelvis,
        Self::Trunk,
        Self::Head,
        Self::RightScapula,
        Self::RightUpperArm,
        Self::RightForearm,
        Self::RightThigh,
        Self::RightShank,
        Self::RightFoot,
        Self::LeftScapula,
        Self::LeftUpperArm,
        Self::LeftForearm,
        Self::LeftThigh,
        Self::LeftShank,
        Self::LeftFoot,
    ];
}

/// One of the 29 anatomical centres of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[expect(
    missing_docs,
    reason = "the names are the documentation; the table below has the parents"
)]
pub enum Joint {
    Pelvis,
    Spine,
    Neck,
    Head,
    Nose,
    LeftEye,
    RightEye,
    LeftEar,
    RightEar,
    LeftScapula,
    RightScapula,
    LeftShoulder,
    RightShoulder,
    LeftElbow,
    RightElbow,
    LeftWrist,
    RightWrist,
    LeftHand,
    RightHand,
    LeftHip,
    RightHip,
    LeftKnee,
    RightKnee,
    LeftAnkle,
    RightAnkle,
    LeftHeel,
    RightHeel,
    LeftToe,
    RightToe,
}

/// A row of the table of joints: the joint, its name, its parent, the link it is fixed in.
type JointRow = (Joint, &'static str, Option<Joint>, Link);

/// The tree of joints. A joint is fixed in the link *above* it: the hip centre in the pelvis, the
/// knee centre in the thigh, the wrist in the forearm.
const TABLE: [JointRow; N_JOINTS] = [
    (Joint::Pelvis, "pelvis", None, Link::Pelvis),
    (Joint::Spine, "spine", Some(Joint::Pelvis), Link::Pelvis),
    (Joint::Neck, "neck", Some(Joint::Spine), Link::Trunk),
    (Joint::Head, "head", Some(Joint::Neck), Link::Head),
    (Joint::Nose, "nose", Some(Joint::Head), Link::Head),
    (Joint::LeftEye, "left_eye", Some(Joint::Head), Link::Head),
    (Joint::RightEye, "right_eye", Some(Joint::Head), Link::Head),
    (Joint::LeftEar, "left_ear", Some(Joint::Head), Link::Head),
    (Joint::RightEar, "right_ear", Some(Joint::Head), Link::Head),
    (
        Joint::LeftScapula,
        "left_scapula",
        Some(Joint::Spine),
        Link::Trunk,
    ),
    (
        Joint::RightScapula,
        "right_scapula",
        Some(Joint::Spine),
        Link::Trunk,
    ),
    (
        Joint::LeftShoulder,
        "left_shoulder",
        Some(Joint::LeftScapula),
        Link::LeftScapula,
    ),
    (
        Joint::RightShoulder,
        "right_shoulder",
        Some(Joint::RightScapula),
        Link::RightScapula,
    ),
    (
        Joint::LeftElbow,
        "left_elbow",
        Some(Joint::LeftShoulder),
        Link::LeftUpperArm,
    ),
    (
        Joint::RightElbow,
        "right_elbow",
        Some(Joint::RightShoulder),
        Link::RightUpperArm,
    ),
    (
        Joint::LeftWrist,
        "left_wrist",
        Some(Joint::LeftElbow),
        Link::LeftForearm,
    ),
    (
        Joint::RightWrist,
        "right_wrist",
        Some(Joint::RightElbow),
        Link::RightForearm,
    ),
    (
        Joint::LeftHand,
        "left_hand",
        Some(Joint::LeftElbow),
        Link::LeftForearm,
    ),
    (
        Joint::RightHand,
        "right_hand",
        Some(Joint::RightElbow),
        Link::RightForearm,
    ),
    (
        Joint::LeftHip,
        "left_hip",
        Some(Joint::Pelvis),
        Link::Pelvis,
    ),
    (
        Joint::RightHip,
        "right_hip",
        Some(Joint::Pelvis),
        Link::Pelvis,
    ),
    (
        Joint::LeftKnee,
        "left_knee",
        Some(Joint::LeftHip),
        Link::LeftThigh,
    ),
    (
        Joint::RightKnee,
        "right_knee",
        Some(Joint::RightHip),
        Link::RightThigh,
    ),
    (
        Joint::LeftAnkle,
        "left_ankle",
        Some(Joint::LeftKnee),
        Link::LeftShank,
    ),
    (
        Joint::RightAnkle,
        "right_ankle",
        Some(Joint::RightKnee),
        Link::RightShank,
    ),
    (
        Joint::LeftHeel,
        "left_heel",
        Some(Joint::LeftAnkle),
        Link::LeftFoot,
    ),
    (
        Joint::RightHeel,
        "right_heel",
        Some(Joint::RightAnkle),
        Link::RightFoot,
    ),
    (
        Joint::LeftToe,
        "left_toe",
        Some(Joint::LeftAnkle),
        Link::LeftFoot,
    ),
    (
        Joint::RightToe,
        "right_toe",
        Some(Joint::RightAnkle),
        Link::RightFoot,
    ),
];

impl Joint {
    /// All joints, in the order of every array that is indexed by joint; parents before children.
    pub const ALL: [Self; N_JOINTS] = {
        let mut all = [Self::Pelvis; N_JOINTS];
        let mut i = 0;
        while i < N_JOINTS {
            all[i] = TABLE[i].0;
            i += 1;
        }
        all
    };

    /// Its index in arrays by joint.
    pub const fn index(self) -> usize {
        self as usize
    }

    /// Its name in files.
    pub const fn name(self) -> &'static str {
        TABLE[self as usize].1
    }

    /// Its parent; none for the pelvis.
    pub const fn parent(self) -> Option<Self> {
        TABLE[self as usize].2
    }

    /// The link in which it is a fixed point.
    pub const fn link(self) -> Link {
        TABLE[self as usize].3
    }

    /// The joint of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|joint| joint.name() == name)
    }

    /// The names of all joints that end a link of the skeleton: all with a parent.
    pub fn ends_of_links() -> [&'static str; N_JOINTS - 1] {
        let mut names = [""; N_JOINTS - 1];
        let ends = Self::ALL.iter().filter(|joint| joint.parent().is_some());
        for (name, joint) in names.iter_mut().zip(ends) {
            *name = joint.name();
        }
        names
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_follows_the_enum_and_names_are_unique() {
        for (i, joint) in Joint::ALL.into_iter().enumerate() {
            assert_eq!(joint.index(), i);
            assert_eq!(Joint::from_name(joint.name()), Some(joint));
        }
    }

    #[test]
    fn parents_come_before_children() {
        for joint in Joint::ALL {
            assert!(
                joint
                    .parent()
                    .is_none_or(|parent| parent.index() < joint.index())
            );
        }
    }
}
