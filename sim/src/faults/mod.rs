//! Heatmaps made directly from the truth, with the faults of real networks: a venue without pixels,
//! for studies in which rendering would take too long.
//!
//! [`MapFaults`] simulates the network of one camera. At every tick it
//! - projects the keypoints of all people in the image,
//! - finds the bodies that cover them ([`crate::body::Volume::covers`]),
//! - adds the faults of the scene's [`FaultProfile`](crate::fault_profile::FaultProfile).
//!
//! The resulting [`MapObservation`] paints the maps of any crop. Reflections and posters are
//! painted as people are. All draws come from the scene's seed, so two runs make the same maps.

mod cover;
mod crowd;
mod in_sight;
mod observe;
mod paint;
mod streams;

use std::sync::Arc;

use farfield_proto::tick::Tick;

use self::in_sight::Standpoint;
use self::observe::CameraFaults;
use crate::scene::Scene;

pub use crowd::SceneCrowd;
pub use observe::{MapObservation, StoredMapObservation};

/// The maps of one camera of a scene, tick by tick.
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
        Self::with_crowd(Arc::new(SceneCrowd::new(scene)), camera)
    }

    /// As [`Self::new`], for cameras that share the bodies of a crowd: bodies are most of the work
    /// and are built only once.
    ///
    /// # Panics
    /// When the scene has no such camera.
    pub fn with_crowd(crowd: Arc<SceneCrowd>, camera: usize) -> Self {
        let scene = crowd.scene();
        let camera = CameraFaults::new(
            scene.cameras()[camera].clone(),
            camera,
            crowd.n_subjects(),
            scene.faults().clone(),
            scene.seed(),
            scene.rate_hz(),
        )
        .standing(Standpoint::new(scene, camera));
        Self { crowd, camera }
    }

    /// Offset of the camera's captures from their ticks, microseconds. It is constant and within
    /// half a frame; 0 unless the scene's cameras are free-running.
    pub fn capture_offset_us(&self) -> i32 {
        self.camera.capture_offset_us()
    }

    /// The content of the camera's maps at `tick` of the scene (ticks below 0 count as 0): the
    /// truth at the moment of capture, with the faults of the tick.
    ///
    /// The order of calls does not change results. A step forwards costs the draws of the ticks
    /// between, a step backwards those from tick 0.
    pub fn observe(&mut self, tick: Tick) -> MapObservation {
        let rate_hz = self.crowd.scene().rate_hz();
        let time_s = tick.seconds(rate_hz) + f64::from(self.capture_offset_us()) * 1e-6;
        self.observe_at(tick, time_s)
    }

    /// As [`Self::observe`], with the people at scene time `time_s`, for recordings whose scene
    /// time does not follow the ticks. The faults are those of `tick`.
    pub fn observe_at(&mut self, tick: Tick, time_s: f64) -> MapObservation {
        let people = self.crowd.at(time_s);
        self.camera.observe(tick.0.max(0).unsigned_abs(), &people)
    }
}

/// The keypoint of the opposite limb for elbows, wrists, knees and ankles, in COCO's order.
fn opposite(keypoint: usize) -> Option<usize> {
    match keypoint {
        7..=10 | 13..=16 => Some(((keypoint - 1) ^ 1) + 1),
        _ => None,
    }
}

#[cfg(test)]
mod tests;
