//! What all persons of a venue share: the method with its parameters, and the cameras.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::patch::EncodedMaps;
use farfield_proto::venue::Parameters;

use crate::body::skeleton::{RangeOfMotion, Site};
use crate::boxes::BoxShape;

/// Most columns and rows of maps that no network made: of keypoint files and simulated cameras.
const LARGEST_WITHOUT_CARD: [u16; 2] = [96, 128];

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
    /// Columns and rows of the network's maps, as its card has them; `None` where no card says it.
    pub map_size: Option<[u16; 2]>,
    /// Sigma of the network's peaks, as a share of the width of its maps.
    pub peak_sigma_of_width: f64,
    /// The bounds of the second IK, when they are enabled.
    pub range_of_motion: Option<RangeOfMotion>,
    /// Height of the floor that people stand on, world z, metres.
    pub floor_m: f64,
    /// How large boxes are and when they turn.
    pub box_shape: BoxShape,
}

impl Method {
    /// Whether maps are of the venue's keypoints, and of the size of the network's, or no larger than usual where there
    /// is none. A few bytes can stand for maps that take a hundred times the work of the network's.
    pub fn takes(&self, maps: &EncodedMaps) -> bool {
        let size = [maps.width, maps.height];
        let is_sized = match self.map_size {
            Some(expected) => size == expected,
            None => size
                .iter()
                .zip(LARGEST_WITHOUT_CARD)
                .all(|(n, most)| *n <= most),
        };
        is_sized && usize::from(maps.keypoints) == self.sites.len()
    }

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::meeting_fixture::MeetingFixture;

    fn maps(width: u16, height: u16, keypoints: u8) -> EncodedMaps {
        EncodedMaps {
            width,
            height,
            keypoints,
            bytes: Vec::new(),
        }
    }

    #[test]
    fn maps_of_another_size_than_the_networks_are_not_taken() {
        let mut method = MeetingFixture::of(&[]).method;
        assert!(method.takes(&maps(48, 64, 17)), "no card says their size");
        assert!(!method.takes(&maps(256, 256, 17)));
        assert!(!method.takes(&maps(48, 64, 16)));
        method.map_size = Some([72, 96]);
        assert!(method.takes(&maps(72, 96, 17)));
        assert!(!method.takes(&maps(48, 64, 17)));
    }
}
