//! The best result of a user of Pose2Sim from the same maps: true association, subcell peaks, weighted DLT without outlying
//! views, zero-phase Butterworth.
//!
//! Its joints are its keypoints, because it has no body. It has every advantage: the person of every crop is known from the
//! truth, gaps are interpolated, and the filter uses the future. It has no heels and toes, so its foot slide is that of the
//! ankles.

pub mod butterworth;
pub mod outliers;

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use farfield_fusion::estimate::triangulate::Observation;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::tick::Tick;
use farfield_score::points::{PointSet, ScoredBody};
use nalgebra::{Matrix3x4, Vector3};

use crate::suite::baseline::butterworth::ZeroPhase;
use crate::suite::baseline::outliers::{Thresholds, triangulate};
use crate::view_peaks::ViewPeak;

/// The cutoffs, of which the best one counts, hertz.
pub const CUTOFFS_HZ: [f64; 4] = [4.0, 6.0, 8.0, 10.0];

/// Peaks of one person in one camera at one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct PersonView {
    /// Index of the camera in the venue.
    pub camera: usize,
    /// The best peak of each keypoint.
    pub peaks: Vec<Option<ViewPeak>>,
}

/// The keypoints of one person over time, world metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory {
    first: Tick,
    /// Per keypoint, per tick from the first on.
    points_m: Vec<Vec<Option<Vector3<f64>>>>,
}

impl Trajectory {
    /// Triangulates every keypoint at each of `ticks`. `views` has the peaks of the person by tick; `pixel_from_world` the
    /// projection matrix of each camera.
    pub fn triangulated(
        ticks: RangeInclusive<Tick>,
        n_keypoints: usize,
        views: &BTreeMap<Tick, Vec<PersonView>>,
        pixel_from_world: &[Matrix3x4<f64>],
        thresholds: &Thresholds,
    ) -> Self {
        let first = *ticks.start();
        let n_ticks = (*ticks.end() - first + 1).max(0);
        let mut points_m = vec![Vec::with_capacity(n_ticks as usize); n_keypoints];
        let mut seen = Vec::new();
        for step in 0..n_ticks {
            let at_tick = views.get(&(first + step)).map_or(&[][..], Vec::as_slice);
            for (keypoint, points) in points_m.iter_mut().enumerate() {
                seen.clear();
                seen.extend(at_tick.iter().filter_map(|view| {
                    let peak = (*view.peaks.get(keypoint)?)?;
                    Some(Observation {
                        pixel_from_world: *pixel_from_world.get(view.camera)?,
                        pixel: peak.pixel,
                        weight: f64::from(peak.height),
                    })
                }));
                points.push(triangulate(&seen, thresholds));
            }
        }
        Self { first, points_m }
    }

    /// The point of `keypoint` at `tick`.
    pub fn at(&self, keypoint: usize, tick: Tick) -> Option<Vector3<f64>> {
        let index = usize::try_from(tick - self.first).ok()?;
        *self.points_m.get(keypoint)?.get(index)?
    }

    /// Fills the gaps (linear between the neighbours, the nearest point at the ends) and filters. A keypoint without any point
    /// stays unknown.
    #[must_use]
    pub fn filtered(&self, filter: &ZeroPhase) -> Self {
        let filter_points = |points: &Vec<Option<Vector3<f64>>>| {
            let Some(filled) = without_gaps(points) else {
                return points.clone();
            };
            let axes = [0, 1, 2].map(|axis| {
                let values: Vec<f64> = filled.iter().map(|p| p[axis]).collect();
                filter.filter(&values)
            });
            let point = |i: usize| Some(Vector3::new(axes[0][i], axes[1][i], axes[2][i]));
            (0..filled.len()).map(point).collect()
        };
        Self {
            first: self.first,
            points_m: self.points_m.iter().map(filter_points).collect(),
        }
    }

    /// The body at `tick` for scoring; `None` without any point.
    pub fn body(&self, tick: Tick, keypoints: &KeypointSet) -> Option<ScoredBody> {
        let point = |name: &str| self.at(keypoints.index_of(name)?, tick);
        let mut body = ScoredBody::gather(PointSet::Joints, point, |_| None);
        body.set_sites(point);
        body.points_m.iter().any(Option::is_some).then_some(body)
    }
}

