//! A scene: people, cameras and a ball, whose truth is a pure function of time.
//!
//! [`Scene::load`] reads a scene file ([`mod@file`]), its motion clips and its cameras, and plans
//! everybody's way. After that nothing is drawn or remembered: the same scene answers any time, in
//! any order, with the same truth ([`truth`]), in some ten microseconds per person.

mod aside;
mod ball;
mod cameras;
mod check;
mod draws;
pub mod file;
mod path;
mod plan;
pub mod range_of_motion;
mod steer;
mod table;
mod timeline;
pub mod truth;
pub mod write;

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::{FileError, Place, TomlFile, unknown_name};
use nalgebra::Vector3;
use rand::RngExt as _;

pub use self::aside::KEEP_M;
pub use self::ball::BALL_RADIUS_M;
use self::ball::Ball;
use self::cameras::Rig;
use self::draws::{Purpose, draws};
use self::file::{CameraSource, SceneFile};
pub use self::plan::EDGE_M;
use self::plan::Plan;
use self::truth::DefinitionOffsets;
pub use self::truth::{N_SITES, PersonTruth, SITE_JOINTS};
use crate::faults::FaultProfile;
use crate::motion::Clip;

/// Height of the field that people are tracked in above its floor, metres: a raised hand in a jump.
const FIELD_TOP_M: f64 = 2.8;
/// How far below the floor it begins, metres: a foot is never exactly on it.
const FIELD_BOTTOM_M: f64 = -0.3;
/// How far beyond the field's edge it reaches, metres: the limbs of who stands at the edge.
const FIELD_MARGIN_M: f64 = 0.5;

/// A place with cameras on one machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneViewpoint {
    /// Its name.
    pub name: String,
    /// Its cameras, as positions in [`Scene::cameras`].
    pub cameras: Vec<usize>,
}

/// Somebody in the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePerson {
    /// Name in the scene file.
    pub name: String,
    /// Number in truth files, from 1: the name where all names are numbers, else the place in the file.
    pub number: u32,
    /// Stature, metres.
    pub stature_m: f64,
    /// The group whose clips' coordinate frame it shares, if any.
    pub group: Option<String>,
    /// Seed of its shape, skin and clothes.
    pub build_seed: u64,
    /// When it appears, seconds; who is there from the start was there before it, too.
    pub enter_s: f64,
    /// When it is gone, seconds; who stays to the end stays beyond it, too.
    pub leave_s: f64,
    definition: DefinitionOffsets,
}

/// People, cameras and a ball; see the head of this module.
#[derive(Debug)]
pub struct Scene {
    rate_hz: f64,
    seconds: f64,
    planned_s: f64,
    seed: u64,
    size_m: [f64; 2],
    rig: Rig,
    people: Vec<ScenePerson>,
    plan: Plan,
    ball: Option<Ball>,
    faults: FaultProfile,
}

impl Scene {
    /// Reads the scene file at `path`, its clips and its calibration.
    ///
    /// # Errors
    /// [`FileError`] naming the file (the scene, a clip, the calibration), line and field.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let text = read(path)?;
        Self::parse(&text, path, &mut |clip| Ok(Arc::new(Clip::load(clip)?)))
    }

    /// Reads a scene's text; `path` is what paths in it are relative to, `clips` gives the motion
    /// clip of a path (asked once for each). A calibration is read from its file.
    ///
    /// # Errors
    /// As [`Scene::load`], and what `clips` answers.
    pub fn parse(
        text: &str,
        path: &Path,
        clips: &mut dyn FnMut(&Path) -> Result<Arc<Clip>, FileError>,
    ) -> Result<Self, FileError> {
        let file = SceneFile::parse(text, path)?;
        let toml = TomlFile::parse(text, path)?;
        let rig = mount(&file, &toml)?;
        let clips = clips_of(&file, clips)?;
        let plan = Plan::new(&file, &clips);
        let numbers = numbers_of(&file);
        let statures_m = Plan::statures_m(&file, &clips);
        let person = |(index, entry): (usize, &file::PersonEntry)| ScenePerson {
            name: entry.name.clone(),
            number: numbers[index],
            stature_m: statures_m[index],
            group: entry.group.clone(),
            build_seed: draws(file.seed, Purpose::Build, index).random(),
            enter_s: entry.enter_s,
            leave_s: entry.leave_s,
            definition: DefinitionOffsets::draw(file.seed, index),
        };
        let people: Vec<_> = file.people.iter().enumerate().map(person).collect();
        let mut scene = Self {
            rate_hz: file.rate_hz,
            seconds: file.seconds,
            planned_s: file.seconds,
            seed: file.seed,
            size_m: file.size_m,
            rig,
            people,
            plan,
            ball: None,
            faults: file.faults,
        };
        scene.ball = file.ball.then(|| Ball::new(&scene));
        Ok(scene)
    }

    /// Ticks per second.
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Length, seconds.
    pub fn seconds(&self) -> f64 {
        self.seconds
    }

    /// All ticks, from 0.
    pub fn ticks(&self) -> Range<Tick> {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "at most a few hundred thousand"
        )]
        let n = (self.seconds * self.rate_hz).round() as i64;
        Tick(0)..Tick(n)
    }

    /// When tick `tick` is, seconds.
    pub fn time_s(&self, tick: Tick) -> f64 {
        tick.seconds(self.rate_hz)
    }

    /// Seed of every draw.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Field, x by y, centred on the origin, floor at z = 0, metres.
    pub fn size_m(&self) -> [f64; 2] {
        self.size_m
    }

    /// The box that people are tracked in, as in a venue's `[field]`: least and greatest corner,
    /// metres. It is a little larger than the field, since limbs reach over its edge.
    pub fn field_bounds_m(&self) -> [[f64; 3]; 2] {
        let [x, y] = self.size_m.map(|size_m| size_m / 2.0 + FIELD_MARGIN_M);
        [[-x, -y, FIELD_BOTTOM_M], [x, y, FIELD_TOP_M]]
    }

    /// Places with cameras, in the order of their cameras.
    pub fn viewpoints(&self) -> &[SceneViewpoint] {
        &self.rig.viewpoints
    }

    /// All cameras, counted through the viewpoints in their order.
    pub fn cameras(&self) -> &[CameraModel] {
        &self.rig.cameras
    }

    /// Everybody, in the order of the file.
    pub fn people(&self) -> &[ScenePerson] {
        &self.people
    }

    /// The faults of maps that are made without pixels.
    pub fn faults(&self) -> &FaultProfile {
        &self.faults
    }

    /// Whether the `person`-th is in the scene at `time_s`.
    pub fn is_there(&self, person: usize, time_s: f64) -> bool {
        let there = |who: &ScenePerson| {
            let entered = who.enter_s <= 0.0 || time_s >= who.enter_s;
            let left = who.leave_s < self.planned_s && time_s >= who.leave_s;
            entered && !left
        };
        self.people.get(person).is_some_and(there)
    }

    /// The `person`-th (of [`Scene::people`]) at `time_s`; `None` before it enters and once it has
    /// left, and for a person that is not there. A pure function.
    pub fn person_at(&self, person: usize, time_s: f64) -> Option<PersonTruth> {
        if !self.is_there(person, time_s) {
            return None;
        }
        let who = &self.people[person];
        let joints_m = self.plan.joints_m(person, time_s);
        let length_m = self.faults.definition.map_or(0.0, |fault| fault.offset_m);
        Some(PersonTruth::new(&joints_m, &who.definition, length_m))
    }

    /// The centre of the ball at `time_s`, metres; `None` without one. A pure function.
    pub fn ball_at(&self, time_s: f64) -> Option<Vector3<f64>> {
        self.ball.as_ref().map(|ball| ball.at(time_s))
    }

    /// The same scene with other faults.
    #[must_use]
    pub fn with_faults(self, faults: FaultProfile) -> Self {
        Self { faults, ..self }
    }

    /// The same scene, with as many ticks a second as said (1 to 1000, else it is left as it is).
    #[must_use]
    pub fn with_rate(self, rate_hz: f64) -> Self {
        if (1.0..=1000.0).contains(&rate_hz) {
            Self { rate_hz, ..self }
        } else {
            self
        }
    }

    /// The first `seconds` of the same scene, or all of it when it is shorter.
    #[must_use]
    pub fn shortened(self, seconds: f64) -> Self {
        let seconds = seconds.max(0.0).min(self.seconds);
        Self { seconds, ..self }
    }
}

