//! People without boxes: detections, and persons of keypoint files, as sightings.

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Distorted, Pixel};
use farfield_proto::id::CameraIndex;
use farfield_proto::message::{KeypointPeak, MAX_SIGHTINGS, Sighting};
use image::RgbImage;

use super::batch::Batch;
use crate::crop::CropGeometry;
use crate::inference::Detection;
use crate::peaks::best_peak;
use crate::source::KeypointCandidate;

/// Least height of a keypoint's peak in a sighting, 0 to 1: where there is nothing, networks answer up to this.
const LEAST_PEAK: f32 = 0.06;

/// A detection whose crop waits for the network.
pub(super) struct Pending {
    camera: CameraIndex,
    score: f32,
    crop: CropGeometry,
    /// Its number in the batch.
    input: usize,
}

impl Pending {
    pub(super) fn camera(&self) -> CameraIndex {
        self.camera
    }
}

/// Puts the crops of detections into the batch; detections beyond the lens model are left out.
pub(super) fn enqueue(
    detections: &[Detection],
    image: &RgbImage,
    (camera, model): (CameraIndex, &CameraModel),
    batch: &mut Batch,
) -> Vec<Pending> {
    let mut pending = Vec::new();
    for detection in detections.iter().take(MAX_SIGHTINGS) {
        let crop = undistorted_box(detection, model, batch.box_margin())
            .and_then(|b| CropGeometry::new(&b, batch.shape()));
        let Some(crop) = crop else { continue };
        let input = batch.push(image, model, &crop);
        pending.push(Pending {
            camera,
            score: detection.score,
            crop,
            input,
        });
    }
    pending
}

/// Reads the peaks of a detection's maps, after inference. Peaks outside the image are left out: the network
/// guessed them from nothing.
pub(super) fn read(
    pending: &Pending,
    model: &CameraModel,
    batch: &Batch,
    n_keypoints: usize,
) -> Sighting {
    let grid = pending.crop.grid();
    let peak = |keypoint| {
        let map = batch.map(pending.input, keypoint);
        let peak = best_peak(map, grid.width.into(), LEAST_PEAK)?;
        let pixel = grid.pixel(peak.cell[0], peak.cell[1]);
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
}

/// Persons whose keypoints are grouped already; their score is the mean of their keypoints' scores.
pub(super) fn from_persons(
    persons: &[Vec<Option<KeypointCandidate>>],
    camera: CameraIndex,
    model: &CameraModel,
) -> Vec<Sighting> {
    let mut sightings = Vec::new();
    for person in persons {
        let keypoints: Vec<Option<KeypointPeak>> = person
            .iter()
            .map(|candidate| {
                let candidate = candidate.as_ref()?;
                let pixel = model.undistort(candidate.position)?;
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
            sightings.push(Sighting {
                camera,
                score,
                keypoints,
            });
        }
    }
    sightings
}

/// Keeps the [`MAX_SIGHTINGS`] sightings of highest score, where there are more.
pub(super) fn bounded(mut sightings: Vec<Sighting>) -> Vec<Sighting> {
    if sightings.len() > MAX_SIGHTINGS {
        // Stable, so that the same pictures give the same choice.
        sightings.sort_by(|a, b| b.score.total_cmp(&a.score));
        sightings.truncate(MAX_SIGHTINGS);
    }
    sightings
}

/// The upright box around a detection after the lens is undone, grown by `margin`.
fn undistorted_box(detection: &Detection, model: &CameraModel, margin: f64) -> Option<BoundingBox> {
    let [left, top] = detection.min_px.map(f64::from);
    let [right, bottom] = detection.max_px.map(f64::from);
    let mut around = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    // A lens bends the edges of a box: corners, middles of the edges and the centre.
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
    use super::*;
    use crate::fixtures::{bent, pinhole};

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
        // The bent lens draws things nearer to the centre than a pinhole.
        let undone = undistorted_box(&detection, &bent("a", [640, 480]), 1.25).unwrap();
        assert!(undone.center_px[0] > 520.5 && undone.size_px[1] > 125.0);
    }

    #[test]
    fn a_box_turned_inside_out_is_left_out() {
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
            vec![seen(5.0, 0.4), None, seen(7.0, 0.8)],
        ];
        let sightings = from_persons(&persons, CameraIndex(2), &pinhole("a", [640, 480]));
        assert_eq!(sightings.len(), 1);
        assert!((sightings[0].score - 0.6).abs() < 1e-6);
        assert_eq!(sightings[0].keypoints[1], None);
        assert_near(sightings[0].keypoints[2].unwrap().position_px, [7.0, 10.0]);
    }
}