/// The points with every gap filled; `None` without any point.
fn without_gaps(points: &[Option<Vector3<f64>>]) -> Option<Vec<Vector3<f64>>> {
    let known: Vec<(usize, Vector3<f64>)> = points
        .iter()
        .enumerate()
        .filter_map(|(i, p)| Some((i, (*p)?)))
        .collect();
    let (&first, &last) = (known.first()?, known.last()?);
    let mut after = 0;
    let fill = |index: usize| {
        while after < known.len() && known[after].0 < index {
            after += 1;
        }
        match (after.checked_sub(1).map(|i| known[i]), known.get(after)) {
            (_, Some(&(at, point))) if at == index => point,
            (Some((i, a)), Some(&(j, b))) => a.lerp(&b, (index - i) as f64 / (j - i) as f64),
            (None, _) => first.1,
            (_, None) => last.1,
        }
    };
    Some((0..points.len()).map(fill).collect())
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::CameraModel;
    use farfield_proto::frames::Point;
    use nalgebra::Point3;

    use super::*;
    use crate::ring::CameraRing;

    /// Error from exact peaks: rounding, and the filter's damping of a slow circle (below 0.1 mm).
    const CLEAN_M: f64 = 1e-4;
    const RATE_HZ: f64 = 60.0;
    const N_TICKS: i64 = 180;

    /// Walks a slow circle.
    fn truth(tick: Tick) -> Vector3<f64> {
        let angle = 0.5 * tick.0 as f64 / RATE_HZ;
        Vector3::new(angle.cos(), angle.sin(), 1.0)
    }

    fn seen(camera: &CameraModel, index: usize, tick: Tick) -> PersonView {
        let pixel = camera
            .project(Point::new(Point3::from(truth(tick))))
            .unwrap();
        let height = 0.9;
        PersonView {
            camera: index,
            peaks: vec![Some(ViewPeak { pixel, height }); 17],
        }
    }

    fn trajectory(hidden: impl Fn(Tick) -> bool) -> Trajectory {
        let ring = CameraRing::new(4).unwrap();
        let ticks = (0..N_TICKS).map(Tick).filter(|&t| !hidden(t));
        let views = ticks.map(|tick| {
            let cameras = ring.cameras().iter().enumerate();
            (tick, cameras.map(|(i, c)| seen(c, i, tick)).collect())
        });
        let matrices: Vec<_> = ring
            .cameras()
            .iter()
            .map(CameraModel::projection_matrix)
            .collect();
        Trajectory::triangulated(
            Tick(0)..=Tick(N_TICKS - 1),
            17,
            &views.collect(),
            &matrices,
            &Thresholds::default(),
        )
    }

    fn check(trajectory: &Trajectory, ticks: impl Iterator<Item = i64>, within_m: f64) {
        for tick in ticks.map(Tick) {
            let body = trajectory.body(tick, &KeypointSet::coco17()).unwrap();
            for point in body.points_m[..12].iter().chain(&body.sites_m) {
                let error_m = (point.unwrap() - truth(tick)).norm();
                assert!(error_m < within_m, "{tick}: {error_m} m");
            }
        }
    }

    #[test]
    fn a_clean_scene_has_no_error() {
        check(&trajectory(|_| false), 0..N_TICKS, 1e-6);
    }

    #[test]
    fn the_filter_leaves_slow_motion_as_it_is() {
        for cutoff_hz in CUTOFFS_HZ {
            let filtered = trajectory(|_| false).filtered(&ZeroPhase::new(cutoff_hz, RATE_HZ));
            // The extension loses a little at the ends.
            check(&filtered, 30..N_TICKS - 30, CLEAN_M);
        }
    }

    #[test]
    fn gaps_are_bridged_and_ends_are_held() {
        let hidden = |tick: Tick| tick.0 < 5 || (60..80).contains(&tick.0);
        let raw = trajectory(hidden);
        assert_eq!(raw.at(0, Tick(65)), None);
        assert!(raw.body(Tick(65), &KeypointSet::coco17()).is_none());
        let filled = raw.filtered(&ZeroPhase::new(10.0, RATE_HZ));
        // The chord of 20 ticks of the circle is less than 4 mm inside it.
        check(&filled, 55..85, 0.004);
        assert!((filled.at(0, Tick(0)).unwrap() - truth(Tick(5))).norm() < 0.01);
    }
}
