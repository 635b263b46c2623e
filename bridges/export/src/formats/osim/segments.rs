//! The tree of bodies: the joint of each body, and its angles.
//!
//! Axes are `OpenSim`'s: x forward, y up, z to the right. They describe our body model in those
//! axes, as `farfield_fusion::body::skeleton::dof` does in ours; a test compares the two.

use farfield_fusion::body::skeleton::{Joint, Link};

/// A body of the model.
#[derive(Debug)]
pub(super) struct Segment {
    /// The link of our body model.
    pub(super) link: Link,
    /// Its name, from the Rajagopal model if that has it.
    pub(super) name: &'static str,
    /// The parent body; none for the pelvis, which moves in the ground.
    pub(super) parent: Option<&'static str>,
    /// The joint at its origin.
    pub(super) origin: Joint,
    /// The joint to which its mass extends.
    pub(super) end: Option<Joint>,
    /// Whether it lies along its own y axis.
    pub(super) is_upright: bool,
    /// Its share of the body's mass. Source: Winter, "Biomechanics and Motor Control of Human
    /// Movement", table 4.1; the trunk's 0.497 is divided among pelvis, torso and scapulae; hands
    /// belong to the forearms.
    pub(super) mass_share: f64,
    /// Its rotations relative to its parent, in order, about axes that move with the earlier ones.
    pub(super) rotations: &'static [Coordinate],
    /// Its translations in its parent.
    pub(super) translations: &'static [Coordinate],
}

/// A coordinate of the model.
#[derive(Debug)]
pub(super) struct Coordinate {
    /// The reported angle.
    pub(super) name: &'static str,
    /// Axis of rotation or translation.
    pub(super) axis: &'static str,
}

/// The body of this link.
pub(super) fn segment_of(link: Link) -> Option<&'static Segment> {
    SEGMENTS.iter().find(|segment| segment.link == link)
}

