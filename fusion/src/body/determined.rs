//! What a set of keypoints determines of a body, for any person and under the best conditions.
//!
//! A joint is determined if a keypoint sits on its link, or on a link further out: 17 keypoints end
//! at the ankles, so heel and toe are guesses. Angles follow the flags of the inverse kinematics
//! (see [`super::ik`]), for a body that stands with bent limbs and keypoints with the errors of
//! networks: nothing there is close to the limits. A pose flags what its single tick leaves
//! undetermined beyond that.

use farfield_proto::venue::parameters::IkParameters;
use nalgebra::{UnitQuaternion, Vector3};

use super::ik::{IkSolver, Priors, Target};
use super::skeleton::angles::FIRST_JOINT_ANGLE;
use super::skeleton::dof::{DofGroup, LINKS, first_of};
use super::skeleton::{
    Joint, Kinematics, Link, N_ANGLES, N_JOINTS, N_LINKS, N_ROOT_DOF, Pose, Proportions, Side,
    Site, Skeleton,
};

/// Stature of the reference body, metres.
const STATURE_M: f64 = 1.75;
/// Bend of its elbows and knees, radians: a straight limb hides its twist.
const BENT_RAD: f64 = 1.0;

/// Standard deviation per axis from which a joint counts as unknown, metres: it may then be on
/// another limb.
pub const UNKNOWN_M: f32 = 0.1;

/// How keypoints determine an angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngleEvidence {
    /// By itself.
    Own,
    /// Only together with other angles of the trunk: of pelvis and spine only the sum is known, and
    /// arms and legs follow from them.
    Shared,
    /// Not at all: it comes from a prior.
    Missing,
}

/// What a set of keypoints determines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Determined {
    /// Per joint whether its place is known.
    pub joints: [bool; N_JOINTS],
    /// Per reported angle.
    pub angles: [AngleEvidence; N_ANGLES],
}

impl Determined {
    /// What keypoints at `sites` determine.
    pub fn by(sites: &[Option<Site>]) -> Self {
        Self {
            joints: determined_joints(sites),
            angles: angles(sites),
        }
    }
}

/// Per joint whether keypoints at `sites` determine its place.
pub fn determined_joints(sites: &[Option<Site>]) -> [bool; N_JOINTS] {
    let shown = shown_links(sites);
    std::array::from_fn(|i| shown[Joint::ALL[i].link() as usize])
}

/// Per link whether a keypoint sits on it or on a link further out.
fn shown_links(sites: &[Option<Site>]) -> [bool; N_LINKS] {
    let mut shown = [false; N_LINKS];
    for site in sites.iter().flatten() {
        shown[site.joint.link() as usize] = true;
    }
    // Parents come before their children.
    for link in Link::ALL.into_iter().rev() {
        let parent = LINKS[link as usize].parent;
        shown[parent as usize] |= shown[link as usize];
    }
    shown
}

fn angles(sites: &[Option<Site>]) -> [AngleEvidence; N_ANGLES] {
    let unobserved = unobserved(sites);
    let is_unobserved = |angle: usize| unobserved >> angle & 1 == 1;
    let mut angles = [AngleEvidence::Own; N_ANGLES];
    for link in Link::ALL {
        let of_link = if link == Link::Pelvis {
            0..FIRST_JOINT_ANGLE
        } else {
            let dofs = LINKS[link as usize].dofs();
            let first = dofs.start - N_ROOT_DOF + FIRST_JOINT_ANGLE;
            first..first + dofs.len()
        };
        let is_trunk = matches!(link, Link::Pelvis | Link::Trunk);
        // The outer links show all turns of a link together: one undetermined turn makes the others
        // undetermined.
        let is_any_unobserved = carries_others(link) && of_link.clone().any(is_unobserved);
        for angle in of_link {
            angles[angle] = match (is_trunk, is_unobserved(angle)) {
                (true, true) => AngleEvidence::Shared,
                (false, true) => AngleEvidence::Missing,
                (false, false) if is_any_unobserved => AngleEvidence::Missing,
                _ => AngleEvidence::Own,
            };
        }
    }
    angles
}

