//! Our skeletons against plain weighted triangulation without a truth: both use the same views, and both are compared with
//! the peaks of a view that was withheld.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context as _;
use farfield_edge::pipeline::EdgeOutput;
use farfield_fusion::estimate::triangulate::{Observation, weighted_dlt};
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_proto::id::PersonId;
use farfield_proto::keypoints::{COCO17, KeypointSet};
use farfield_proto::message::PersonPose;
use farfield_proto::order_statistics::upper_median;
use farfield_proto::patch::CompressionLevel;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use nalgebra::{Vector2, Vector3};

use crate::in_process::{InProcess, Onlooker};
use crate::view_peaks::{PeakReader, ViewPeak};

/// The 12 keypoints below the head, by their COCO names: those after the five of the face.
const BODY_KEYPOINTS: &[&str] = COCO17.split_at(5).1;

/// Least height of a peak, for triangulation and for the comparison.
const MIN_PEAK: f32 = 0.4;

/// Least share of a person's keypoints inside a picture for a comparison in it.
const MIN_SHARE_INSIDE: f64 = 0.7;

/// Best peak of each keypoint, by viewpoint.
type PersonPeaks = Vec<Vec<Option<ViewPeak>>>;

/// A person at one tick.
struct PersonFrame {
    /// World, metres, in the order of the network's keypoints.
    keypoints_m: Vec<Vector3<f64>>,
    views: u16,
    peaks: PersonPeaks,
}

/// The distance of one keypoint from a view's peak.
#[derive(Debug, Clone, Copy)]
pub struct Residual {
    /// The tick of the pose.
    pub tick: Tick,
    /// Whose keypoint.
    pub person: PersonId,
    /// Its name.
    pub keypoint: &'static str,
    /// Distance of our keypoint, pixels.
    pub ours_px: f64,
    /// Distance of the triangulated keypoint, pixels; `None` if fewer than two views show a peak.
    pub triangulated_px: Option<f64>,
    /// The larger side of the person's keypoints in this view, pixels.
    pub height_px: f64,
}

/// The venue at `path` without the viewpoint of that index, and the venue with only that viewpoint.
///
/// # Errors
/// The file cannot be read, or it has no such viewpoint or only one.
pub fn split_venue(path: &Path, viewpoint: usize) -> anyhow::Result<[Venue; 2]> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let with_viewpoints = |is_kept: &dyn Fn(usize) -> bool| -> anyhow::Result<Venue> {
        let mut table: toml::Table = text.parse()?;
        let viewpoints = table
            .get_mut("viewpoint")
            .and_then(toml::Value::as_array_mut);
        let viewpoints = viewpoints.context("a venue without viewpoints")?;
        let mut index = 0..;
        viewpoints.retain(|_| index.next().is_some_and(is_kept));
        Ok(farfield_node::files::parse_venue(&table.to_string(), path)?)
    };
    Ok([
        with_viewpoints(&|index| index != viewpoint)?,
        with_viewpoints(&|index| index == viewpoint)?,
    ])
}

/// A run through a venue, with the poses of all people and the peaks of every view.
pub struct ViewsRun {
    /// Those of the run, then that of the onlooker.
    cameras: Vec<CameraModel>,
    /// The number of views in the run.
    n_used: usize,
    keypoints: KeypointSet,
    rate_hz: f64,
    frames: BTreeMap<(Tick, PersonId), PersonFrame>,
    /// Messages of maps from the edges: people and bytes.
    sent: [usize; 2],
}

