//! Observed joints of a body in space, from any source.

use nalgebra::{Matrix3, Unit, Vector3};

use super::skeleton::{Joint, N_JOINTS, Site};

/// A point that represents a joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservedPoint {
    /// World metres.
    pub position_m: Vector3<f64>,
    /// Offset of the point from the joint, metres, in the joint's link.
    pub offset_m: Vector3<f64>,
    /// Its weight, 0 to 1.
    pub weight: f64,
}

/// The known points of one body at one tick, by joint.
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
    /// The points under their joints' names, each with weight 1; unknown names and positions that
    /// are not finite are ignored.
    pub fn from_named<'a>(points: impl IntoIterator<Item = (&'a str, [f64; 3])>) -> Self {
        let mut observed = Self::default();
        for (name, position) in points {
            if let Some(joint) = Joint::from_name(name) {
                observed.set(joint, Vector3::from(position), 1.0);
            }
        }
        observed
    }

    /// The keypoints of a tick with evidence from two viewpoints; of two on one joint the first is
    /// used.
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

    /// Sets the place of `joint`; ignored if position or weight is not finite, or the weight is not
    /// positive.
    pub fn set(&mut self, joint: Joint, position_m: Vector3<f64>, weight: f64) {
        self.set_site(&Site::at(joint), position_m, weight);
    }

    /// As [`Self::set`], for a point with an offset from the joint.
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

    /// Removes `joint`.
    pub fn remove(&mut self, joint: Joint) {
        self.points[joint.index()] = None;
    }

    /// The point of `joint`.
    pub fn point(&self, joint: Joint) -> Option<&ObservedPoint> {
        self.points[joint.index()].as_ref()
    }

    /// The place of `joint`, world metres.
    pub fn position_m(&self, joint: Joint) -> Option<Vector3<f64>> {
        self.point(joint).map(|point| point.position_m)
    }

    /// The middle between two known joints, world metres.
    pub fn middle_m(&self, joints: [Joint; 2]) -> Option<Vector3<f64>> {
        Some(0.5 * (self.position_m(joints[0])? + self.position_m(joints[1])?))
    }

    /// All known points, in the model's order.
    pub fn iter(&self) -> impl Iterator<Item = (Joint, &ObservedPoint)> {
        Joint::ALL
            .iter()
            .filter_map(|&joint| Some((joint, self.point(joint)?)))
    }

    /// Whether a point has an offset from its joint.
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

/// The estimate of one keypoint from the views.
#[derive(Debug, Clone, PartialEq)]
pub struct KeypointEstimate {
    /// Most probable position at the tick, world, metres; the prediction if unsupported.
    pub position_m: Vector3<f64>,
    /// S at the position: weighted mean of the maps, 0 to 1.
    pub support: f64,
    /// W of eq. (12), 0 to 1: the support times the share of the views' weight after occlusion. 0
    /// if the keypoint is unsupported.
    pub weight: f64,
    /// Independent viewpoints whose map supports the position. Views whose rays are nearly one line
    /// count as one, also from opposite sides.
    pub views: u16,
    /// Set if only one independent viewpoint supports the position. The position is then known
    /// across this ray (from the camera, world axes), and along it the prediction was kept.
    pub ray: Option<Unit<Vector3<f64>>>,
    /// Inverse covariance of the position, 1/m²; zero before the views are weighted. It is the
    /// uncertainty of the position, not its weight.
    pub information: Matrix3<f64>,
    /// Additional variance per axis because views show the keypoint elsewhere, m². It affects only
    /// the sigma: poses are fitted by `information`.
    pub split_m2: f64,
}

impl KeypointEstimate {
    /// A keypoint without support.
    pub(crate) fn unsupported(predicted_m: Vector3<f64>, support: f64) -> Self {
        Self {
            position_m: predicted_m,
            support,
            weight: 0.0,
            views: 0,
            ray: None,
            information: Matrix3::zeros(),
            split_m2: 0.0,
        }
    }
}
