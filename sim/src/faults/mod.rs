//! Heatmaps made straight from truth, with the faults that real networks have: a venue without
//! pixels, for studies that pixels would make too slow.
//!
//! [`MapFaults`] is what one camera's network would say. At every tick the keypoints of everybody in
//! the image are projected, the bodies that cover them are found ([`crate::body::Volume::covers`]),
//! and the faults of the scene's [`FaultProfile`](crate::fault_profile::FaultProfile) added; each [`MapObservation`] then paints the maps of
//! any crop. What mirrors and posters show is painted as people are, though nobody is there. Every draw comes from the scene's seed, so that two runs make the same maps.

mod cover;
mod crowd;
mod in_sight;
mod kept;
mod observe;
mod paint;
mod streams;

use std::sync::Arc;

use farfield_proto::tick::Tick;

use self::in_sight::Standpoint;
use self::observe::CameraFaults;
use crate::scene::Scene;

pub use crowd::SceneCrowd;
pub use kept::KeptMapObservation;
pub use observe::MapObservation;

/// The maps of one camera of a scene, tick after tick.
#[derive(Debug)]
pub struct MapFaults {
    crowd: Arc<SceneCrowd>,
    camera: CameraFaults,
}

impl MapFaults {
    /// Camera `camera` of [`Scene::cameras`], with the scene's faults.
    ///
    /// # Panics
    /// When the scene has no such camera.
    pub fn new(scene: Arc<Scene>, camera: usize) -> Self {
        Self::of(Arc::new(SceneCrowd::new(scene)), camera)
    }

    /// The same, for cameras that share their people: bodies are the larger part of the work, and
    /// made only once for all.
    ///
    /// # Panics
    /// When the scene has no such camera.
    pub fn of(crowd: Arc<SceneCrowd>, camera: usize) -> Self {
        let scene = crowd.scene();
        let camera = CameraFaults::new(
            scene.cameras()[camera].clone(),
            camera,
            crowd.n_subjects(),
            scene.faults().clone(),
            (scene.seed(), scene.rate_hz()),
        )
        .standing(Standpoint::new(scene, camera));
        Self { crowd, camera }
    }

    /// The offset of the camera's captures from their ticks, microseconds: 0 unless the scene's
    /// cameras are free-running, and then constant and within half a frame.
    pub fn capture_offset_us(&self) -> i32 {
        self.camera.capture_offset_us()
    }

    /// What the camera's maps hold at `tick` of the scene (ticks below 0 count as 0): the truth at
    /// the moment of capture, with the faults of the tick.
    ///
    /// Any order of ticks gives the same answers. Forwards it costs the draws of the ticks between,
    /// backwards those from tick 0.
    pub fn observe(&mut self, tick: Tick) -> MapObservation {
        let rate_hz = self.crowd.scene().rate_hz();
        let time_s = tick.seconds(rate_hz) + f64::from(self.capture_offset_us()) * 1e-6;
        self.observe_at(tick, time_s)
    }

    /// As [`Self::observe`], of people as they are at `time_s` of the scene: for recordings in which
    /// its time does not run as the ticks do. Errors are those of `tick`.
    pub fn observe_at(&mut self, tick: Tick, time_s: f64) -> MapObservation {
        let people = self.crowd.at(time_s);
        self.camera.observe(tick.0.max(0).unsigned_abs(), &people)
    }
}

/// The keypoint of the opposite limb, for elbows, wrists, knees and ankles in COCO's order.
fn opposite(keypoint: usize) -> Option<usize> {
    match keypoint {
        7..=10 | 13..=16 => Some(((keypoint - 1) ^ 1) + 1),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
