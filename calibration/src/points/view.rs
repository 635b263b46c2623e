//! The undistorted sights of each camera.

use std::collections::BTreeMap;

use farfield_proto::camera::{CameraError, CameraModel};
use farfield_proto::frames::Transform;
use farfield_proto::order_statistics::upper_median;
use nalgebra::{Isometry3, Vector3};

use super::request::{CalibrationError, PointCamera};
use crate::adjustment::CameraState;

/// Number of neighbours on either side with which a sighting is compared.
const NEIGHBOURS: usize = 2;
/// Distance from the prediction by its neighbours above which a sighting is an outlier: this many pixels, and this many times
/// the usual distance.
const OUTLIER_PX: f64 = 4.0;
const OUTLIER_TIMES: f64 = 8.0;

/// One sight of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    pub(super) frame: f64,
    pub(super) px: [f64; 2],
    /// Unit vector, camera axes.
    pub(super) bearing: Vector3<f64>,
}

/// One camera and all its sights in the order of its frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Track {
    pub(super) state: CameraState,
    pub(super) seen: Vec<Seen>,
}

/// One camera and its sights by tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct View {
    pub(super) state: CameraState,
    pub(super) seen: BTreeMap<usize, Seen>,
}

impl Track {
    /// Leaves out sights outside the range of the lens or far outside the picture.
    pub(super) fn new(camera: &PointCamera) -> Result<Self, CalibrationError> {
        check_lens(camera)?;
        let mut state = CameraState::at_origin(camera.intrinsics, camera.lens);
        let fold_radius = state.fold_radius();
        let is_outside = |px: [f64; 2]| {
            (0..2).any(|axis| {
                let size = f64::from(camera.size_px[axis]);
                px[axis] < -0.02 * size || px[axis] > 1.02 * size
            })
        };
        let outside = camera.sightings.iter().filter(|s| is_outside(s.px)).count();
        if 5 * outside > camera.sightings.len() {
            return Err(CalibrationError::OutsidePicture {
                camera: camera.name.clone(),
                outside,
                of: camera.sightings.len(),
                size_px: camera.size_px,
            });
        }
        let inside = camera.sightings.iter().filter(|s| !is_outside(s.px));
        let seen = inside.filter_map(|s| {
            Some(Seen {
                frame: s.frame,
                px: s.px,
                bearing: state.bearing(s.px, fold_radius)?,
            })
        });
        let seen: Vec<Seen> = seen.collect();
        state.pivot_frame = seen.get(seen.len() / 2).map_or(0.0, |s| s.frame);
        Ok(Self { state, seen })
    }

    /// Focal length, pixels: the number of pixels per radian at the axis.
    pub(super) fn focal_px(&self) -> f64 {
        focal_px(&self.state)
    }

    /// The sights by whole frame number.
    pub(super) fn by_frame(&self) -> View {
        let seen = self.seen.iter();
        View {
            state: self.state,
            seen: seen.map(|s| (s.frame.round() as usize, *s)).collect(),
        }
    }

    /// Leaves out the sights that are far from the prediction by their neighbours. Interpolation needs this, because one outlier
    /// spoils two intervals.
    pub(super) fn without_outliers(&self) -> Self {
        let distances: Vec<f64> = (0..self.seen.len())
            .map(|i| self.unevenness_px(i))
            .collect();
        let usual = upper_median(distances.clone()).unwrap_or(0.0);
        let limit = OUTLIER_PX.max(OUTLIER_TIMES * usual);
        let kept = self.seen.iter().zip(distances).filter(|(_, d)| *d < limit);
        Self {
            state: self.state,
            seen: kept.map(|(s, _)| *s).collect(),
        }
    }

    /// Median distance of a sight from the straight lines through pairs of its neighbours.
    fn unevenness_px(&self, index: usize) -> f64 {
        let from = index.saturating_sub(NEIGHBOURS);
        let to = (index + NEIGHBOURS + 1).min(self.seen.len());
        let Some(own) = self.seen.get(index) else {
            return 0.0;
        };
        let mut distances = Vec::new();
        for a in from..to {
            for b in a + 1..to {
                if a == index || b == index {
                    continue;
                }
                let (a, b) = (&self.seen[a], &self.seen[b]);
                let share = (own.frame - a.frame) / (b.frame - a.frame);
                let off =
                    |axis: usize| a.px[axis] + share * (b.px[axis] - a.px[axis]) - own.px[axis];
                distances.push(libm::hypot(off(0), off(1)));
            }
        }
        upper_median(distances).unwrap_or(0.0)
    }

    /// The bearing and pixel at `frame`, interpolated between its neighbours if these are at most `most_gap` frames apart.
    pub(super) fn at(&self, frame: f64, most_gap: f64) -> Option<Seen> {
        let after = self.seen.partition_point(|s| s.frame < frame);
        let b = self.seen.get(after)?;
        if b.frame - frame < 1e-9 {
            return Some(*b);
        }
        let a = self.seen.get(after.checked_sub(1)?)?;
        if b.frame - a.frame > most_gap {
            return None;
        }
        let share = (frame - a.frame) / (b.frame - a.frame);
        let between = |x: f64, y: f64| x + share * (y - x);
        Some(Seen {
            frame,
            px: [between(a.px[0], b.px[0]), between(a.px[1], b.px[1])],
            bearing: (a.bearing + (b.bearing - a.bearing) * share).normalize(),
        })
    }
}

impl View {
    pub(super) fn focal_px(&self) -> f64 {
        focal_px(&self.state)
    }
}

/// Refuses invalid numbers, but not a lens that folds in a corner of its picture: the point may never be there.
fn check_lens(camera: &PointCamera) -> Result<(), CalibrationError> {
    let model = CameraModel::new(
        &camera.name,
        camera.size_px,
        camera.intrinsics,
        camera.lens,
        Transform::new(Isometry3::identity()),
    );
    match model {
        Ok(_) | Err(CameraError::Folds { .. }) => Ok(()),
        Err(error) => Err(CalibrationError::Camera(error)),
    }
}

fn focal_px(state: &CameraState) -> f64 {
    (state.intrinsics.fx_px * state.intrinsics.fy_px).sqrt()
}
