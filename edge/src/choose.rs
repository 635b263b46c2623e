//! Camera choice: the camera of the viewpoint from which a person's crop is cut (Ohashi 2020, eq.
//! (5), extended).
//!
//! Works on boxes in undistorted pixels that are already moved to the tick of the pictures. The
//! caller leaves out cameras without a picture at this tick, so a dead camera is replaced within
//! the tick. No pixels are read here.

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Pixel, Undistorted};
use farfield_proto::message::CameraBox;
use farfield_proto::venue::parameters::CameraChoice;

/// Samples per side of a box in the test for being inside the image.
const SAMPLES_PER_SIDE: usize = 8;

/// Least share of a box inside the image for a camera to see the person; a thinner strip contains
/// no complete limb.
const MIN_INSIDE: f64 = 0.06;

/// Pixels on the person (root of the box's area) above which more do not help: a crop of a common
/// network (192 x 256) is then no longer enlarged.
const ENOUGH_PX: f64 = 220.0;

/// Ratio by which another camera must be better to replace the current one. A change of camera
/// changes the calibration error, which is visible as a jump.
const HYSTERESIS: f64 = 1.1;

/// A camera with a picture, and the expected box in it.
#[derive(Debug, Clone, Copy)]
pub struct CameraCandidate<'a> {
    /// The camera.
    pub model: &'a CameraModel,
    /// The person's box, moved to the tick of the picture.
    pub camera_box: CameraBox,
}

impl CameraCandidate<'_> {
    /// Share of the box inside the image, 0 to 1, from an 8 x 8 grid of samples.
    pub fn inside(&self) -> f64 {
        let b = &self.camera_box.bounding_box;
        let n = SAMPLES_PER_SIDE;
        let at = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
        let seen = (0..n * n)
            .filter(|i| self.model.sees(point_of(b, at(i % n), at(i / n))))
            .count();
        seen as f64 / (n * n) as f64
    }

    /// Distance of the projected torso to the image centre, pixels as recorded; in undistorted
    /// pixels beyond the lens model.
    fn distance_to_center_px(&self) -> f64 {
        let [x, y] = self.camera_box.torso_px.map(f64::from);
        let torso = Pixel::<Undistorted>::new(x, y);
        let recorded = self
            .model
            .distort(torso)
            .map_or(torso.vector_px(), |p| p.vector_px());
        let [width, height] = self.model.size_px().map(f64::from);
        (recorded - nalgebra::Vector2::new((width - 1.0) / 2.0, (height - 1.0) / 2.0)).norm()
    }

    /// Score of the camera for the person, above 0, no unit; `None` if it does not see the person.
    ///
    /// ```text
    ///   inside^2  min(1, pixels / enough)^(1/2)  exp(-r^2 / 2),   r: distance / half the diagonal
    /// ```
    ///
    /// The share inside the image has the largest weight, because nothing replaces the outside.
    /// Then come resolution (root of the box's area, pixels) and the distance of eq. (5), relative
    /// to the image so that wide and tele lenses compare. The weights are our own.
    fn score(&self) -> Option<f64> {
        let inside = self.inside();
        if inside < MIN_INSIDE {
            return None;
        }
        let [width, height] = self.camera_box.bounding_box.size_px.map(f64::from);
        let detail = ((width * height).sqrt() / ENOUGH_PX).min(1.0);
        let [image_width, image_height] = self.model.size_px().map(f64::from);
        let r = self.distance_to_center_px() / (0.5 * image_width.hypot(image_height));
        Some(inside * inside * detail.sqrt() * (-0.5 * r * r).exp())
    }
}

/// The point of a box at (`u`, `v`) in [-0.5, 0.5] along its rotated axes.
fn point_of(b: &BoundingBox, u: f64, v: f64) -> Pixel<Undistorted> {
    let (sin, cos) = f64::from(b.rotation_rad).sin_cos();
    let (along, down) = (u * f64::from(b.size_px[0]), v * f64::from(b.size_px[1]));
    Pixel::new(
        f64::from(b.center_px[0]) + along * cos - down * sin,
        f64::from(b.center_px[1]) + along * sin + down * cos,
    )
}

