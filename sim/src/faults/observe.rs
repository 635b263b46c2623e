//! The content of one camera's maps at one tick, and its stored form in image pixels: the truth,
//! projected, covered by bodies, and changed by the faults of the scene's [`FaultProfile`].
//!
//! Rules where several faults meet:
//! - A keypoint that another body covers is hidden and leaks; its peak has the height of the leak.
//! - A keypoint that is missing, or hidden without a peak, has no mirrored peak either, because the
//!   mirrored height is relative to the true peak. A leaked peak of another person stays.
//! - Where no body covers a keypoint, the nearest reflection or poster leaks in like a body: a
//!   network cannot know which of two adjacent figures is a real person.

use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use nalgebra::{Vector2, Vector3};
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

use super::cover::{Bodies, Cover};
use super::crowd::{FigureKind, Subject};
use super::in_sight::Standpoint;
use super::streams::{
    DrawnFault, KeypointDraws, KeypointStreams, N_KEYPOINTS, StreamOwner, stream,
};
use crate::fault_profile::FaultProfile;

/// COCO's OKS constants, in COCO's order.
const SIGMAS: [f64; N_KEYPOINTS] = [
    0.026, 0.025, 0.025, 0.035, 0.035, 0.079, 0.079, 0.072, 0.072, 0.062, 0.062, 0.107, 0.107,
    0.087, 0.087, 0.089, 0.089,
];
/// The scale s of OKS, sqrt(area), in statures: 0.71 m for 1.75 m.
const SCALE_PER_STATURE: f64 = 0.71 / 1.75;
/// Depth below which errors stop growing in the image, metres: at a smaller depth a hand fills it.
const NEAREST_M: f64 = 0.3;
/// A detector needs this many keypoints inside the image and not covered by another body: a third.
pub(super) const LEAST_KEYPOINTS: usize = 6;

/// The faults of one camera at its current tick.
#[derive(Debug, Clone)]
pub(super) struct CameraFaults {
    camera: Arc<CameraModel>,
    profile: FaultProfile,
    seed: u64,
    rate_hz: f64,
    index: u16,
    /// `None`: nothing blocks the view and all people are visible.
    standpoint: Option<Standpoint>,
    capture_offset_us: i32,
    tick: u64,
    /// `[person][keypoint]`.
    streams: Vec<Vec<KeypointStreams>>,
}

/// The content of one camera's maps at one tick.
#[derive(Debug, Clone)]
pub struct MapObservation {
    pub(super) camera: Arc<CameraModel>,
    pub(super) capture_offset_us: i32,
    /// The people with at least one keypoint in the image.
    pub(super) people: Vec<ImagedPerson>,
    /// Highest noise, 0 to 1.
    pub(super) noise: f64,
    /// Different for every seed, camera and tick.
    pub(super) noise_key: u64,
}

