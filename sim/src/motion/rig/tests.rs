//! Skeletons of other programs, as small files.

use farfield_fusion::body::skeleton::Joint;

use super::placing::SOLE;
use super::*;
use crate::motion::Clip;
use crate::motion::sample::{Dialect, USUAL};

fn refusal(text: &str) -> String {
    Clip::parse(text, Path::new("a.bvh"))
        .unwrap_err()
        .to_string()
}

#[test]
fn all_dialects_give_the_same_body() {
    let usual = USUAL.clip(0.08).posture(0.0);
    assert!(
        (usual.at(Joint::Pelvis).z - 0.86 / USUAL.clip(0.0).stature_units() - SOLE).abs() < 1e-9
    );
    let others = [
        Dialect {
            names: [
                "mixamorig:Hips",
                "mixamorig:Neck",
                "mixamorig:SArm",
                "mixamorig:SForeArm",
                "mixamorig:SHand",
                "mixamorig:SUpLeg",
                "mixamorig:SLeg",
                "mixamorig:SFoot",
            ],
            sides: ["Left", "Right"],
            z_up: false,
            unit: 100.0,
        },
        Dialect {
            names: [
                "Bip Pelvis",
                "Neck1",
                "S UpperArm",
                "S Forearm",
                "S Hand",
                "S Thigh",
                "S Calf",
                "S Foot",
            ],
            sides: ["L", "R"],
            z_up: true,
            unit: 39.37,
        },
    ];
    for other in &others {
        for height in [-5.0, 0.0, 0.08] {
            let posture = other.clip(height).posture(0.0);
            // Headings differ with the conversion to z up; the body must not.
            let turn = usual.facing_rad() - posture.facing_rad();
            let shift = |p: &crate::motion::Posture| {
                let pelvis = p.at(Joint::Pelvis);
                Vector3::new(-pelvis.x, -pelvis.y, 0.0)
            };
            let posture = posture.moved(turn, Vector3::zeros());
            let posture = posture.moved(0.0, shift(&posture));
            let expected = usual.moved(0.0, shift(&usual));
            for joint in Joint::ALL {
                let off = (posture.at(joint) - expected.at(joint)).norm();
                assert!(off < 1e-9, "{}: {off}", joint.name());
            }
        }
    }
}

#[test]
fn a_shoulder_bone_above_an_arm_bone_is_the_collar() {
    let mut text = USUAL.file(0.0);
    for (side, arm, collar) in [
        ("left", "LeftArm", "LeftShoulder"),
        ("right", "RightArm", "RightShoulder"),
    ] {
        let shoulder = format!("JOINT {side}_shoulder");
        let start = text.find(&shoulder).unwrap();
        let end = start + text[start..].find("}\n").unwrap();
        text.insert_str(end, "}\n");
        let above = format!("JOINT {collar}\n{{\nOFFSET 0 0 0\nCHANNELS 0\nJOINT {arm}");
        text = text.replace(&shoulder, &above);
    }
    let bvh = Bvh::parse(&text, Path::new("a.bvh")).unwrap();
    let named = NamedBones::find(&bvh, Path::new("a.bvh")).unwrap();
    let name = |bone: usize| bvh.bones[bone].name.as_str();
    assert_eq!(named.shoulder.map(name), ["LeftArm", "RightArm"]);
    assert_eq!(
        named.collar.unwrap().map(name),
        ["LeftShoulder", "RightShoulder"]
    );
}

#[test]
fn missing_joints_are_refused_with_the_existing_bones() {
    let text = USUAL.file(0.0).replace("_knee", "_joint");
    let message = refusal(&text);
    assert!(
        message.starts_with("a.bvh: found no bones for knees, expected names as `left_hip`"),
        "{message}"
    );
    assert!(
        message.contains("left_hip, left_joint, left_ankle"),
        "{message}"
    );
}

#[test]
fn a_leg_in_the_wrong_order_is_refused() {
    let text = USUAL.file(0.0).replace("left_knee", "x");
    let text = text
        .replace("left_ankle", "left_knee")
        .replace("JOINT x", "JOINT left_ankle");
    assert_eq!(
        refusal(&text),
        "a.bvh: found `left_ankle` outside the chain of `left_knee`, expected it below"
    );
}

#[test]
fn a_zero_pose_that_is_not_upright_is_refused() {
    let lying = USUAL.file(0.0).replace("0 -0.43 0", "0 0 0.43");
    assert!(refusal(&lying).contains("expected one that stands upright"));
    let flat = USUAL.file(0.0).replace("0.09 0 0", "0 0 0");
    assert!(refusal(&flat.replace("-0 0 0", "0 0 0")).contains("zero pose"));
}

#[test]
fn hands_and_faces_without_bones_have_typical_positions() {
    let posture = USUAL.clip(0.0).posture(0.0);
    let up = |joint: Joint| posture.at(joint).z;
    assert!((0.90..0.95).contains(&up(Joint::Head)));
    assert!((up(Joint::Neck) + 0.10 - up(Joint::Head)).abs() < 1e-9);
    assert!((up(Joint::LeftWrist) - 0.05 - up(Joint::LeftHand)).abs() < 1e-9);
    assert!((up(Joint::Spine) - 0.07 - up(Joint::Pelvis)).abs() < 1e-9);
    assert!(up(Joint::LeftHeel).abs() < 1e-9 && up(Joint::LeftToe).abs() < 1e-9);
    assert!(posture.facing_rad().abs() - std::f64::consts::FRAC_PI_2 < 1e-9);
}
