//! What is known of a body's joints in space, whoever said so.

use nalgebra::Vector3;

use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::{Joint, N_JOINTS, Site};

/// A point that stands for a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservedPoint {
    /// World metres.
    pub position_m: Vector3<f64>,
    /// How far the point is from the joint, metres, in the joint's link.
    pub offset_m: Vector3<f64>,
    /// How much it is to be trusted, 0 to 1.
    pub weight: f64,
}

/// The points that are known of one body at one tick, by joint.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedJoints {
    points: [Option<ObservedPoint>; N_JOINTS],
}

impl Default for ObservedJoints {
    fn default() -> Self {
        Self {
            points: [None; N_JOINTS],
        }
    }
}

impl ObservedJoints {
    /// The points under their joints' names, each with weight 1; names that are no joint and
    /// positions that are not finite are left out.
    pub fn from_named<'a>(points: impl IntoIterator<Item = (&'a str, [f64; 3])>) -> Self {
        let mut observed = Self::default();
        for (name, position) in points {
            if let Some(joint) = Joint::from_name(name) {
                observed.set(joint, Vector3::from(position), 1.0);
            }
        }
        observed
    }

    /// The keypoints of a tick with evidence from two viewpoints; of two on one joint the first stands
    /// for it.
    pub fn from_estimates(estimates: &[KeypointEstimate], sites: &[Option<Site>]) -> Self {
        let mut observed = Self::default();
        for (estimate, site) in estimates.iter().zip(sites) {
            if let Some(site) = site
                && estimate.views >= 2
                && observed.point(site.joint).is_none()
            {
                observed.set_site(site, estimate.position_m, estimate.weight);
            }
        }
        observed
    }

    /// Notes where `joint` was seen; a position or weight that is not finite, or no weight, is left
    /// out.
    pub fn set(&mut self, joint: Joint, position_m: Vector3<f64>, weight: f64) {
        self.set_site(&Site::at(joint), position_m, weight);
    }

    /// As [`Self::set`], for a point beside the joint.
    pub fn set_site(&mut self, site: &Site, position_m: Vector3<f64>, weight: f64) {
        let finite = position_m
            .iter()
            .chain(&site.offset_m)
            .all(|v| v.is_finite());
        if finite && weight.is_finite() && weight > 0.0 {
            self.points[site.joint.index()] = Some(ObservedPoint {
                position_m,
                offset_m: site.offset_m,
                weight,
            });
        }
    }

    /// Forgets what is known of `joint`.
    pub fn remove(&mut self, joint: Joint) {
        self.points[joint.index()] = None;
    }

    /// What is known of `joint`.
    pub fn point(&self, joint: Joint) -> Option<&ObservedPoint> {
        self.points[joint.index()].as_ref()
    }

    /// Where `joint` was seen, world metres.
    pub fn position_m(&self, joint: Joint) -> Option<Vector3<f64>> {
        self.point(joint).map(|point| point.position_m)
    }

    /// The middle between two joints that were both seen, world metres.
    pub fn middle_m(&self, joints: [Joint; 2]) -> Option<Vector3<f64>> {
        Some(0.5 * (self.position_m(joints[0])? + self.position_m(joints[1])?))
    }

    /// All that are known, in the model's order.
    pub fn iter(&self) -> impl Iterator<Item = (Joint, &ObservedPoint)> {
        Joint::ALL
            .iter()
            .filter_map(|&joint| Some((joint, self.point(joint)?)))
    }

    /// Whether a point stands beside its joint.
    pub fn has_offsets(&self) -> bool {
        self.points
            .iter()
            .flatten()
            .any(|point| point.offset_m != Vector3::zeros())
    }

    /// How many are known.
    pub fn count(&self) -> usize {
        self.points.iter().flatten().count()
    }
}
