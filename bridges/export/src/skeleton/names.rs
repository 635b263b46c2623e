//! Bone names of other programs, so that they retarget without a manual mapping.

use std::str::FromStr;

use super::bones::{Bone, N_BONES};

/// A table of bone names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BoneNames {
    /// The first joint of each bone, as in all files of Farfield.
    #[default]
    Farfield,
    /// Unreal Engine's mannequin.
    Unreal,
    /// Mixamo's rigs.
    Mixamo,
    /// Unity's humanoid avatar (`HumanBodyBones`).
    Unity,
    /// VRM's humanoid.
    Vrm,
}

const FARFIELD: [&str; N_BONES] = [
    "pelvis",
    "spine",
    "neck",
    "head",
    "left_scapula",
    "left_shoulder",
    "left_elbow",
    "left_wrist",
    "right_scapula",
    "right_shoulder",
    "right_elbow",
    "right_wrist",
    "left_hip",
    "left_knee",
    "left_ankle",
    "left_ball",
    "right_hip",
    "right_knee",
    "right_ankle",
    "right_ball",
];
const UNREAL: [&str; N_BONES] = [
    "pelvis",
    "spine_01",
    "neck_01",
    "head",
    "clavicle_l",
    "upperarm_l",
    "lowerarm_l",
    "hand_l",
    "clavicle_r",
    "upperarm_r",
    "lowerarm_r",
    "hand_r",
    "thigh_l",
    "calf_l",
    "foot_l",
    "ball_l",
    "thigh_r",
    "calf_r",
    "foot_r",
    "ball_r",
];
const MIXAMO: [&str; N_BONES] = [
    "mixamorig:Hips",
    "mixamorig:Spine",
    "mixamorig:Neck",
    "mixamorig:Head",
    "mixamorig:LeftShoulder",
    "mixamorig:LeftArm",
    "mixamorig:LeftForeArm",
    "mixamorig:LeftHand",
    "mixamorig:RightShoulder",
    "mixamorig:RightArm",
    "mixamorig:RightForeArm",
    "mixamorig:RightHand",
    "mixamorig:LeftUpLeg",
    "mixamorig:LeftLeg",
    "mixamorig:LeftFoot",
    "mixamorig:LeftToeBase",
    "mixamorig:RightUpLeg",
    "mixamorig:RightLeg",
    "mixamorig:RightFoot",
    "mixamorig:RightToeBase",
];
const UNITY: [&str; N_BONES] = [
    "Hips",
    "Spine",
    "Neck",
    "Head",
    "LeftShoulder",
    "LeftUpperArm",
    "LeftLowerArm",
    "LeftHand",
    "RightShoulder",
    "RightUpperArm",
    "RightLowerArm",
    "RightHand",
    "LeftUpperLeg",
    "LeftLowerLeg",
    "LeftFoot",
    "LeftToes",
    "RightUpperLeg",
    "RightLowerLeg",
    "RightFoot",
    "RightToes",
];
const VRM: [&str; N_BONES] = [
    "hips",
    "spine",
    "neck",
    "head",
    "leftShoulder",
    "leftUpperArm",
    "leftLowerArm",
    "leftHand",
    "rightShoulder",
    "rightUpperArm",
    "rightLowerArm",
    "rightHand",
    "leftUpperLeg",
    "leftLowerLeg",
    "leftFoot",
    "leftToes",
    "rightUpperLeg",
    "rightLowerLeg",
    "rightFoot",
    "rightToes",
];

impl BoneNames {
    /// Every table with its name on the command line.
    pub const ALL: [(&'static str, Self); 5] = [
        ("farfield", Self::Farfield),
        ("unreal", Self::Unreal),
        ("mixamo", Self::Mixamo),
        ("unity", Self::Unity),
        ("vrm", Self::Vrm),
    ];

    /// Name of `bone` in this table.
    pub const fn name(self, bone: Bone) -> &'static str {
        let table = match self {
            Self::Farfield => &FARFIELD,
            Self::Unreal => &UNREAL,
            Self::Mixamo => &MIXAMO,
            Self::Unity => &UNITY,
            Self::Vrm => &VRM,
        };
        table[bone.index()]
    }
}

impl FromStr for BoneNames {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        crate::options::named(name, &Self::ALL)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn names_are_unique_and_left_mirrors_right() {
        for (_, table) in BoneNames::ALL {
            let names: BTreeSet<_> = Bone::ALL.map(|bone| table.name(bone)).into();
            assert_eq!(names.len(), N_BONES);
            let left = table.name(Bone::LeftShank);
            let right = table.name(Bone::RightShank);
            assert!(left.len().abs_diff(right.len()) <= 1, "{left} {right}");
        }
    }

    #[test]
    fn farfield_names_are_joint_names() {
        for bone in Bone::ALL {
            let name = BoneNames::Farfield.name(bone);
            if !name.ends_with("_ball") {
                assert_eq!(name, bone.joint().name());
            }
        }
    }

    #[test]
    fn an_unknown_table_is_refused_with_the_valid_ones() {
        let refused = "mixam".parse::<BoneNames>().unwrap_err();
        assert_eq!(
            refused,
            "`mixam` is not one of farfield, unreal, mixamo, unity, vrm"
        );
    }
}