/// One person in one image.
#[derive(Debug, Clone)]
pub(super) struct ImagedPerson {
    /// Index in the scene.
    pub(super) person: usize,
    /// Pelvis and neck without error, undistorted pixels.
    pub(super) torso_px: Vector2<f64>,
    pub(super) neck_px: Vector2<f64>,
    pub(super) keypoints: [KeypointPeaks; N_KEYPOINTS],
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct KeypointPeaks {
    /// The peak near the keypoint itself.
    pub(super) own: Option<SimulatedPeak>,
    /// The peak at the opposite limb.
    pub(super) mirrored: Option<SimulatedPeak>,
    /// The peak at the same keypoint of the person in front, if the crop contains it.
    pub(super) leaked: Option<SimulatedPeak>,
    /// Whether the keypoint is in the image and no other body covers it.
    pub(super) in_the_open: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SimulatedPeak {
    /// Undistorted pixels.
    pub(super) at_px: Vector2<f64>,
    /// 1 without faults.
    pub(super) height: f64,
}

impl MapObservation {
    /// Time of capture, microseconds after the time of the tick.
    pub fn capture_offset_us(&self) -> i32 {
        self.capture_offset_us
    }

    /// A black picture without people and noise.
    pub fn black(camera: &Arc<CameraModel>) -> Self {
        Self {
            camera: Arc::clone(camera),
            capture_offset_us: 0,
            people: Vec::new(),
            noise: 0.0,
            noise_key: 0,
        }
    }
}

struct PersonInView {
    figure: FigureKind,
    /// Undistorted pixels.
    torso_px: Vector2<f64>,
    neck_px: Vector2<f64>,
    covered: [Cover; N_KEYPOINTS],
    /// The keypoints inside the image, with their errors.
    keypoints_px: [Option<Vector2<f64>>; N_KEYPOINTS],
}

impl CameraFaults {
    /// The faults of camera `index` at tick 0, for `n_people` people of a scene with `seed`.
    pub(super) fn new(
        camera: CameraModel,
        index: usize,
        n_people: usize,
        profile: FaultProfile,
        seed: u64,
        rate_hz: f64,
    ) -> Self {
        let mut faults = Self {
            camera: Arc::new(camera),
            profile,
            seed,
            rate_hz,
            index: index as u16,
            standpoint: None,
            capture_offset_us: 0,
            tick: 0,
            streams: Vec::with_capacity(n_people),
        };
        if faults.profile.free_running {
            let owner = StreamOwner {
                camera: faults.index,
                ..StreamOwner::default()
            };
            let share = stream(seed, DrawnFault::Timing, owner).random::<f64>() - 0.5;
            faults.capture_offset_us = (share / rate_hz * 1e6).round() as i32;
        }
        faults.restart(n_people);
        faults
    }

    /// The same with the mirrors and posters of a scene.
    pub(super) fn standing(mut self, at: Standpoint) -> Self {
        self.standpoint = Some(at);
        self
    }

    fn restart(&mut self, n_people: usize) {
        self.tick = 0;
        self.streams.clear();
        let person = |person| {
            let keypoint = |keypoint| {
                let owner = StreamOwner {
                    camera: self.index,
                    person,
                    keypoint,
                };
                KeypointStreams::new(&self.profile, self.rate_hz, self.seed, owner)
            };
            (0..N_KEYPOINTS as u16).map(keypoint).collect()
        };
        let streams = (0..n_people as u16).map(person).collect();
        self.streams = streams;
    }

    /// Advances to `tick`; restarts at tick 0 if `tick` is in the past.
    fn go_to(&mut self, tick: u64) {
        if tick < self.tick {
            self.restart(self.streams.len());
        }
        for _ in self.tick..tick {
            for streams in self.streams.iter_mut().flatten() {
                streams.advance();
            }
        }
        self.tick = tick;
    }

    /// The content of the camera's maps at `tick` (from 0). `subjects` has one entry per person of
    /// the scene, `None` for an absent one.
    ///
    /// Cost: one call of [`crate::body::Volume::covers`] per keypoint in the image and person.
    pub(super) fn observe(&mut self, tick: u64, subjects: &[Option<Subject>]) -> MapObservation {
        self.go_to(tick);
        let eye_m = self.camera.center().coordinates_m().coords;
        let bodies = Bodies::new(eye_m, subjects, self.standpoint.as_ref());
        let views: Vec<Option<PersonInView>> = (0..subjects.len())
            .map(|person| self.view(person, subjects[person].as_ref()?, &bodies))
            .collect();
        let people = (0..views.len())
            .filter_map(|person| self.seen(person, &views))
            .collect();
        MapObservation {
            camera: Arc::clone(&self.camera),
            capture_offset_us: self.capture_offset_us,
            people,
            noise: self.profile.noise.map_or(0.0, |noise| noise.floor),
            noise_key: mixed(mixed(self.seed ^ u64::from(self.index) << 48) ^ tick),
        }
    }

    pub(super) fn capture_offset_us(&self) -> i32 {
        self.capture_offset_us
    }

    /// The projection of one person and its keypoints. `None` if no keypoint is in the image, or if
    /// pelvis and neck are both behind the camera.
    fn view(&self, person: usize, subject: &Subject, bodies: &Bodies<'_>) -> Option<PersonInView> {
        let at = self.standpoint.as_ref();
        if at.is_some_and(|at| !at.faces(subject)) {
            return None;
        }
        let project = |p: &Vector3<f64>| self.camera.project(Point::new((*p).into()));
        let sites_px = subject.sites_m.each_ref().map(|site_m| {
            let px = project(site_m).filter(|px| self.camera.sees(*px))?;
            let reached = at.is_none_or(|at| at.reaches(subject, site_m));
            reached.then(|| px.vector_px())
        });
        sites_px.iter().flatten().next()?;
        let torso_px = project(&subject.torso_m).map(|px| px.vector_px());
        let neck_px = project(&subject.neck_m).map(|px| px.vector_px());
        let mut view = PersonInView {
            figure: subject.figure,
            torso_px: torso_px.or(neck_px)?,
            neck_px: neck_px.or(torso_px)?,
            covered: [Cover::default(); N_KEYPOINTS],
            keypoints_px: [None; N_KEYPOINTS],
        };
        let before = bodies.before(person);
        let px_per_m = self.px_per_m(&subject.torso_m);
        for (k, streams) in self.streams[person].iter().enumerate() {
            let Some(site_px) = sites_px[k] else { continue };
            view.covered[k] = bodies.cover(person, k, &before);
            let scale_m = SIGMAS[k] * SCALE_PER_STATURE * subject.stature_m;
            let error = self.error(&streams.draws(), view.covered[k].any());
            view.keypoints_px[k] = Some(site_px + scale_m * error.component_mul(&px_per_m));
        }
        Some(view)
    }

    /// The error of a keypoint in the image plane, in `sigma_k s`.
    fn error(&self, draws: &KeypointDraws, covered: bool) -> Vector2<f64> {
        let factor = match self.profile.hidden {
            Some(hidden) if covered => hidden.bias_factor,
            _ => 1.0,
        };
        let bias = self.profile.bias.map_or(0.0, |bias| bias.share_of_sigma);
        let jitter = self
            .profile
            .jitter
            .map_or(0.0, |jitter| jitter.share_of_sigma);
        Vector2::from(draws.bias) * (bias * factor) + Vector2::from(draws.jitter) * jitter
    }

    /// Pixels per metre across the line of sight at the depth of `point_m`.
    fn px_per_m(&self, point_m: &Vector3<f64>) -> Vector2<f64> {
        let p_c = *self.camera.camera_from_world() * Point::new((*point_m).into());
        let depth_m = p_c.coordinates_m().z.max(NEAREST_M);
        let focal = self.camera.intrinsics();
        Vector2::new(focal.fx_px, focal.fy_px) / depth_m
    }

    /// The peaks of one person; `None` if no part of the person is in the image.
    fn seen(&self, person: usize, views: &[Option<PersonInView>]) -> Option<ImagedPerson> {
        let view = views[person].as_ref()?;
        let figure = nearest_unreal_figure(view, views);
        let mut keypoints = [KeypointPeaks::default(); N_KEYPOINTS];
        for (k, evidence) in keypoints.iter_mut().enumerate() {
            if let Some(at_px) = view.keypoints_px[k] {
                let draws = self.streams[person][k].draws();
                *evidence = self.evidence(k, at_px, &draws, view, views);
                let shown = figure.filter(|_| draws.leaks && evidence.in_the_open);
                if let Some((leak, figure)) = self.profile.leak.zip(shown) {
                    evidence.leaked = figure.in_the_open(k).map(|at_px| SimulatedPeak {
                        at_px,
                        height: leak.height,
                    });
                }
            }
        }
        Some(ImagedPerson {
            person,
            torso_px: view.torso_px,
            neck_px: view.neck_px,
            keypoints,
        })
    }

    /// The peaks in the map of keypoint `k` of the person of `view`.
    fn evidence(
        &self,
        k: usize,
        at_px: Vector2<f64>,
        draws: &KeypointDraws,
        view: &PersonInView,
        views: &[Option<PersonInView>],
    ) -> KeypointPeaks {
        let Cover { by_other, .. } = view.covered[k];
        let hidden = self.profile.hidden.filter(|_| view.covered[k].any());
        let leak = self.profile.leak.filter(|_| by_other.is_some());
        let height = match (hidden, draws.hidden) {
            (Some(_), None) => None,
            (Some(_), guessed) if leak.is_none() => guessed,
            _ => Some(leak.map_or(1.0, |leak| leak.own_height)),
        };
        let height = height.filter(|_| !draws.missing);
        let peak = |at_px, height| SimulatedPeak { at_px, height };
        KeypointPeaks {
            own: height.map(|height| peak(at_px, height)),
            mirrored: height.zip(draws.mirror).and_then(|(height, share)| {
                let at_px = view.keypoints_px[super::opposite(k)?]?;
                Some(peak(at_px, height * share))
            }),
            leaked: leak.filter(|_| draws.leaks).and_then(|leak| {
                let at_px = views[by_other?].as_ref()?.keypoints_px[k]?;
                Some(peak(at_px, leak.height))
            }),
            in_the_open: by_other.is_none(),
        }
    }
}

impl PersonInView {
    /// The position of keypoint `k`, if no other body covers it.
    fn in_the_open(&self, k: usize) -> Option<Vector2<f64>> {
        self.keypoints_px[k].filter(|_| self.covered[k].by_other.is_none())
    }
}

/// The reflection or poster nearest to the person of `view` in the image.
fn nearest_unreal_figure<'a>(
    view: &PersonInView,
    views: &'a [Option<PersonInView>],
) -> Option<&'a PersonInView> {
    if view.figure != FigureKind::Body {
        return None;
    }
    let apart_px = |other: &PersonInView| (other.torso_px - view.torso_px).norm();
    let shown = views
        .iter()
        .flatten()
        .filter(|v| v.figure != FigureKind::Body);
    shown.min_by(|a, b| apart_px(a).total_cmp(&apart_px(b)))
}

