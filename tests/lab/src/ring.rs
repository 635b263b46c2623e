//! A walker inside a ring of viewpoints, with the patches of perfect edges: for benches and for tests of fusion without edges.

use std::f64::consts::TAU;

use anyhow::Context as _;
use farfield_edge::crop::{CropGeometry, CropShape};
use farfield_edge::gaussian_maps::draw_maps;
use farfield_edge::source::KeypointCandidate;
use farfield_fusion::align::TickGroup;
use farfield_fusion::body::fit::fit;
use farfield_fusion::body::ik::relative_sigmas;
use farfield_fusion::body::observed::ObservedJoints;
use farfield_fusion::body::skeleton::{RangeOfMotion, sites_of};
use farfield_fusion::boxes::BoxShape;
use farfield_fusion::estimate::estimator::Estimator;
use farfield_fusion::method::Method;
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Point;
use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use farfield_proto::keypoints::{COCO17, KeypointSet};
use farfield_proto::message::{PatchSet, PersonPatch};
use farfield_proto::patch::{CompressionLevel, Encoder, Maps};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Parameters;
use nalgebra::Vector3;

use farfield_sim::look_at::look_at;
use farfield_sim::walker::Walker;

/// Rate of the ring, hertz.
pub const RATE_HZ: f64 = 60.0;
/// Cells of a map, as of TinyPose and small networks.
const CELLS: [u16; 2] = [48, 64];

/// One camera per viewpoint around one walker.
pub struct CameraRing {
    cameras: Vec<CameraModel>,
    walker: Walker,
}

impl CameraRing {
    /// `n_viewpoints` cameras on a circle of 6 m.
    ///
    /// # Errors
    /// Never for these cameras.
    pub fn new(n_viewpoints: usize) -> anyhow::Result<Self> {
        let camera = |index: usize| {
            let angle = TAU * index as f64 / n_viewpoints as f64;
            let eye = Vector3::new(6.0 * angle.cos(), 6.0 * angle.sin(), 2.5);
            let intrinsics = Intrinsics {
                fx_px: 1100.0,
                fy_px: 1100.0,
                cx_px: 959.5,
                cy_px: 599.5,
            };
            CameraModel::new(
                format!("camera-{index}"),
                [1920, 1200],
                intrinsics,
                Distortion::default(),
                look_at(eye, Vector3::z()),
            )
        };
        let cameras = (0..n_viewpoints).map(camera).collect::<Result<_, _>>()?;
        let walker = Walker {
            center_m: [0.0, 0.0],
            radius_m: 1.5,
            speed_m_s: 1.4,
            start_rad: 0.0,
            stature_m: 1.75,
        };
        Ok(Self { cameras, walker })
    }

    /// The cameras, one per viewpoint.
    pub fn cameras(&self) -> &[CameraModel] {
        &self.cameras
    }

    /// The method of tracks in this ring: default parameters and COCO keypoints.
    pub fn method() -> Method {
        let (keypoints, parameters) = (KeypointSet::coco17(), Parameters::default());
        Method {
            dt_s: 1.0 / RATE_HZ,
            sites: sites_of(&keypoints, &std::collections::BTreeMap::new()),
            relative_sigmas: relative_sigmas(&keypoints, &std::collections::BTreeMap::new()),
            map_size: None,
            floor_m: 0.0,
            peak_sigma_of_width: farfield_proto::model_card::PEAK_SIGMA_OF_WIDTH,
            keypoints,
            range_of_motion: Some(RangeOfMotion::new(1.0)),
            box_shape: BoxShape {
                margin: 1.25,
                reach_m: 0.0,
                parameters: parameters.boxes.clone(),
            },
            parameters,
        }
    }

    /// The track of the walker from tick 0.
    ///
    /// # Errors
    /// No skeleton fits the walker.
    pub fn track(&self, method: &Method) -> anyhow::Result<Estimator> {
        let points = self.walker.points_m(0.0);
        let named = COCO17.iter().map(|name| (*name, points[*name].into()));
        let body = fit(
            &[ObservedJoints::from_named(named)],
            &method.parameters.ik,
            None,
        )
        .context("fitting the walker")?;
        Ok(Estimator::new(body.skeleton, body.pose, method))
    }

    /// True keypoint positions, world, metres, in COCO order.
    pub fn truth_m(&self, tick: Tick) -> Vec<Vector3<f64>> {
        let points = self.walker.points_m(tick.seconds(RATE_HZ));
        COCO17.iter().map(|name| points[*name]).collect()
    }

    /// The patches of all viewpoints at `tick`.
    ///
    /// # Errors
    /// The walker is outside a camera's view, which the ring prevents.
    pub fn group(&self, tick: Tick) -> anyhow::Result<TickGroup> {
        let mut encoder = Encoder::new();
        let sets = self.cameras.iter().enumerate().map(|(index, camera)| {
            let (grid_maps, grid) = self.maps(tick, camera)?;
            let patch = PersonPatch {
                person: PersonId(1),
                camera: CameraIndex(index as u16),
                box_tick: tick,
                capture_offset_us: 0,
                crops: vec![grid],
                crop_of_keypoint: vec![0; COCO17.len()],
                maps: encoder.encode(&grid_maps, CompressionLevel::LOSSLESS),
            };
            Ok(PatchSet {
                session: SessionId(1),
                tick,
                viewpoint: ViewpointIndex(index as u16),
                part: 0,
                parts: 1,
                sighting_parts: 0,
                timing: None,
                persons: vec![patch],
            })
        });
        Ok(TickGroup {
            tick,
            patch_sets: sets.collect::<anyhow::Result<_>>()?,
            sighting_sets: Vec::new(),
        })
    }

    fn maps(
        &self,
        tick: Tick,
        camera: &CameraModel,
    ) -> anyhow::Result<(Maps, farfield_proto::grid::CellGrid)> {
        let project = |p: Vector3<f64>| {
            camera
                .project(Point::new(p.into()))
                .context("the walker is behind a camera")
        };
        let pixels = self
            .truth_m(tick)
            .into_iter()
            .map(project)
            .collect::<anyhow::Result<Vec<_>>>()?;
        let extent = |of: &dyn Fn(usize) -> f64| {
            let values = (0..pixels.len()).map(of);
            values.fold((f64::MAX, f64::MIN), |(lo, hi), v| (lo.min(v), hi.max(v)))
        };
        let ((x0, x1), (y0, y1)) = (extent(&|k| pixels[k].x()), extent(&|k| pixels[k].y()));
        let region = BoundingBox {
            center_px: [(x0 + x1) as f32 / 2.0, (y0 + y1) as f32 / 2.0],
            size_px: [(x1 - x0) as f32 * 1.25, (y1 - y0) as f32 * 1.25],
            rotation_rad: 0.0,
        };
        let grid = CropGeometry::new(&region, CropShape::of_grid(CELLS))
            .context("an empty box")?
            .grid();
        let candidates = pixels.iter().map(|p| {
            camera.distort(*p).map(|position| KeypointCandidate {
                position,
                score: 0.9,
            })
        });
        let peaks: Vec<Vec<KeypointCandidate>> = candidates
            .map(|candidate| candidate.into_iter().collect())
            .collect();
        let mut maps = Maps::new(usize::from(CELLS[0]), usize::from(CELLS[1]), COCO17.len());
        draw_maps(&peaks, camera, &grid, 2.0, &mut maps);
        Ok((maps, grid))
    }
}