impl ViewsRun {
    /// Runs all ticks of `run`, in which every viewpoint has one camera. The `onlooker` is the last view.
    ///
    /// # Errors
    /// The run fails.
    pub fn make(mut run: InProcess, mut onlooker: Option<Onlooker>) -> anyhow::Result<Self> {
        let mut reader = PeakReader::default();
        let (mut peaks, mut finished) = (BTreeMap::new(), Vec::new());
        let cameras = run
            .venue()
            .cameras
            .iter()
            .map(|camera| camera.model.clone());
        let mut cameras: Vec<CameraModel> = cameras.collect();
        let n_used = cameras.len();
        cameras.extend(onlooker.as_ref().map(|it| it.camera().clone()));
        let mut sent = [0; 2];
        while let Some(mut trace) = run.step()? {
            for set in trace.edges.iter().flat_map(|edge| &edge.patch_sets) {
                sent[0] += set.persons.len();
                sent[1] += farfield_proto::wire::encode(set).len();
            }
            if let Some(onlooker) = &mut onlooker {
                trace.edges.push(onlooker.look(&trace.poses)?);
            }
            finished.extend(trace.finished);
            for (view, edge) in trace.edges.iter().enumerate() {
                for (person, found) in peaks_of(edge, &mut reader) {
                    let all: &mut PersonPeaks = peaks.entry((trace.tick, person)).or_default();
                    all.resize(cameras.len(), Vec::new());
                    all[view] = found;
                }
            }
        }
        finished.extend(run.finish());
        let poses = finished.iter().flat_map(|set| {
            set.persons
                .iter()
                .map(|pose| ((set.tick, pose.person), pose))
        });
        let frames = poses.map(|(key, pose)| {
            let frame = PersonFrame {
                keypoints_m: keypoints_m(pose),
                views: pose.views,
                peaks: peaks.remove(&key).unwrap_or_default(),
            };
            (key, frame)
        });
        Ok(Self {
            frames: frames.collect(),
            cameras,
            n_used,
            keypoints: run.keypoints().clone(),
            rate_hz: run.venue().rate_hz,
            sent,
        })
    }

    /// Runs the venue at `path` without the viewpoint `withheld`, which looks on; with `still_ticks` each camera shows its
    /// first frame at so many ticks. The edges compress maps by `level`; the view that looks on is exact.
    ///
    /// # Errors
    /// The venue is refused, or the run fails.
    pub fn without(
        path: &Path,
        withheld: usize,
        still_ticks: Option<i64>,
        level: CompressionLevel,
    ) -> anyhow::Result<Self> {
        let [used, withheld] = split_venue(path, withheld)?;
        let (mut run, mut onlooker) = (InProcess::open_venue(used)?, Onlooker::open(&withheld)?);
        run.set_compression_level(level);
        if let Some(n_ticks) = still_ticks {
            run.hold_still(n_ticks)?;
            onlooker.hold_still()?;
        }
        Self::make(run, Some(onlooker))
    }

    /// People, summed over views and ticks, and the bytes of the messages with their maps.
    pub fn sent(&self) -> [usize; 2] {
        self.sent
    }

    /// The view of the onlooker.
    pub fn withheld_view(&self) -> usize {
        self.n_used
    }

    /// The person with the most views, summed over ticks; `None` if no person was found.
    pub fn most_seen(&self) -> Option<PersonId> {
        let mut views: BTreeMap<PersonId, u32> = BTreeMap::new();
        for ((_, person), frame) in &self.frames {
            *views.entry(*person).or_default() += u32::from(frame.views);
        }
        let most = views.into_iter().max_by_key(|(_, n)| *n);
        most.map(|(person, _)| person)
    }

    /// The number of people at `tick`.
    pub fn people_at(&self, tick: Tick) -> usize {
        self.frames.keys().filter(|(at, _)| *at == tick).count()
    }

    /// Distances from the peaks of `view`, of our keypoints and of triangulation from the views that were not withheld. `of`
    /// chooses ticks and people.
    pub fn residuals(&self, view: usize, of: impl Fn(Tick, PersonId) -> bool) -> Vec<Residual> {
        let mut residuals = Vec::new();
        for (&(tick, person), frame) in &self.frames {
            if of(tick, person)
                && let Some(seen) = self.seen_in(view, frame)
            {
                residuals.extend(BODY_KEYPOINTS.iter().filter_map(|&keypoint| {
                    let index = self.keypoints.index_of(keypoint)?;
                    let at_px = seen.at_px[index]?;
                    let peak_px = frame.peak(view, index)?.pixel.vector_px();
                    let triangulated = self.triangulated_m(frame, index);
                    let triangulated = triangulated.and_then(|at_m| self.project(view, at_m));
                    Some(Residual {
                        tick,
                        person,
                        keypoint,
                        ours_px: (at_px - peak_px).norm(),
                        triangulated_px: triangulated.map(|at_px| (at_px - peak_px).norm()),
                        height_px: seen.height_px,
                    })
                }));
            }
        }
        residuals
    }