/// A well mixed hash of `x` (the finaliser of splitmix64).
pub(super) fn mixed(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Highest accepted peak: a mirrored peak may exceed the true one, which is at most 1.
const MAX_HEIGHT: f32 = 16.0;

/// The content of one camera's maps at one tick, without the camera.
///
/// Positions are f32: maps painted from it differ from the original by at most one step in some
/// cells.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StoredMapObservation {
    people: Vec<StoredPerson>,
    noise: f32,
    noise_key: u64,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct StoredPerson {
    person: u16,
    torso_px: [f32; 2],
    neck_px: [f32; 2],
    keypoints: [StoredEvidence; N_KEYPOINTS],
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct StoredEvidence {
    own: Option<StoredPeak>,
    mirrored: Option<StoredPeak>,
    leaked: Option<StoredPeak>,
    in_the_open: bool,
}

/// Undistorted pixels and height.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct StoredPeak([f32; 3]);

impl StoredMapObservation {
    /// Stores `observation`.
    pub fn new(observation: &MapObservation) -> Self {
        Self {
            people: observation.people.iter().map(StoredPerson::new).collect(),
            noise: observation.noise as f32,
            noise_key: observation.noise_key,
        }
    }

    /// Checks every number.
    ///
    /// # Errors
    /// A short description of an impossible value.
    pub fn check(&self) -> Result<(), &'static str> {
        if !(0.0..=1.0).contains(&self.noise) {
            return Err("noise outside 0 to 1");
        }
        self.people
            .iter()
            .try_for_each(|person| person.restore().map(drop))
    }

    /// The maps that `camera` observed `capture_offset_us` after the time of the tick.
    ///
    /// # Errors
    /// A short description of an impossible value.
    pub fn restore(
        &self,
        camera: &Arc<CameraModel>,
        capture_offset_us: i32,
    ) -> Result<MapObservation, &'static str> {
        if !(0.0..=1.0).contains(&self.noise) {
            return Err("noise outside 0 to 1");
        }
        let people: Result<_, _> = self.people.iter().map(StoredPerson::restore).collect();
        Ok(MapObservation {
            camera: Arc::clone(camera),
            capture_offset_us,
            people: people?,
            noise: f64::from(self.noise),
            noise_key: self.noise_key,
        })
    }
}

