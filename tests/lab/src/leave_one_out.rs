//! Our skeleton against plain weighted triangulation without a truth: both use the same views, and both are compared with the
//! peaks of a view that was withheld.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context as _;
use farfield_fusion::estimate::triangulate::{Observation, weighted_dlt};
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_proto::id::{PersonId, ViewpointIndex};
use farfield_proto::keypoints::{COCO17, KeypointSet};
use farfield_proto::message::PoseSet;
use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;
use nalgebra::{Point3, Vector3};

use crate::in_process::InProcess;
use crate::view_peaks::{PeakReader, ViewPeak};

/// The 12 keypoints below the head, by their COCO names: those after the five of the face.
pub const BODY_KEYPOINTS: &[&str] = COCO17.split_at(5).1;

/// Least height of a peak, for triangulation and for the comparison.
const MIN_PEAK: f32 = 0.3;

/// Peaks of one tick: per viewpoint and keypoint.
type TickPeaks = Vec<Vec<Option<ViewPeak>>>;

/// One person's run through a venue, with the peaks of every view.
pub struct PersonRun {
    cameras: Vec<CameraModel>,
    keypoints: KeypointSet,
    rate_hz: f64,
    withheld: Option<usize>,
    person: PersonId,
    peaks: BTreeMap<Tick, TickPeaks>,
    poses_m: BTreeMap<Tick, Vec<Vector3<f64>>>,
}

impl PersonRun {
    /// Runs the venue at `path`, without the viewpoint `withheld`. Every viewpoint has one camera.
    ///
    /// # Errors
    /// The run fails, or no person is found.
    pub fn make(path: &Path, withheld: Option<usize>) -> anyhow::Result<Self> {
        let mut run = InProcess::open(path, withheld.map(|v| ViewpointIndex(v as u16)))?;
        let (mut patches, mut finished) = (Vec::new(), Vec::new());
        while let Some(trace) = run.step()? {
            finished.extend(trace.finished);
            patches.push((trace.tick, trace.edges));
        }
        finished.extend(run.finish());
        let person = most_seen(&finished).context("no person was found")?;
        let cameras: Vec<CameraModel> = run
            .venue()
            .cameras
            .iter()
            .map(|c| c.model.clone())
            .collect();
        let mut reader = PeakReader::default();
        let peaks = patches
            .iter()
            .map(|(tick, edges)| {
                let of_view = |edge: &farfield_edge::pipeline::EdgeOutput| {
                    let patch = edge
                        .patch_sets
                        .iter()
                        .flat_map(|s| &s.persons)
                        .find(|p| p.person == person);
                    patch.map_or_else(Vec::new, |patch| reader.read(patch))
                };
                (*tick, edges.iter().map(of_view).collect())
            })
            .collect();
        let poses_m = finished
            .iter()
            .filter_map(|set| Some((set.tick, keypoints_m(set, person)?)))
            .collect();
        let (keypoints, rate_hz) = (run.keypoints().clone(), run.venue().rate_hz);
        Ok(Self {
            cameras,
            keypoints,
            rate_hz,
            withheld,
            person,
            peaks,
            poses_m,
        })
    }

    /// The tracked person.
    pub fn person(&self) -> PersonId {
        self.person
    }

    /// Distances in pixels to the peaks of `view`: of our keypoints, and of triangulation from the views that were not withheld,
    /// at the same ticks and keypoints.
    pub fn residuals_px(&self, view: usize, names: &[&str]) -> (Vec<f64>, Vec<f64>) {
        let (mut ours, mut dlt) = (Vec::new(), Vec::new());
        for (tick, keypoints) in &self.poses_m {
            for k in names.iter().filter_map(|n| self.keypoints.index_of(n)) {
                let peak = self.peak(*tick, view, k).map(|p| p.pixel.vector_px());
                let triangulated = self.triangulated(*tick, k);
                let (Some(peak), Some(triangulated)) = (peak, triangulated) else {
                    continue;
                };
                let project = |p: Vector3<f64>| {
                    self.cameras[view]
                        .project(Point::new(p.into()))
                        .map(|p| p.vector_px())
                };
                let (Some(a), Some(b)) = (project(keypoints[k]), project(triangulated)) else {
                    continue;
                };
                ours.push((a - peak).norm());
                dlt.push((b - peak).norm());
            }
        }
        (ours, dlt)
    }

    /// Mean norm of the third difference over dt cubed, m/s3: ours and triangulation's, over runs of four ticks in which
    /// triangulation has the keypoint.
    pub fn jerk_m_s3(&self, names: &[&str]) -> (f64, f64) {
        let dt3 = self.rate_hz.powi(-3);
        let (mut ours, mut dlt) = (Vec::new(), Vec::new());
        for k in names.iter().filter_map(|n| self.keypoints.index_of(n)) {
            for tick in self.poses_m.keys() {
                let window = |of: &dyn Fn(Tick) -> Option<Vector3<f64>>| -> Option<f64> {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|n| of(*tick + n));
                    Some((d? - c? * 3.0 + b? * 3.0 - a?).norm() / dt3)
                };
                let our = window(&|t| self.poses_m.get(&t).map(|p| p[k]));
                let their = window(&|t| self.triangulated(t, k));
                if let (Some(our), Some(their)) = (our, their) {
                    ours.push(our);
                    dlt.push(their);
                }
            }
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        (mean(&ours), mean(&dlt))
    }

    fn peak(&self, tick: Tick, view: usize, keypoint: usize) -> Option<ViewPeak> {
        let peak = (*self.peaks.get(&tick)?.get(view)?.get(keypoint)?)?;
        (peak.height >= MIN_PEAK).then_some(peak)
    }

    fn triangulated(&self, tick: Tick, keypoint: usize) -> Option<Vector3<f64>> {
        let views = (0..self.cameras.len()).filter(|v| self.withheld != Some(*v));
        let seen: Vec<Observation> = views
            .filter_map(|v| {
                let peak = self.peak(tick, v, keypoint)?;
                let pixel_from_world = self.cameras[v].projection_matrix();
                Some(Observation {
                    pixel_from_world,
                    pixel: peak.pixel,
                    weight: f64::from(peak.height),
                })
            })
            .collect();
        weighted_dlt(&seen).ok().map(|p| p.coordinates_m().coords)
    }
}

/// The person with the most views, summed over ticks.
fn most_seen(finished: &[PoseSet]) -> Option<PersonId> {
    let mut views: BTreeMap<PersonId, u32> = BTreeMap::new();
    for pose in finished.iter().flat_map(|set| &set.persons) {
        *views.entry(pose.person).or_default() += u32::from(pose.views);
    }
    views
        .into_iter()
        .max_by_key(|(_, n)| *n)
        .map(|(person, _)| person)
}

fn keypoints_m(set: &PoseSet, person: PersonId) -> Option<Vec<Vector3<f64>>> {
    let pose = set.persons.iter().find(|p| p.person == person)?;
    Some(
        pose.keypoints_m
            .iter()
            .map(|p| Point3::from(p.map(f64::from)).coords)
            .collect(),
    )
}

/// The upper median; NaN for an empty slice.
pub fn median(values: &[f64]) -> f64 {
    upper_median(values.to_vec()).unwrap_or(f64::NAN)
}
