//! Sightings of people without boxes: from detections, and from persons of keypoint files.

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Distorted, Pixel};
use farfield_proto::id::CameraIndex;
use farfield_proto::message::{KeypointPeak, MAX_SIGHTINGS, Sighting};

use super::batch::Batch;
use super::camera::BeyondView;
use crate::crop::CropGeometry;
use crate::inference::Detection;
use crate::peaks::best_peak;
use crate::source::KeypointCandidate;

/// Least height of a keypoint's peak in a sighting, 0 to 1. Without content networks answer up to
/// this value.
const MIN_PEAK: f32 = 0.06;

/// A detection whose crop waits for the network.
pub(super) struct Pending {
    camera: CameraIndex,
    score: f32,
    crop: CropGeometry,
    /// Index in the batch.
    input: usize,
}

impl Pending {
    pub(super) fn camera(&self) -> CameraIndex {
        self.camera
    }
}

/// 1 if `found` is missing for a fisheye. The models of other lenses end at the edge of the
/// picture.
fn beyond_view<T>(found: Option<&T>, model: &CameraModel) -> u64 {
    u64::from(found.is_none() && model.lens().is_fisheye())
}

/// Adds the crops of detections of the camera at index `at` to the batch. Detections beyond the
/// lens model or its used part are left out; those of a fisheye are counted.
pub(super) fn enqueue(
    detections: &[Detection],
    at: usize,
    camera: CameraIndex,
    model: &CameraModel,
    batch: &mut Batch,
    beyond: &mut BeyondView,
) -> Vec<Pending> {
    let mut pending = Vec::new();
    for detection in detections.iter().take(MAX_SIGHTINGS) {
        let around = undistorted_box(detection, model, batch.box_margin());
        beyond.detections += beyond_view(around.as_ref(), model);
        let crop = around.and_then(|b| CropGeometry::new(&b, batch.shape()));
        let Some(crop) = crop else { continue };
        let input = batch.push(at, crop);
        pending.push(Pending {
            camera,
            score: detection.score,
            crop,
            input,
        });
    }
    pending
}

/// Reads the peaks of a detection's maps after inference. Peaks outside the image are left out,
/// because the network guessed them. So are peaks beyond the used part of a fisheye, which are
/// counted.
pub(super) fn read(
    pending: &Pending,
    model: &CameraModel,
    batch: &Batch,
    n_keypoints: usize,
    beyond: &mut BeyondView,
) -> Sighting {
    let grid = pending.crop.grid();
    let peak = |keypoint| {
        let map = batch.map(pending.input, keypoint);
        let peak = best_peak(map, grid.width.into(), MIN_PEAK)?;
        let pixel = grid.pixel(peak.cell[0], peak.cell[1]);
        beyond.keypoints += beyond_view(model.distort(pixel).as_ref(), model);
        model.sees(pixel).then(|| KeypointPeak {
            position_px: [pixel.x() as f32, pixel.y() as f32],
            score: peak.value.min(1.0),
        })
    };
    Sighting {
        camera: pending.camera,
        score: pending.score,
        keypoints: (0..n_keypoints).map(peak).collect(),
    }
    .snapped()
}

/// Sightings from grouped persons, with the mean of their keypoints' scores. Keypoints beyond the
/// lens model or its used part are left out; those of a fisheye are counted.
pub(super) fn from_persons(
    persons: &[Vec<Option<KeypointCandidate>>],
    camera: CameraIndex,
    model: &CameraModel,
    beyond: &mut BeyondView,
) -> Vec<Sighting> {
    let mut sightings = Vec::new();
    for person in persons {
        let keypoints: Vec<Option<KeypointPeak>> = person
            .iter()
            .map(|candidate| {
                let candidate = candidate.as_ref()?;
                let pixel = model.undistort(candidate.position);
                beyond.keypoints += beyond_view(pixel.as_ref(), model);
                let pixel = pixel?;
                let position_px = [pixel.x() as f32, pixel.y() as f32];
                Some(KeypointPeak {
                    position_px,
                    score: candidate.score,
                })
            })
            .collect();
        let seen = keypoints.iter().flatten().count();
        if seen > 0 {
            let score = keypoints.iter().flatten().map(|k| k.score).sum::<f32>() / seen as f32;
            let sighting = Sighting {
                camera,
                score,
                keypoints,
            };
            sightings.push(sighting.snapped());
        }
    }
    sightings
}

/// Keeps at most the [`MAX_SIGHTINGS`] sightings of highest score.
pub(super) fn bounded(mut sightings: Vec<Sighting>) -> Vec<Sighting> {
    if sightings.len() > MAX_SIGHTINGS {
        // Stable, so that equal pictures give equal results.
        sightings.sort_by(|a, b| b.score.total_cmp(&a.score));
        sightings.truncate(MAX_SIGHTINGS);
    }
    sightings
}