    /// Mean norm of the third difference of `person`'s keypoints over dt cubed, m/s3: ours and triangulation's, over runs of
    /// four ticks in which triangulation has the keypoint.
    pub fn jerk_m_s3(&self, person: PersonId, names: &[&str]) -> (f64, f64) {
        let dt3 = self.rate_hz.powi(-3);
        let (mut ours, mut dlt) = (Vec::new(), Vec::new());
        let frame = |tick: Tick| self.frames.get(&(tick, person));
        for k in names.iter().filter_map(|n| self.keypoints.index_of(n)) {
            for (tick, _) in self.frames.keys().filter(|(_, of)| *of == person) {
                let window = |of: &dyn Fn(Tick) -> Option<Vector3<f64>>| -> Option<f64> {
                    let [a, b, c, d] = [0, 1, 2, 3].map(|n| of(*tick + n));
                    Some((d? - c? * 3.0 + b? * 3.0 - a?).norm() / dt3)
                };
                let our = window(&|t| frame(t).map(|f| f.keypoints_m[k]));
                let their = window(&|t| self.triangulated_m(frame(t)?, k));
                if let (Some(our), Some(their)) = (our, their) {
                    ours.push(our);
                    dlt.push(their);
                }
            }
        }
        let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
        (mean(&ours), mean(&dlt))
    }

    /// The keypoints inside the picture of `view`; `None` if most are outside.
    fn seen_in(&self, view: usize, frame: &PersonFrame) -> Option<SeenPerson> {
        let all_px: Vec<Vector2<f64>> = frame
            .keypoints_m
            .iter()
            .map(|at_m| self.project(view, *at_m))
            .collect::<Option<_>>()?;
        let size_px = self.cameras[view].size_px().map(f64::from);
        let is_inside =
            |at_px: &Vector2<f64>| (0..2).all(|i| at_px[i] > 0.0 && at_px[i] < size_px[i]);
        let coco = COCO17
            .iter()
            .filter_map(|name| self.keypoints.index_of(name));
        let coco_px: Vec<Vector2<f64>> = coco.map(|index| all_px[index]).collect();
        let n_inside = coco_px.iter().filter(|at_px| is_inside(at_px)).count();
        let lowest_px = coco_px.iter().copied().reduce(|a, b| a.inf(&b))?;
        let highest_px = coco_px.iter().copied().reduce(|a, b| a.sup(&b))?;
        let at_px = all_px.into_iter().map(|it| is_inside(&it).then_some(it));
        let seen = SeenPerson {
            at_px: at_px.collect(),
            height_px: (highest_px - lowest_px).max(),
        };
        (n_inside as f64 >= MIN_SHARE_INSIDE * coco_px.len() as f64).then_some(seen)
    }

    fn project(&self, view: usize, at_m: Vector3<f64>) -> Option<Vector2<f64>> {
        let pixel = self.cameras[view].project(Point::new(at_m.into()));
        pixel.map(|pixel| pixel.vector_px())
    }

    fn triangulated_m(&self, frame: &PersonFrame, keypoint: usize) -> Option<Vector3<f64>> {
        let seen: Vec<Observation> = (0..self.n_used)
            .filter_map(|view| {
                let peak = frame.peak(view, keypoint)?;
                let pixel_from_world = self.cameras[view].projection_matrix();
                Some(Observation {
                    pixel_from_world,
                    pixel: peak.pixel,
                    weight: f64::from(peak.height),
                })
            })
            .collect();
        let point = weighted_dlt(&seen).ok()?;
        Some(point.coordinates_m().coords)
    }
}

/// A person in one view.
struct SeenPerson {
    /// The keypoints inside the picture, pixels.
    at_px: Vec<Option<Vector2<f64>>>,
    height_px: f64,
}

impl PersonFrame {
    fn peak(&self, view: usize, keypoint: usize) -> Option<ViewPeak> {
        let peak = (*self.peaks.get(view)?.get(keypoint)?)?;
        (peak.height >= MIN_PEAK).then_some(peak)
    }
}

fn peaks_of(
    edge: &EdgeOutput,
    reader: &mut PeakReader,
) -> impl Iterator<Item = (PersonId, Vec<Option<ViewPeak>>)> {
    let patches = edge.patch_sets.iter().flat_map(|set| &set.persons);
    patches.map(|patch| (patch.person, reader.read(patch)))
}

fn keypoints_m(pose: &PersonPose) -> Vec<Vector3<f64>> {
    let points = pose.keypoints_m.iter();
    points.map(|p| Vector3::from(p.map(f64::from))).collect()
}

/// The upper median; NaN for an empty slice.
pub fn median(values: &[f64]) -> f64 {
    upper_median(values.to_vec()).unwrap_or(f64::NAN)
}