/// Whether another link follows this one.
fn carries_others(link: Link) -> bool {
    Link::ALL
        .into_iter()
        .any(|other| other != link && LINKS[other as usize].parent == link)
}

/// The flags of a body that stands with bent limbs, all keypoints seen.
fn unobserved(sites: &[Option<Site>]) -> u64 {
    let skeleton = Skeleton::new(&Proportions::from_stature(STATURE_M));
    let mut pose = Pose::neutral(Vector3::new(0.0, 0.0, 0.9), UnitQuaternion::identity());
    for side in Side::BOTH {
        pose.dof[first_of(side, DofGroup::Elbow)] = BENT_RAD;
        pose.dof[first_of(side, DofGroup::Knee)] = BENT_RAD;
    }
    let mut body = Kinematics::default();
    skeleton.forward(&pose, &mut body);
    let parameters = IkParameters::default();
    let weight = parameters.keypoint_sigma_m.powi(-2);
    let targets: Vec<Target> = (sites.iter().flatten())
        .map(|site| Target::isotropic(site, body.site_m(site), weight))
        .collect();
    let priors = Priors::new(&parameters, &pose, 1.0);
    let mut solver = IkSolver::new(&parameters);
    let solution = solver.solve(&skeleton, &pose, &targets, &priors, None);
    solution.unobserved
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use farfield_proto::keypoints::{COCO17, KeypointSet};

    use super::super::skeleton::{ANGLE_NAMES, sites_of};
    use super::*;

    fn by(names: &[&str]) -> Determined {
        let names = names.iter().map(|&name| name.to_owned()).collect();
        Determined::by(&sites_of(&KeypointSet::new(names), &BTreeMap::new()))
    }

    fn unknown_joints(determined: &Determined) -> Vec<&'static str> {
        let joints = Joint::ALL.into_iter().zip(determined.joints);
        let unknown = joints.filter(|(_, is_known)| !is_known);
        unknown.map(|(joint, _)| joint.name()).collect()
    }

    fn angles_of(determined: &Determined, evidence: AngleEvidence) -> Vec<&'static str> {
        let angles = ANGLE_NAMES.into_iter().zip(determined.angles);
        let angles = angles.filter(|(_, of_angle)| *of_angle == evidence);
        angles.map(|(name, _)| name).collect()
    }

    #[test]
    fn seventeen_keypoints_do_not_determine_feet_and_scapulas() {
        let coco = by(&COCO17);
        assert_eq!(
            unknown_joints(&coco),
            ["left_heel", "right_heel", "left_toe", "right_toe"]
        );
        let parts = [
            "scapula_elevation",
            "scapula_protraction",
            "scapula_tilt",
            "ankle_angle",
            "subtalar_angle",
            "foot_rotation",
        ];
        let expected: Vec<String> = ["r", "l"]
            .iter()
            .flat_map(|side| parts.map(|part| format!("{part}_{side}")))
            .collect();
        assert_eq!(angles_of(&coco, AngleEvidence::Missing), expected);
        assert_eq!(
            angles_of(&coco, AngleEvidence::Shared),
            ["pelvis_tilt", "lumbar_extension"]
        );
    }

    #[test]
    fn keypoints_on_the_feet_determine_feet() {
        let feet = ["left_heel", "right_heel", "left_big_toe", "right_big_toe"];
        let feet = feet
            .into_iter()
            .chain(["left_small_toe", "right_small_toe"]);
        let names: Vec<&str> = COCO17.into_iter().chain(feet).collect();
        let determined = by(&names);
        assert!(unknown_joints(&determined).is_empty());
        let missing = angles_of(&determined, AngleEvidence::Missing);
        for name in ["ankle_angle_r", "ankle_angle_l"] {
            assert!(!missing.contains(&name), "{missing:?}");
        }
    }

    #[test]
    fn without_face_keypoints_the_head_is_undetermined() {
        let determined = by(&COCO17[5..]);
        for name in ["head", "nose", "left_ear"] {
            assert!(unknown_joints(&determined).contains(&name), "{name}");
        }
        assert!(angles_of(&determined, AngleEvidence::Missing).contains(&"neck_flexion"));
    }
}
