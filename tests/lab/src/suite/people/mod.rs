//! The people of a scene for scoring: bodies, presence, gaps, id changes, recoveries.

pub mod id_changes;
pub mod presence;
pub mod recovery;

use std::collections::BTreeMap;

use farfield_fusion::body::skeleton::{Joint, Joints, N_JOINTS};
use farfield_proto::keypoints::{COCO17, KeypointSet};
use farfield_proto::message::{PersonPose, PersonState, PoseSet};
use farfield_proto::tick::Tick;

use farfield_score::points::{JointDetail, PointSet, ScoredBody, Sureness};
use farfield_sim::scene::PersonTruth;
use nalgebra::Vector3;

/// People by tick and id.
pub type People = BTreeMap<Tick, BTreeMap<u32, ScoredBody>>;

/// A true person for scoring.
pub fn true_body(truth: &PersonTruth) -> ScoredBody {
    let joint = |name: &str| joint_m(&truth.joints_m, name);
    let mut body = ScoredBody::gather(PointSet::Joints, joint, joint);
    body.set_sites(|name| {
        let index = COCO17.iter().position(|keypoint| *keypoint == name)?;
        Some(truth.sites_m[index])
    });
    body.detail = Some(Box::new(JointDetail::gather(joint, None)));
    body
}

/// A pose for scoring.
pub fn pose_body(pose: &PersonPose, keypoints: &KeypointSet) -> ScoredBody {
    let to_f64 = |p: &[f32; 3]| Vector3::from(p.map(f64::from));
    let joint = |name: &str| {
        let joint = Joint::from_name(name)?;
        pose.joints_m.get(joint.index()).map(to_f64)
    };
    let mut body = ScoredBody::gather(PointSet::Joints, joint, joint);
    body.set_sites(|name| {
        let index = keypoints.index_of(name)?;
        pose.keypoints_m.get(index).map(to_f64)
    });
    body.is_tentative = pose.state == PersonState::Tentative;
    body.detail = <[f32; N_JOINTS]>::try_from(pose.sigma_m.as_slice())
        .ok()
        .map(|sigma_m| {
            let sureness = Sureness {
                state: pose.state,
                views: pose.views,
                sigma_m,
            };
            Box::new(JointDetail::gather(joint, Some(sureness)))
        });
    body
}

/// Adds the poses of one tick.
pub fn add_poses(people: &mut People, poses: &PoseSet, keypoints: &KeypointSet) {
    if poses.persons.is_empty() {
        return;
    }
    let at_tick = people.entry(poses.tick).or_default();
    at_tick.extend(
        poses
            .persons
            .iter()
            .map(|pose| (pose.person.0, pose_body(pose, keypoints))),
    );
}

fn joint_m(joints_m: &Joints, name: &str) -> Option<Vector3<f64>> {
    Some(joints_m[Joint::from_name(name)?.index()])
}
