//! The people of a scene at one moment, as all its cameras need them.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use farfield_fusion::predict::Joints;
use farfield_fusion::skeleton::Joint;
use nalgebra::Vector3;

use super::streams::N_KEYPOINTS;
use crate::body::{Build, Volume};
use crate::scene::Scene;

/// Moments that are remembered: the cameras of a run are a few ticks apart at most.
const MOMENTS: usize = 8;

/// One person at one moment, world metres.
#[derive(Debug, Clone)]
pub(super) struct Subject {
    pub(super) stature_m: f64,
    pub(super) torso_m: Vector3<f64>,
    pub(super) neck_m: Vector3<f64>,
    /// The sites of the keypoints, in COCO's order.
    pub(super) sites_m: [Vector3<f64>; N_KEYPOINTS],
    pub(super) volume: Volume,
}

impl Subject {
    /// The person with these joints and keypoint sites.
    pub(super) fn new(
        joints_m: &Joints,
        sites_m: &[Vector3<f64>; N_KEYPOINTS],
        build: &Build,
    ) -> Self {
        Self {
            stature_m: build.stature_m,
            torso_m: joints_m[Joint::Pelvis.index()],
            neck_m: joints_m[Joint::Neck.index()],
            sites_m: *sites_m,
            volume: Volume::new(joints_m, build),
        }
    }
}

/// Everybody at one moment: one entry per person of the scene, `None` for who is not there.
type Moment = Arc<[Option<Subject>]>;

/// The people of a scene, whose bodies are made once for all cameras that ask for the same moment.
///
/// Answers never depend on what was asked before; only the time that they take does.
#[derive(Debug)]
pub struct Crowd {
    scene: Arc<Scene>,
    builds: Vec<Build>,
    /// The moments asked for last, by their time in seconds (as bits).
    recent: Mutex<VecDeque<(u64, Moment)>>,
}

impl Crowd {
    /// The people of `scene`.
    pub fn new(scene: Arc<Scene>) -> Self {
        let builds = scene
            .people()
            .iter()
            .map(|person| Build::from_seed(person.stature_m, person.build_seed))
            .collect();
        Self {
            scene,
            builds,
            recent: Mutex::default(),
        }
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Everybody at `time_s`. Whoever else asks for a moment meanwhile waits: it is the same one in
    /// a run, and is made only once.
    pub(super) fn at(&self, time_s: f64) -> Moment {
        // A panic elsewhere leaves whole moments behind.
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        let key = time_s.to_bits();
        if let Some((_, moment)) = recent.iter().find(|(time, _)| *time == key) {
            return Arc::clone(moment);
        }
        let people = self.builds.iter().enumerate();
        let moment: Moment = people
            .map(|(person, build)| {
                let truth = self.scene.person_at(person, time_s)?;
                Some(Subject::new(&truth.joints_m, &truth.sites_m, build))
            })
            .collect();
        if recent.len() == MOMENTS {
            recent.pop_front();
        }
        recent.push_back((key, Arc::clone(&moment)));
        moment
    }
}