/// The upright box around an undistorted detection, grown by `margin`.
fn undistorted_box(detection: &Detection, model: &CameraModel, margin: f64) -> Option<BoundingBox> {
    let [left, top] = detection.min_px.map(f64::from);
    let [right, bottom] = detection.max_px.map(f64::from);
    let mut around = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    // A lens bends the edges of a box, so corners, middles of edges and the centre are used.
    for i in 0..9 {
        let (u, v) = (f64::from(i % 3) / 2.0, f64::from(i / 3) / 2.0);
        let at = Pixel::<Distorted>::new(left + u * (right - left), top + v * (bottom - top));
        if let Some(p) = model.undistort(at) {
            let [l, t, r, b] = around;
            around = [l.min(p.x()), t.min(p.y()), r.max(p.x()), b.max(p.y())];
        }
    }
    let [l, t, r, b] = around;
    let bounding_box = BoundingBox {
        center_px: [l.midpoint(r) as f32, t.midpoint(b) as f32],
        size_px: [((r - l) * margin) as f32, ((b - t) * margin) as f32],
        rotation_rad: 0.0,
    };
    bounding_box.is_valid().then_some(bounding_box)
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::Distortion;

    use super::*;
    use crate::fixtures::{bent, distorted, fisheye, pinhole};

    fn assert_near(got: [f32; 2], expected: [f32; 2]) {
        let distance = (got[0] - expected[0]).hypot(got[1] - expected[1]);
        assert!(distance < 1e-3, "{got:?} is not {expected:?}");
    }

    #[test]
    fn a_detected_box_is_grown_and_undistorted() {
        let detection = Detection {
            min_px: [500.0, 300.0],
            max_px: [540.0, 400.0],
            score: 0.9,
        };
        let b = undistorted_box(&detection, &pinhole("a", [640, 480]), 1.25).unwrap();
        assert_near(b.center_px, [520.0, 350.0]);
        assert_near(b.size_px, [50.0, 125.0]);
        // The lens moves points towards the centre, compared with a pinhole.
        let undone = undistorted_box(&detection, &bent("a", [640, 480]), 1.25).unwrap();
        assert!(undone.center_px[0] > 520.5 && undone.size_px[1] > 125.0);
    }

    #[test]
    fn an_inverted_box_is_left_out() {
        let detection = Detection {
            min_px: [500.0, 300.0],
            max_px: [500.0, 300.0],
            score: 0.9,
        };
        assert_eq!(
            undistorted_box(&detection, &pinhole("a", [640, 480]), 1.25),
            None
        );
    }

    #[test]
    fn grouped_persons_of_a_keypoint_file_are_sightings() {
        let seen = |x, score| {
            Some(KeypointCandidate {
                position: Pixel::new(x, 10.0),
                score,
            })
        };
        let persons = [
            vec![None, None, None],
            vec![seen(5.03, 0.4), None, seen(7.0, 0.8)],
        ];
        let mut beyond = BeyondView::default();
        let camera = pinhole("a", [640, 480]);
        let sightings = from_persons(&persons, CameraIndex(2), &camera, &mut beyond);
        assert!(beyond.is_none());
        assert_eq!(sightings.len(), 1);
        assert!((sightings[0].score - 0.6).abs() < 1e-6);
        assert_eq!(sightings[0].keypoints[1], None);
        assert_eq!(sightings[0].clone().snapped(), sightings[0]);
        assert_near(sightings[0].keypoints[2].unwrap().position_px, [7.0, 10.0]);
    }

    #[test]
    fn only_fisheye_lenses_report_a_limited_view() {
        // Keypoint files may contain positions outside the picture, for which no lens model holds.
        let barrel = Distortion {
            k1: -0.1,
            ..Distortion::default()
        };
        let camera = distorted("a", [640, 480], barrel);
        let far = Pixel::new(-9e4, 240.0);
        assert_eq!(camera.undistort(far), None);
        let seen = Some(KeypointCandidate {
            position: far,
            score: 0.8,
        });
        let mut beyond = BeyondView::default();
        let persons = [vec![seen, None]];
        assert!(from_persons(&persons, CameraIndex(0), &camera, &mut beyond).is_empty());
        assert!(beyond.is_none(), "{beyond}");
    }

    #[test]
    fn fisheye_content_beyond_60_degrees_is_left_out_and_counted() {
        // 180 degrees across: 60 off the axis are 213 pixels from the middle.
        let camera = fisheye("a", [640, 480]);
        let at = |x: f32| Detection {
            min_px: [x - 20.0, 200.0],
            max_px: [x + 20.0, 280.0],
            score: 0.9,
        };
        assert_eq!(undistorted_box(&at(600.0), &camera, 1.25), None);
        // The part of a person inside the view is used.
        let cut = undistorted_box(&at(530.0), &camera, 1.0).unwrap();
        let right_px = cut.center_px[0] + 0.5 * cut.size_px[0];
        let rim_px = 319.5 + camera.intrinsics().fx_px * 60.0_f64.to_radians().tan();
        assert!(f64::from(right_px) <= rim_px, "{right_px} of {rim_px}");
        let seen = |x| {
            Some(KeypointCandidate {
                position: Pixel::new(x, 240.0),
                score: 0.8,
            })
        };
        let mut beyond = BeyondView::default();
        let persons = [vec![seen(500.0), seen(560.0), seen(620.0), None]];
        let sightings = from_persons(&persons, CameraIndex(0), &camera, &mut beyond);
        assert_eq!((beyond.detections, beyond.keypoints), (0, 2));
        let kept: Vec<bool> = sightings[0].keypoints.iter().map(Option::is_some).collect();
        assert_eq!(kept, [true, false, false, false]);
        assert!(
            beyond
                .to_string()
                .starts_with("0 detections and 2 keypoints beyond 120 degrees of view")
        );
    }
}
