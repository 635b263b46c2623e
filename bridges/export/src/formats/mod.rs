//! The formats; each is a writer of bytes without file access.

use std::collections::BTreeMap;

use farfield_fusion::body::determined::{UNKNOWN_M, determined_joints};
use farfield_fusion::body::skeleton::{Joint, sites_of};
use farfield_fusion::export::marker_names::point_names;
use farfield_proto::keypoints::KeypointSet;
use nalgebra::Vector3;

use crate::run::Sample;
use crate::skeleton::RestPose;

pub mod bvh;
pub mod c3d;
pub mod foxglove;
pub mod gltf;
pub mod osim;
pub mod parquet;
pub mod table;
pub mod trc_mot;

/// Unique names of the points as in our TRC files, valid in `OpenSim`.
pub(crate) fn names(keypoints: &[String]) -> Vec<String> {
    let joints = Joint::ALL.map(|joint| joint.name().to_owned());
    point_names(&joints, keypoints)
}

/// Per point, in the order of [`names`], whether these keypoints determine it; only those are
/// markers in our TRC files.
pub(crate) fn determined(keypoints: &[String]) -> Vec<bool> {
    let set = KeypointSet::new(keypoints.to_vec());
    let joints = determined_joints(&sites_of(&set, &BTreeMap::new()));
    let keypoints = keypoints.iter().map(|_| true);
    joints.into_iter().chain(keypoints).collect()
}

/// A point of a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Point {
    /// In the world, metres.
    pub(crate) at_m: Vector3<f64>,
    /// Standard deviation per axis, metres, if known.
    pub(crate) sigma_m: Option<f64>,
}

impl Point {
    /// Whether its position is known.
    pub(crate) fn is_known(&self) -> bool {
        self.sigma_m
            .is_none_or(|sigma_m| sigma_m <= f64::from(UNKNOWN_M))
    }
}

/// The points of a pose, in the order of [`names`]; `None` for missing keypoints.
pub(crate) fn points(sample: &Sample, rest: RestPose, keypoints: &[String]) -> Vec<Option<Point>> {
    let sigma_m = |joint: Joint| {
        let all = sample.sigma_m.as_ref()?;
        Some(all[joint.index()]).filter(|sigma_m| sigma_m.is_finite())
    };
    let joints_m = sample.joints_m(rest);
    let joints = Joint::ALL.iter().map(|&joint| {
        Some(Point {
            at_m: joints_m[joint.index()],
            sigma_m: sigma_m(joint),
        })
    });
    let keypoints = keypoints
        .iter()
        .zip(&sample.keypoints_m)
        .map(|(name, at_m)| {
            Some(Point {
                at_m: (*at_m)?,
                sigma_m: Joint::from_name(name).and_then(sigma_m),
            })
        });
    joints.chain(keypoints).collect()
}
