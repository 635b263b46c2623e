//! Data that all persons of a venue share: the method with its parameters, and the cameras.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::patch::EncodedMaps;
use farfield_proto::venue::Parameters;

use crate::body::skeleton::{RangeOfMotion, Site};
use crate::boxes::BoxShape;

/// Largest maps without a network card (columns, rows): from keypoint files and simulated cameras.
const LARGEST_WITHOUT_CARD: [u16; 2] = [96, 128];

/// Data that all tracks of a venue share.
#[derive(Debug, Clone)]
pub struct Method {
    /// The tunable parameters.
    pub parameters: Parameters,
    /// Tick period, seconds.
    pub dt_s: f64,
    /// The keypoints of the network.
    pub keypoints: KeypointSet,
    /// Per keypoint: its site on the model, if it has one.
    pub sites: Vec<Option<Site>>,
    /// Per keypoint: its expected error over that of the average keypoint.
    pub relative_sigmas: Vec<f64>,
    /// Columns and rows of the network's maps from its card; `None` without one.
    pub map_size: Option<[u16; 2]>,
    /// Sigma of the network's peaks, as a share of the width of its maps.
    pub peak_sigma_of_width: f64,
    /// The bounds of the second IK, if they are enabled.
    pub range_of_motion: Option<RangeOfMotion>,
    /// Height of the floor that people stand on, world z, metres.
    pub floor_m: f64,
    /// Size and rotation limits of boxes.
    pub box_shape: BoxShape,
}

impl Method {
    /// Whether maps have the venue's keypoints and the size of the network's, or a usual size
    /// without a card. A few bytes can encode maps that take a hundred times the work of the
    /// network's.
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

    /// Least keypoints for a person to count as seen.
    pub fn enough_keypoints(&self) -> usize {
        self.parameters.births.min_seen_keypoints as usize
    }
}

/// A camera of the venue for tracks; in the order of [`farfield_proto::id::CameraIndex`].
#[derive(Debug, Clone)]
pub struct VenueView {
    /// Its viewpoint.
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
    fn maps_of_another_size_are_refused() {
        let mut method = MeetingFixture::at(&[]).method;
        assert!(method.takes(&maps(48, 64, 17)), "no card says their size");
        assert!(!method.takes(&maps(256, 256, 17)));
        assert!(!method.takes(&maps(48, 64, 16)));
        method.map_size = Some([72, 96]);
        assert!(method.takes(&maps(72, 96, 17)));
        assert!(!method.takes(&maps(48, 64, 17)));
    }
}
