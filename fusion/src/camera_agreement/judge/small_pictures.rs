//! Keypoints of smaller pictures than the calibration's: those of every camera lie in the upper left of its picture.

use super::Judge;
use crate::camera_agreement::report::DisagreementCause;

/// Cameras of which it must be so, and keypoints of each.
const MIN_CAMERAS: usize = 2;
const MIN_KEYPOINTS: usize = 40;
/// Share of width and height in which all keypoints of all cameras lie: in 4K they would be 0.5 from HD, 0.67 from 1440
/// lines, and then nobody can say.
const SHARE: f64 = 0.55;

impl Judge<'_> {
    /// That the keypoints are those of smaller pictures, where no two cameras agree.
    pub(super) fn small_pictures(&self) -> Option<DisagreementCause> {
        let mut share: f64 = 0.0;
        let mut known = 0;
        for (index, camera) in self.cameras.iter().enumerate() {
            let bodies = self.passes.iter().flat_map(|pass| &pass.of_camera[index]);
            let keypoints = bodies.flatten().flatten();
            let (mut n, mut of_camera) = (0, 0.0_f64);
            for keypoint in keypoints {
                let shares = keypoint.pixel.iter().zip(camera.size_px);
                let shares = shares.map(|(px, size)| f64::from(*px) / f64::from(size));
                of_camera = shares.fold(of_camera, f64::max);
                n += 1;
            }
            if n >= MIN_KEYPOINTS {
                share = share.max(of_camera);
                known += 1;
            }
        }
        let is_small = known >= MIN_CAMERAS && share < SHARE;
        (is_small && !self.do_any_agree()).then_some(DisagreementCause::SmallPictures { share })
    }
}