impl StoredPerson {
    fn new(seen: &ImagedPerson) -> Self {
        Self {
            person: seen.person as u16,
            torso_px: stored_px(seen.torso_px),
            neck_px: stored_px(seen.neck_px),
            keypoints: seen.keypoints.map(|evidence| StoredEvidence {
                own: evidence.own.map(StoredPeak::new),
                mirrored: evidence.mirrored.map(StoredPeak::new),
                leaked: evidence.leaked.map(StoredPeak::new),
                in_the_open: evidence.in_the_open,
            }),
        }
    }

    fn restore(&self) -> Result<ImagedPerson, &'static str> {
        let mut keypoints = [KeypointPeaks::default(); N_KEYPOINTS];
        for (evidence, stored) in keypoints.iter_mut().zip(&self.keypoints) {
            let restore = |peak: Option<StoredPeak>| peak.map(StoredPeak::restore).transpose();
            *evidence = KeypointPeaks {
                own: restore(stored.own)?,
                mirrored: restore(stored.mirrored)?,
                leaked: restore(stored.leaked)?,
                in_the_open: stored.in_the_open,
            };
        }
        Ok(ImagedPerson {
            person: usize::from(self.person),
            torso_px: restored_px(self.torso_px)?,
            neck_px: restored_px(self.neck_px)?,
            keypoints,
        })
    }
}

impl StoredPeak {
    fn new(peak: SimulatedPeak) -> Self {
        let [x, y] = stored_px(peak.at_px);
        Self([x, y, peak.height as f32])
    }

    fn restore(self) -> Result<SimulatedPeak, &'static str> {
        let [x, y, height] = self.0;
        if !(0.0..=MAX_HEIGHT).contains(&height) {
            return Err("a peak of an impossible height");
        }
        Ok(SimulatedPeak {
            at_px: restored_px([x, y])?,
            height: f64::from(height),
        })
    }
}

fn stored_px(px: Vector2<f64>) -> [f32; 2] {
    [px.x as f32, px.y as f32]
}

fn restored_px(px: [f32; 2]) -> Result<Vector2<f64>, &'static str> {
    if px.iter().all(|v| v.is_finite()) {
        Ok(Vector2::from(px.map(f64::from)))
    } else {
        Err("a place that is not finite")
    }
}