/// All bodies, parents before children.
pub(super) static SEGMENTS: [Segment; 15] = [
    Segment {
        link: Link::Pelvis,
        name: "pelvis",
        parent: None,
        origin: Joint::Pelvis,
        end: None,
        is_upright: false,
        mass_share: 0.142,
        rotations: &[
            Coordinate {
                name: "pelvis_tilt",
                axis: "0 0 1",
            },
            Coordinate {
                name: "pelvis_list",
                axis: "1 0 0",
            },
            Coordinate {
                name: "pelvis_rotation",
                axis: "0 1 0",
            },
        ],
        translations: &[
            Coordinate {
                name: "pelvis_tx",
                axis: "1 0 0",
            },
            Coordinate {
                name: "pelvis_ty",
                axis: "0 1 0",
            },
            Coordinate {
                name: "pelvis_tz",
                axis: "0 0 1",
            },
        ],
    },
    Segment {
        link: Link::Trunk,
        name: "torso",
        parent: Some("pelvis"),
        origin: Joint::Spine,
        end: Some(Joint::Neck),
        is_upright: true,
        mass_share: 0.335,
        rotations: &[
            Coordinate {
                name: "lumbar_extension",
                axis: "0 0 1",
            },
            Coordinate {
                name: "lumbar_bending",
                axis: "1 0 0",
            },
            Coordinate {
                name: "lumbar_rotation",
                axis: "0 1 0",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::Head,
        name: "head",
        parent: Some("torso"),
        origin: Joint::Neck,
        end: Some(Joint::Head),
        is_upright: true,
        mass_share: 0.081,
        rotations: &[
            Coordinate {
                name: "neck_flexion",
                axis: "0 0 -1",
            },
            Coordinate {
                name: "neck_bending",
                axis: "1 0 0",
            },
            Coordinate {
                name: "neck_rotation",
                axis: "0 1 0",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::RightScapula,
        name: "scapula_r",
        parent: Some("torso"),
        origin: Joint::RightScapula,
        end: None,
        is_upright: false,
        mass_share: 0.01,
        rotations: &[
            Coordinate {
                name: "scapula_elevation_r",
                axis: "-1 0 0",
            },
            Coordinate {
                name: "scapula_protraction_r",
                axis: "0 1 0",
            },
            Coordinate {
                name: "scapula_tilt_r",
                axis: "0 0 -1",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::RightUpperArm,
        name: "humerus_r",
        parent: Some("scapula_r"),
        origin: Joint::RightShoulder,
        end: Some(Joint::RightElbow),
        is_upright: true,
        mass_share: 0.028,
        rotations: &[
            Coordinate {
                name: "arm_flex_r",
                axis: "0 0 1",
            },
            Coordinate {
                name: "arm_add_r",
                axis: "1 0 0",
            },
            Coordinate {
                name: "arm_rot_r",
                axis: "0 1 0",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::RightForearm,
        name: "forearm_r",
        parent: Some("humerus_r"),
        origin: Joint::RightElbow,
        end: Some(Joint::RightHand),
        is_upright: true,
        mass_share: 0.022,
        rotations: &[Coordinate {
            name: "elbow_flex_r",
            axis: "0 0 1",
        }],
        translations: &[],
    },
    Segment {
        link: Link::RightThigh,
        name: "femur_r",
        parent: Some("pelvis"),
        origin: Joint::RightHip,
        end: Some(Joint::RightKnee),
        is_upright: true,
        mass_share: 0.1,
        rotations: &[
            Coordinate {
                name: "hip_flexion_r",
                axis: "0 0 1",
            },
            Coordinate {
                name: "hip_adduction_r",
                axis: "1 0 0",
            },
            Coordinate {
                name: "hip_rotation_r",
                axis: "0 1 0",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::RightShank,
        name: "tibia_r",
        parent: Some("femur_r"),
        origin: Joint::RightKnee,
        end: Some(Joint::RightAnkle),
        is_upright: true,
        mass_share: 0.0465,
        rotations: &[Coordinate {
            name: "knee_angle_r",
            axis: "0 0 -1",
        }],
        translations: &[],
    },
    Segment {
        link: Link::RightFoot,
        name: "foot_r",
        parent: Some("tibia_r"),
        origin: Joint::RightAnkle,
        end: Some(Joint::RightToe),
        is_upright: false,
        mass_share: 0.0145,
        rotations: &[
            Coordinate {
                name: "ankle_angle_r",
                axis: "0 0 1",
            },
            Coordinate {
                name: "subtalar_angle_r",
                axis: "1 0 0",
            },
            Coordinate {
                name: "foot_rotation_r",
                axis: "0 1 0",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::LeftScapula,
        name: "scapula_l",
        parent: Some("torso"),
        origin: Joint::LeftScapula,
        end: None,
        is_upright: false,
        mass_share: 0.01,
        rotations: &[
            Coordinate {
                name: "scapula_elevation_l",
                axis: "1 0 0",
            },
            Coordinate {
                name: "scapula_protraction_l",
                axis: "0 -1 0",
            },
            Coordinate {
                name: "scapula_tilt_l",
                axis: "0 0 -1",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::LeftUpperArm,
        name: "humerus_l",
        parent: Some("scapula_l"),
        origin: Joint::LeftShoulder,
        end: Some(Joint::LeftElbow),
        is_upright: true,
        mass_share: 0.028,
        rotations: &[
            Coordinate {
                name: "arm_flex_l",
                axis: "0 0 1",
            },
            Coordinate {
                name: "arm_add_l",
                axis: "-1 0 0",
            },
            Coordinate {
                name: "arm_rot_l",
                axis: "0 -1 0",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::LeftForearm,
        name: "forearm_l",
        parent: Some("humerus_l"),
        origin: Joint::LeftElbow,
        end: Some(Joint::LeftHand),
        is_upright: true,
        mass_share: 0.022,
        rotations: &[Coordinate {
            name: "elbow_flex_l",
            axis: "0 0 1",
        }],
        translations: &[],
    },
    Segment {
        link: Link::LeftThigh,
        name: "femur_l",
        parent: Some("pelvis"),
        origin: Joint::LeftHip,
        end: Some(Joint::LeftKnee),
        is_upright: true,
        mass_share: 0.1,
        rotations: &[
            Coordinate {
                name: "hip_flexion_l",
                axis: "0 0 1",
            },
            Coordinate {
                name: "hip_adduction_l",
                axis: "-1 0 0",
            },
            Coordinate {
                name: "hip_rotation_l",
                axis: "0 -1 0",
            },
        ],
        translations: &[],
    },
    Segment {
        link: Link::LeftShank,
        name: "tibia_l",
        parent: Some("femur_l"),
        origin: Joint::LeftKnee,
        end: Some(Joint::LeftAnkle),
        is_upright: true,
        mass_share: 0.0465,
        rotations: &[Coordinate {
            name: "knee_angle_l",
            axis: "0 0 -1",
        }],
        translations: &[],
    },
    Segment {
        link: Link::LeftFoot,
        name: "foot_l",
        parent: Some("tibia_l"),
        origin: Joint::LeftAnkle,
        end: Some(Joint::LeftToe),
        is_upright: false,
        mass_share: 0.0145,
        rotations: &[
            Coordinate {
                name: "ankle_angle_l",
                axis: "0 0 1",
            },
            Coordinate {
                name: "subtalar_angle_l",
                axis: "-1 0 0",
            },
            Coordinate {
                name: "foot_rotation_l",
                axis: "0 -1 0",
            },
        ],
        translations: &[],
    },
];
