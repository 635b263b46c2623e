//! What all persons of a venue share: the method with its parameters, and the cameras.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::venue::Parameters;

use crate::body::skeleton::{RangeOfMotion, Site};
use crate::boxes::BoxShape;

/// What all tracks of a venue share.
#[derive(Debug, Clone)]
pub struct Method {
    /// The tunable parts.
    pub parameters: Parameters,
    /// Time from tick to tick, seconds.
    pub dt_s: f64,
    /// The keypoints of the network.
    pub keypoints: KeypointSet,
    /// Per keypoint: where it sits on the model, if anywhere.
    pub sites: Vec<Option<Site>>,
    /// Per keypoint: its expected error over that of the average keypoint.
    pub relative_sigmas: Vec<f64>,
    /// Sigma of the network's peaks, as a share of the width of its maps.
    pub peak_sigma_of_width: f64,
    /// The bounds of the second IK, when they are enabled.
    pub range_of_motion: Option<RangeOfMotion>,
    /// How large boxes are and when they turn.
    pub box_shape: BoxShape,
}

impl Method {
    /// From how many keypoints a person counts as seen.
    pub fn enough_keypoints(&self) -> usize {
        self.parameters.births.min_seen_keypoints as usize
    }
}

/// A camera of the venue, as tracks need it; in the order of [`farfield_proto::id::CameraIndex`].
#[derive(Debug, Clone)]
pub struct VenueView {
    /// Whose camera it is.
    pub viewpoint: ViewpointIndex,
    /// Its calibration.
    pub model: CameraModel,
}