/// The text of a file.
fn read(path: &Path) -> Result<String, FileError> {
    fs::read_to_string(path).map_err(|e| FileError::new(path, format!("cannot be read: {e}")))
}

/// The cameras of a scene.
fn mount(file: &SceneFile, toml: &TomlFile<'_>) -> Result<Rig, FileError> {
    let (calibration, viewpoints) = match &file.cameras {
        CameraSource::Generated(wanted) => {
            return cameras::generate(wanted, file.size_m, file.seed)
                .map_err(|problem| toml.error(&Place::field("cameras"), problem));
        }
        CameraSource::Calibrated {
            calibration,
            viewpoints,
        } => (calibration, viewpoints),
    };
    let calibration = Calibration::parse(&read(calibration)?, calibration)?;
    let mut rig = Rig::default();
    for (i, (name, cameras)) in viewpoints.iter().enumerate() {
        let first = rig.cameras.len();
        for (j, camera) in cameras.iter().enumerate() {
            let Some(model) = calibration.cameras.get(camera) else {
                let known: Vec<&str> = calibration.cameras.keys().map(String::as_str).collect();
                let place = Place::field("viewpoint").index(i).key("camera").index(j);
                return Err(toml.error(&place.key("name"), unknown_name("camera", camera, &known)));
            };
            rig.cameras.push(model.clone());
        }
        rig.viewpoints.push(SceneViewpoint {
            name: name.clone(),
            cameras: (first..rig.cameras.len()).collect(),
        });
    }
    Ok(rig)
}

/// The clips of every person, each file once.
fn clips_of(
    file: &SceneFile,
    load: &mut dyn FnMut(&Path) -> Result<Arc<Clip>, FileError>,
) -> Result<Vec<Vec<Arc<Clip>>>, FileError> {
    let mut loaded: BTreeMap<&PathBuf, Arc<Clip>> = BTreeMap::new();
    let mut all = Vec::with_capacity(file.people.len());
    for person in &file.people {
        let mut clips = Vec::with_capacity(person.clips.len());
        for path in &person.clips {
            let clip = match loaded.get(path) {
                Some(clip) => clip.clone(),
                None => loaded.entry(path).or_insert(load(path)?).clone(),
            };
            clips.push(clip);
        }
        all.push(clips);
    }
    Ok(all)
}

/// The numbers of people in truth files.
fn numbers_of(file: &SceneFile) -> Vec<u32> {
    let written: Option<Vec<u32>> = file
        .people
        .iter()
        .map(|person| person.name.parse().ok().filter(|n| *n > 0))
        .collect();
    let counted = || (1..).take(file.people.len()).collect();
    // "1" and "01" are two names, and one number.
    let distinct = |numbers: &Vec<u32>| {
        let unique: std::collections::BTreeSet<_> = numbers.iter().collect();
        unique.len() == numbers.len()
    };
    written.filter(distinct).unwrap_or_else(counted)
}

#[cfg(test)]
mod tests;
