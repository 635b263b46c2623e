//! The people of a scene at one moment, as all its cameras need them: bodies, what mirrors show of
//! them, and pictures of people.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use farfield_fusion::body::skeleton::Joint;
use nalgebra::Vector3;

use super::streams::N_KEYPOINTS;
use crate::body::{Build, Volume};
use crate::scene::{PersonTruth, Scene, ViewpointMask};

/// Moments that are remembered: the cameras of a run are a few ticks apart at most.
const MOMENTS: usize = 8;

/// What it is that looks like a person.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FigureKind {
    /// A person.
    Body,
    /// What this mirror of the scene shows of a person.
    Reflection(usize),
    /// This poster of the scene.
    Poster(usize),
}

/// One person, or what looks like one, at one moment, world metres.
#[derive(Debug, Clone)]
pub(super) struct Subject {
    pub(super) figure: FigureKind,
    /// The viewpoints that see it, unless something stands in between.
    pub(super) seen_by: ViewpointMask,
    pub(super) stature_m: f64,
    pub(super) torso_m: Vector3<f64>,
    pub(super) neck_m: Vector3<f64>,
    /// The sites of the keypoints, in COCO's order.
    pub(super) sites_m: [Vector3<f64>; N_KEYPOINTS],
    pub(super) volume: Volume,
}

impl Subject {
    /// The person with these joints and keypoint sites, seen by all.
    pub(super) fn new(truth: &PersonTruth, build: &Build) -> Self {
        Self::of(truth, build.stature_m, Volume::new(&truth.joints_m, build))
    }

    fn of(truth: &PersonTruth, stature_m: f64, volume: Volume) -> Self {
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

/// Everybody at one moment: one entry per person of the scene, then one per mirror and person, then
/// one per poster; `None` for who is not there.
type SubjectsAtTime = Arc<[Option<Subject>]>;

/// The people of a scene, whose bodies are made once for all cameras that ask for the same moment.
///
/// Answers never depend on what was asked before; only the time that they take does.
#[derive(Debug)]
pub struct SceneCrowd {
    scene: Arc<Scene>,
    builds: Vec<Build>,
    posters: Vec<Subject>,
    /// The moments asked for last, by their time in seconds (as bits).
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
                ..Subject::of(&poster.printed(), poster.stature_m, poster.volume(&build))
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

    /// How many look like people: entries of [`Self::at`].
    pub(super) fn n_subjects(&self) -> usize {
        self.builds.len() * (1 + self.scene.mirrors().len()) + self.posters.len()
    }

    /// Everybody at `time_s`. Whoever else asks for a moment meanwhile waits: it is the same one in
    /// a run, and is made only once.
    pub(super) fn at(&self, time_s: f64) -> SubjectsAtTime {
        // A panic elsewhere leaves whole moments behind.
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
