//! Viewpoints that should see a body and do not.
//!
//! A camera without a detection pass is no evidence, and neither is a viewpoint that sees no person
//! at all: it may be down. A sighting that covers the body may hide it: it counts neither for the
//! body nor against it.

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Pixel, Point, Undistorted};
use farfield_proto::id::ViewpointIndex;
use nalgebra::{Vector2, Vector3};

use crate::sightings::rays::SightedBody;

/// Least share of a body's keypoints inside a camera's image for the camera to have missed it.
const SEEN_SHARE: f64 = 0.8;

/// Least share of a body's keypoints inside a sighting's outline to be hidden by it, or to be it.
const HIDDEN_SHARE: f64 = 0.5;

/// Growth of a sighting's outline on each side, as a share of its size: bodies are wider than their
/// joints.
const OUTLINE_GROWTH: f64 = 0.15;

/// The sightings of all cameras in a detection pass.
#[derive(Debug, Clone)]
pub(crate) struct DetectionPass {
    /// One per viewpoint and person seen.
    pub(crate) witnesses: Vec<SightedBody>,
    /// Per camera of the venue: whether the detector ran on it.
    detected: Vec<bool>,
    /// Per camera: the outlines of the witnesses in its image.
    outlines: Vec<Vec<BodyOutline>>,
    viewpoints: Vec<ViewpointIndex>,
}

impl DetectionPass {
    /// `detected` has one value per camera of the venue.
    pub(crate) fn new(witnesses: Vec<SightedBody>, detected: Vec<bool>) -> Self {
        let mut viewpoints: Vec<ViewpointIndex> = witnesses.iter().map(|w| w.viewpoint).collect();
        viewpoints.sort_unstable();
        viewpoints.dedup();
        let mut outlines = vec![Vec::new(); detected.len()];
        for witness in &witnesses {
            if let Some(own) = outlines.get_mut(witness.camera) {
                own.extend(BodyOutline::around(witness));
            }
        }
        Self {
            witnesses,
            detected,
            outlines,
            viewpoints,
        }
    }

    /// The viewpoints that saw any person, in order.
    pub(crate) fn viewpoints(&self) -> &[ViewpointIndex] {
        &self.viewpoints
    }

    /// Whether a camera of `viewpoint` that ran the detector has the body of `points_m` (world)
    /// well in its image, and none of its sightings covers it.
    pub(crate) fn is_missed_by(
        &self,
        viewpoint: ViewpointIndex,
        cameras: &[(ViewpointIndex, CameraModel)],
        points_m: &[Vector3<f64>],
    ) -> bool {
        let mut in_view = false;
        let own = cameras.iter().enumerate().filter(|(index, camera)| {
            camera.0 == viewpoint && self.detected.get(*index).copied().unwrap_or(false)
        });
        for (index, (_, model)) in own {
            let pixels = in_sight(model, points_m);
            if pixels.is_empty() {
                continue;
            }
            in_view = true;
            let covers = |outline: &BodyOutline| {
                let inside = pixels
                    .iter()
                    .filter(|pixel| outline.contains(pixel))
                    .count();
                inside as f64 >= HIDDEN_SHARE * points_m.len() as f64
            };
            if self.outlines[index].iter().any(covers) {
                return false;
            }
        }
        in_view
    }
}

/// The pixels of `points_m` in `model`; empty unless the body is well in the image.
pub(crate) fn in_sight(model: &CameraModel, points_m: &[Vector3<f64>]) -> Vec<Pixel<Undistorted>> {
    let mut pixels: Vec<Pixel<Undistorted>> = points_m
        .iter()
        .filter_map(|&p| model.project(Point::new(p.into())))
        .collect();
    let seen = pixels.iter().filter(|&&pixel| model.sees(pixel)).count();
    if (seen as f64) < SEEN_SHARE * points_m.len() as f64 {
        pixels.clear();
    }
    pixels
}

/// The upright rectangle of a sighted body in an image, undistorted pixels.
#[derive(Debug, Clone)]
struct BodyOutline {
    low: Vector2<f64>,
    high: Vector2<f64>,
}

impl BodyOutline {
    fn around(witness: &SightedBody) -> Option<Self> {
        let mut pixels = witness
            .rays
            .iter()
            .flatten()
            .map(|ray| ray.pixel.vector_px());
        let first = pixels.next()?;
        let (low, high) = pixels.fold((first, first), |(low, high), p| (low.inf(&p), high.sup(&p)));
        let growth = (high - low) * OUTLINE_GROWTH;
        Some(Self {
            low: low - growth,
            high: high + growth,
        })
    }

    fn contains(&self, pixel: &Pixel<Undistorted>) -> bool {
        let p = pixel.vector_px();
        p >= self.low && p <= self.high
    }
}
