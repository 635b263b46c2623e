//! The figures of a scene at one moment, shared by all cameras: bodies, reflections and posters.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector3;

use super::streams::N_KEYPOINTS;
use crate::body::{Build, Volume};
use crate::scene::{PersonTruth, Scene, ViewpointMask};

/// Cached moments: the cameras of a run are at most a few ticks apart.
const MOMENTS: usize = 8;

/// The kind of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FigureKind {
    Body,
    /// The reflection of a person in this mirror of the scene.
    Reflection(usize),
    /// This poster of the scene.
    Poster(usize),
}

/// One figure at one moment, world metres.
#[derive(Debug, Clone)]
pub(super) struct Subject {
    pub(super) figure: FigureKind,
    /// The viewpoints that see it, unless something blocks the view.
    pub(super) seen_by: ViewpointMask,
    pub(super) stature_m: f64,
    pub(super) torso_m: Vector3<f64>,
    pub(super) neck_m: Vector3<f64>,
    /// Sites of the keypoints, in COCO's order.
    pub(super) sites_m: [Vector3<f64>; N_KEYPOINTS],
    pub(super) volume: Volume,
}

impl Subject {
    /// The person with these joints and keypoint sites, visible to all viewpoints.
    pub(super) fn new(truth: &PersonTruth, build: &Build) -> Self {
        Self::from_truth(truth, build.stature_m, Volume::new(&truth.joints_m, build))
    }

    fn from_truth(truth: &PersonTruth, stature_m: f64, volume: Volume) -> Self {
        Self {
            figure: FigureKind::Body,
            seen_by: ViewpointMask::MAX,
            stature_m,
            torso_m: truth.joint_m(Joint::Pelvis),
            neck_m: truth.joint_m(Joint::Neck),
            sites_m: truth.sites_m,
            volume,
        }
    }
}

/// All figures at one moment: one entry per person of the scene, then one per mirror and person,
/// then one per poster. `None` marks an absent figure.
type SubjectsAtTime = Arc<[Option<Subject>]>;

/// The people of a scene; their bodies are built once for all cameras that request the same moment.
///
/// Results do not depend on earlier requests.
#[derive(Debug)]
pub struct SceneCrowd {
    scene: Arc<Scene>,
    builds: Vec<Build>,
    posters: Vec<Subject>,
    /// The last requested moments, by the bits of their time in seconds.
    recent: Mutex<VecDeque<(u64, SubjectsAtTime)>>,
}

impl SceneCrowd {
    /// The people of `scene`.
    pub fn new(scene: Arc<Scene>) -> Self {
        let people = scene.people().iter();
        let builds = people.map(|person| Build::from_seed(person.stature_m, person.build_seed));
        let posters = scene.posters().iter().enumerate().map(|(index, poster)| {
            let build = Build::from_seed(poster.stature_m, poster.build_seed);
            Subject {
                figure: FigureKind::Poster(index),
                ..Subject::from_truth(&poster.printed(), poster.stature_m, poster.volume(&build))
            }
        });
        Self {
            builds: builds.collect(),
            posters: posters.collect(),
            scene,
            recent: Mutex::default(),
        }
    }

    /// The scene.
    pub fn scene(&self) -> &Arc<Scene> {
        &self.scene
    }

    /// Number of entries of [`Self::at`].
    pub(super) fn n_subjects(&self) -> usize {
        self.builds.len() * (1 + self.scene.mirrors().len()) + self.posters.len()
    }

    /// All figures at `time_s`. Concurrent callers wait: in a run they request the same moment,
    /// which is built only once.
    pub(super) fn at(&self, time_s: f64) -> SubjectsAtTime {
        // A panic in another thread leaves only complete moments behind.
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        let key = time_s.to_bits();
        if let Some((_, moment)) = recent.iter().find(|(time, _)| *time == key) {
            return Arc::clone(moment);
        }
        let moment = self.moment(time_s);
        if recent.len() == MOMENTS {
            recent.pop_front();
        }
        recent.push_back((key, Arc::clone(&moment)));
        moment
    }

    fn moment(&self, time_s: f64) -> SubjectsAtTime {
        let people = 0..self.builds.len();
        let truths: Vec<Option<PersonTruth>> = people
            .map(|person| self.scene.person_at(person, time_s))
            .collect();
        let bodies = truths.iter().enumerate().map(|(person, truth)| {
            let body = Subject::new(truth.as_ref()?, &self.builds[person]);
            let seen_by = self.scene.seen_by(person, time_s);
            Some(Subject { seen_by, ..body })
        });
        let mut moment: Vec<Option<Subject>> = bodies.collect();
        for (index, mirror) in self.scene.mirrors().iter().enumerate() {
            let reflections = truths.iter().enumerate().map(|(person, truth)| {
                let before = truth.as_ref();
                let before = before.filter(|t| mirror.is_before(&t.joint_m(Joint::Pelvis)))?;
                let seen = mirror.reflected_person(before);
                Some(Subject {
                    figure: FigureKind::Reflection(index),
                    seen_by: self.scene.seen_by(person, time_s),
                    ..Subject::new(&seen, &self.builds[person])
                })
            });
            moment.extend(reflections);
        }
        moment.extend(self.posters.iter().cloned().map(Some));
        moment.into()
    }
}
