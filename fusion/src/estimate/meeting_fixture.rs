//! People in the views of the hall, with maps drawn peak by peak, for tests of peak ownership.

use std::collections::BTreeMap;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_proto::grid::CellGrid;
use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PersonPatch;
use farfield_proto::patch::{CompressionLevel, Encoder, Maps, quantize};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Parameters;
use nalgebra::{UnitQuaternion, Vector2, Vector3};

use super::estimator::Estimator;
use crate::body::ik::relative_sigmas;
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::{Pose, Proportions, Skeleton, sites_of};
use crate::boxes::BoxShape;
use crate::estimate::evidence::View;
use crate::estimate::occlusion::BodyCapsules;
use crate::method::Method;
use crate::sightings::fixture::{TestHall, hall};

pub(crate) const LEFT_ELBOW: usize = 7;
pub(crate) const LEFT_WRIST: usize = 9;
pub(crate) const RIGHT_WRIST: usize = 10;
const SIGMA_CELLS: f64 = 2.0;
const STATURE_M: f64 = 1.75;

/// A peak to draw: keypoint, where (world, metres), height.
pub(crate) type Drawn = (usize, Vector3<f64>, f64);

/// People in the hall of [`crate::sightings::fixture`].
pub(crate) struct MeetingFixture {
    pub(crate) hall: TestHall,
    pub(crate) method: Method,
    pub(crate) tracks: Vec<Estimator>,
}

impl MeetingFixture {
    /// People who stand upright at these places (x, y, heading), well seen until now.
    pub(crate) fn at(places: &[[f64; 3]]) -> Self {
        let (keypoints, parameters) = (KeypointSet::coco17(), Parameters::default());
        let method = Method {
            dt_s: 1.0 / 60.0,
            sites: sites_of(&keypoints, &BTreeMap::new()),
            relative_sigmas: relative_sigmas(&keypoints, &BTreeMap::new()),
            map_size: None,
            floor_m: 0.0,
            peak_sigma_of_width: farfield_proto::model_card::PEAK_SIGMA_OF_WIDTH,
            range_of_motion: None,
            box_shape: BoxShape {
                margin: 1.25,
                reach_m: 0.0,
                parameters: parameters.boxes.clone(),
            },
            keypoints,
            parameters,
        };
        let tracks = places.iter().map(|&[x, y, heading]| {
            let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading);
            let pose = Pose::neutral(Vector3::new(x, y, 0.53 * STATURE_M), turned);
            let skeleton = Skeleton::new(&Proportions::from_stature(STATURE_M));
            let mut track = Estimator::new(skeleton, pose, &method);
            // As after a tick in which all keypoints were seen.
            let seen = KeypointEstimate {
                views: 4,
                weight: 0.9,
                ..KeypointEstimate::unsupported(Vector3::zeros(), 0.9)
            };
            track.evidence.estimates = vec![seen; method.sites.len()];
            track
        });
        Self {
            hall: hall(),
            tracks: tracks.collect(),
            method,
        }
    }

    /// Every keypoint of a person at its place, at full height.
    pub(crate) fn true_peaks(&self, person: usize) -> Vec<Drawn> {
        let points = self.tracks[person].keypoints_m().into_iter();
        points.enumerate().map(|(k, p)| (k, p, 0.9)).collect()
    }

    /// Begins a tick without views.
    pub(crate) fn begin(&mut self) {
        for track in &mut self.tracks {
            track.begin(&self.method);
        }
    }

    /// Adds a view of `person` from `camera` of the hall, with these peaks.
    pub(crate) fn show(&mut self, person: usize, camera: usize, drawn: &[Drawn]) {
        let (viewpoint, model) = self.hall.cameras[camera].clone();
        let patch = self.patch(person, camera, drawn);
        assert!(self.tracks[person].see(&patch, viewpoint, &model, &self.method));
    }

    /// Places all views, behind all other people; returns the bodies.
    pub(crate) fn place(&mut self) -> Vec<BodyCapsules> {
        let bodies: Vec<BodyCapsules> = self
            .tracks
            .iter()
            .map(|t| t.occluder(&self.method))
            .collect();
        for (i, track) in self.tracks.iter_mut().enumerate() {
            track.place_views(&bodies, i, &self.method);
            track.find_peaks(&self.method);
        }
        bodies
    }

    /// The value of the map of `person`'s keypoint in its `view` at a point, 0 to 1.
    pub(crate) fn value(
        &self,
        person: usize,
        view: usize,
        keypoint: usize,
        at_m: Vector3<f64>,
    ) -> f64 {
        value_at(&self.tracks[person].views()[view], keypoint, at_m)
    }

    fn patch(&self, person: usize, camera: usize, drawn: &[Drawn]) -> PersonPatch {
        let model = &self.hall.cameras[camera].1;
        let grid = grid_over(model, &self.tracks[person].keypoints_m());
        let mut maps = Maps::new(48, 64, self.method.sites.len());
        for &(keypoint, at_m, height) in drawn {
            let center = cell_of(model, &grid, at_m);
            for (i, cell) in maps.cells_mut(keypoint).iter_mut().enumerate() {
                let apart = Vector2::new((i % 48) as f64, (i / 48) as f64) - center;
                let value = height * (-0.5 * apart.norm_squared() / SIGMA_CELLS.powi(2)).exp();
                *cell = (*cell).max(quantize(value as f32));
            }
        }
        PersonPatch {
            person: PersonId(1 + person as u32),
            camera: CameraIndex(camera as u16),
            box_tick: Tick(0),
            capture_offset_us: 0,
            crops: vec![grid],
            crop_of_keypoint: vec![0; self.method.sites.len()],
            maps: Encoder::new().encode(&maps, CompressionLevel::LOSSLESS),
        }
    }
}

pub(crate) fn value_at(view: &View, keypoint: usize, at_m: Vector3<f64>) -> f64 {
    let h = view.cell_from_world(keypoint) * at_m.push(1.0);
    view.map(keypoint).bilinear(Vector2::new(h.x, h.y) / h.z)
}

fn pixel_of(model: &CameraModel, at_m: Vector3<f64>) -> Vector2<f64> {
    model.project(Point::new(at_m.into())).unwrap().vector_px()
}

fn cell_of(model: &CameraModel, grid: &CellGrid, at_m: Vector3<f64>) -> Vector2<f64> {
    grid.cell(model.project(Point::new(at_m.into())).unwrap())
}

/// 48 x 64 cells around these points, with room for an arm.
fn grid_over(model: &CameraModel, points_m: &[Vector3<f64>]) -> CellGrid {
    let pixels = points_m.iter().map(|&p| pixel_of(model, p));
    let first = pixel_of(model, points_m[0]);
    let (least, most) = pixels.fold((first, first), |(a, b), p| (a.inf(&p), b.sup(&p)));
    let step = 1.5 * (most.y - least.y) / 64.0;
    let origin = (least + most) / 2.0 - Vector2::new(23.5, 31.5) * step;
    CellGrid {
        origin_px: [origin.x as f32, origin.y as f32],
        step_px: [step as f32, 0.0],
        width: 48,
        height: 64,
    }
}
