//! The highest peak of each map of a patch, refined below the cell: one position per keypoint.

use farfield_edge::peaks::best_peak;
use farfield_proto::frames::{Pixel, Undistorted};
use farfield_proto::message::PersonPatch;
use farfield_proto::patch::{Decoder, Maps};

/// The best peak of one keypoint in one view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewPeak {
    /// Position, undistorted pixels of the camera.
    pub pixel: Pixel<Undistorted>,
    /// Height, 0 to 1: the likelihood.
    pub height: f32,
}

/// Reads patches with reused buffers.
pub struct PeakReader {
    decoder: Decoder,
    maps: Maps,
    map: Vec<f32>,
}

impl Default for PeakReader {
    fn default() -> Self {
        Self {
            decoder: Decoder::new(),
            maps: Maps::new(1, 1, 1),
            map: Vec::new(),
        }
    }
}

impl PeakReader {
    /// The best peak of each keypoint of `patch`, `None` for an empty map; empty if the patch cannot be decoded.
    pub fn read(&mut self, patch: &PersonPatch) -> Vec<Option<ViewPeak>> {
        if self.decoder.decode(&patch.maps, &mut self.maps).is_err() {
            return Vec::new();
        }
        let n_keypoints = self.maps.keypoints();
        (0..n_keypoints)
            .map(|k| {
                let crop = patch
                    .crops
                    .get(usize::from(*patch.crop_of_keypoint.get(k)?))?;
                self.map.clear();
                self.map.extend(
                    self.maps
                        .cells(k)
                        .iter()
                        .map(|&cell| f32::from(cell) / 255.0),
                );
                let peak = best_peak(&self.map, self.maps.width(), 0.0)?;
                Some(ViewPeak {
                    pixel: crop.pixel(peak.cell[0], peak.cell[1]),
                    height: peak.value,
                })
            })
            .collect()
    }
}