/// Chooses the camera for one person by the venue's setting: [`choose_camera`] or
/// [`nearest_center`].
pub fn choose(
    choice: CameraChoice,
    views: &[CameraCandidate<'_>],
    last: Option<usize>,
) -> Option<usize> {
    match choice {
        CameraChoice::BestView => choose_camera(views, last),
        CameraChoice::NearestCenter => nearest_center(views),
    }
}

/// Chooses the camera for one person: index in `views`, `None` if no camera sees the person.
///
/// A box half outside is used only without a better one. `last` is the index of the camera chosen
/// at the last tick, which another must exceed by 10 %. Of equal views the first is chosen.
pub fn choose_camera(views: &[CameraCandidate<'_>], last: Option<usize>) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (i, view) in views.iter().enumerate() {
        let Some(score) = view.score() else { continue };
        let score = if last == Some(i) {
            score * HYSTERESIS
        } else {
            score
        };
        if best.is_none_or(|(_, b)| score > b) {
            best = Some((i, score));
        }
    }
    best.map(|(i, _)| i)
}

/// Eq. (5) of the paper without extensions, for comparisons: the camera whose image centre is
/// nearest to the projected torso, in pixels, whatever it sees. Index in `views`; the first of
/// equals.
pub fn nearest_center(views: &[CameraCandidate<'_>]) -> Option<usize> {
    let mut best: Option<(usize, f64)> = None;
    for (i, view) in views.iter().enumerate() {
        let distance = view.distance_to_center_px();
        if best.is_none_or(|(_, b)| distance < b) {
            best = Some((i, distance));
        }
    }
    best.map(|(i, _)| i)
}

#[cfg(test)]
mod tests {
    use farfield_proto::bounding_box::BoxRate;
    use farfield_proto::id::CameraIndex;

    use super::*;
    use crate::fixtures::pinhole;

    fn at(center_px: [f32; 2], size_px: [f32; 2]) -> CameraBox {
        CameraBox {
            camera: CameraIndex(0),
            bounding_box: BoundingBox {
                center_px,
                size_px,
                rotation_rad: 0.0,
            },
            rate: BoxRate::default(),
            torso_px: center_px,
            neck_px: [center_px[0], center_px[1] - 0.3 * size_px[1]],
        }
    }

    #[test]
    fn the_camera_that_sees_the_person_in_its_middle_is_chosen() {
        let model = pinhole("a", [640, 480]);
        let views = [
            CameraCandidate {
                model: &model,
                camera_box: at([500.0, 240.0], [100.0, 200.0]),
            },
            CameraCandidate {
                model: &model,
                camera_box: at([320.0, 240.0], [100.0, 200.0]),
            },
        ];
        assert_eq!(choose_camera(&views, None), Some(1));
        assert_eq!(nearest_center(&views), Some(1));
    }

    #[test]
    fn a_box_half_outside_is_chosen_only_without_a_better_one() {
        let model = pinhole("a", [640, 480]);
        let cut = CameraCandidate {
            model: &model,
            camera_box: at([0.0, 240.0], [100.0, 200.0]),
        };
        let whole = CameraCandidate {
            model: &model,
            camera_box: at([580.0, 360.0], [100.0, 200.0]),
        };
        assert!((cut.inside() - 0.5).abs() < 0.07);
        assert_eq!(choose_camera(&[cut, whole], None), Some(1));
        assert_eq!(choose_camera(&[cut], None), Some(0));
    }

    #[test]
    fn a_person_outside_every_image_is_seen_by_no_camera() {
        let model = pinhole("a", [640, 480]);
        let outside = CameraCandidate {
            model: &model,
            camera_box: at([-200.0, 240.0], [100.0, 200.0]),
        };
        assert_eq!(choose_camera(&[outside], None), None);
        assert_eq!(choose_camera(&[], None), None);
    }

    #[test]
    fn a_tele_lens_wins_despite_a_larger_distance_in_pixels() {
        let model = pinhole("a", [1920, 1200]);
        let wide = CameraCandidate {
            model: &model,
            camera_box: at([1000.0, 600.0], [30.0, 60.0]),
        };
        let tele = CameraCandidate {
            model: &model,
            camera_box: at([1250.0, 600.0], [200.0, 400.0]),
        };
        assert_eq!(nearest_center(&[wide, tele]), Some(0));
        assert_eq!(choose_camera(&[wide, tele], None), Some(1));
    }

    #[test]
    fn the_last_camera_is_kept_until_another_is_clearly_better() {
        let model = pinhole("a", [640, 480]);
        let here = CameraCandidate {
            model: &model,
            camera_box: at([330.0, 240.0], [100.0, 200.0]),
        };
        let there = CameraCandidate {
            model: &model,
            camera_box: at([400.0, 240.0], [100.0, 200.0]),
        };
        assert_eq!(choose_camera(&[here, there], None), Some(0));
        assert_eq!(choose_camera(&[here, there], Some(1)), Some(1));
        let far = CameraCandidate {
            model: &model,
            camera_box: at([630.0, 240.0], [100.0, 200.0]),
        };
        assert_eq!(choose_camera(&[here, far], Some(1)), Some(0));
    }
}
