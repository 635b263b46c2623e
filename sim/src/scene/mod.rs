//! A scene: people, cameras and a ball, whose truth is a pure function of time.
//!
//! [`Scene::load`] reads a scene file ([`mod@file`]), its motion clips and its cameras, and plans
//! the paths of all people. After that the scene has no state and draws no random numbers. It
//! returns the same truth ([`truth`]) for a time in any order of calls, in some ten microseconds
//! per person.

mod ball;
mod cameras;
pub mod file;
mod load;
mod mirror;
mod plan;
mod poster;
pub mod range_of_motion;
mod sight;
pub mod truth;
pub mod write;

use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::{FileError, TomlFile};
use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

pub use self::ball::BALL_RADIUS_M;
use self::ball::Ball;
use self::cameras::CameraRig;
use self::file::SceneFile;
use self::load::{Clips, load_posters, mount, read, truth_numbers};
pub use self::mirror::Mirror;
use self::plan::ScenePlan;
pub use self::plan::{EDGE_M, KEEP_M};
pub use self::poster::Poster;
use self::sight::Sight;
pub use self::sight::{LostInterval, ViewpointMask};
use self::truth::DefinitionOffsets;
pub use self::truth::{N_SITES, PersonTruth, SITE_JOINTS};
use crate::fault_profile::FaultProfile;
use crate::motion::Clip;

/// Height of the tracked field above its floor, metres: a raised hand in a jump.
const FIELD_TOP_M: f64 = 2.8;
/// Lower end of the tracked field relative to the floor, metres: a foot is never exactly on it.
const FIELD_BOTTOM_M: f64 = -0.3;
/// Margin of the tracked field around the scene's field, metres: limbs of a person at the edge.
const FIELD_MARGIN_M: f64 = 0.5;

/// A place with cameras on one machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SceneViewpoint {
    /// Its name.
    pub name: String,
    /// Indices of its cameras in [`Scene::cameras`].
    pub cameras: Vec<usize>,
}

/// A person of the scene.
#[derive(Debug, Clone, PartialEq)]
pub struct ScenePerson {
    /// Name in the scene file.
    pub name: String,
    /// Number in truth files, from 1: the name if all names are numbers, else the position in the
    /// file.
    pub number: u32,
    /// Stature, metres.
    pub stature_m: f64,
    /// The group whose clips' coordinate frame it shares, if any.
    pub group: Option<String>,
    /// Seed of shape, skin and clothes.
    pub build_seed: u64,
    /// First appearance, seconds. A person present from the start also exists before it.
    pub enter_s: f64,
    /// End of the presence, seconds. A person present at the end also exists after it.
    pub leave_s: f64,
    definition: DefinitionOffsets,
}

/// People, cameras and a ball; see the module documentation.
#[derive(Debug)]
pub struct Scene {
    rate_hz: f64,
    seconds: f64,
    planned_s: f64,
    seed: u64,
    size_m: [f64; 2],
    floor_m: f64,
    rig: CameraRig,
    people: Vec<ScenePerson>,
    plan: ScenePlan,
    mirrors: Vec<Mirror>,
    posters: Vec<Poster>,
    sight: Sight,
    ball: Option<Ball>,
    faults: FaultProfile,
}

impl Scene {
    /// Reads the scene file at `path`, its clips and its calibration.
    ///
    /// # Errors
    /// [`FileError`] with file, line and field. The file is the calibration, or the scene, also for
    /// an unusable clip.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let text = read(path)?;
        Self::parse(&text, path, &mut |clip| Ok(Arc::new(Clip::load(clip)?)))
    }

    /// Parses a scene. Paths in `text` are relative to `path`. `clips` loads the motion clip of a
    /// path; it is called once per clip. A calibration is read from its file.
    ///
    /// # Errors
    /// As [`Scene::load`]; an error of `clips` names the field of the clip.
    pub fn parse(
        text: &str,
        path: &Path,
        clips: &mut dyn FnMut(&Path) -> Result<Arc<Clip>, FileError>,
    ) -> Result<Self, FileError> {
        let file = SceneFile::parse(text, path)?;
        let toml = TomlFile::parse(text, path)?;
        let rig = mount(&file, &toml)?;
        let sight = Sight::new(&file, &rig.viewpoints, &toml)?;
        let mut clips = Clips::new(clips);
        let posters = load_posters(&file, &toml, &mut clips)?;
        let clips = clips.for_people(&file, &toml)?;
        let plan = ScenePlan::new(&file, &clips);
        let numbers = truth_numbers(&file);
        let statures_m = ScenePlan::statures_m(&file, &clips);
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
            floor_m: file.floor_m,
            rig,
            people,
            plan,
            mirrors: file.mirrors.iter().map(Mirror::new).collect(),
            posters,
            sight,
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

    /// Time of tick `tick`, seconds.
    pub fn time_s(&self, tick: Tick) -> f64 {
        tick.seconds(self.rate_hz)
    }

    /// Seed of every draw.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Size of the field, x by y, centred on the origin, metres.
    pub fn size_m(&self) -> [f64; 2] {
        self.size_m
    }

    /// Height of the floor under the people above the ground, metres.
    pub fn floor_m(&self) -> f64 {
        self.floor_m
    }

    /// The tracked box, as in a venue's `[field]`: minimum and maximum corner, metres. It is larger
    /// than the field, because limbs extend over its edge.
    pub fn field_bounds_m(&self) -> [[f64; 3]; 2] {
        let [x, y] = self.size_m.map(|size_m| size_m / 2.0 + FIELD_MARGIN_M);
        let z = [FIELD_BOTTOM_M, FIELD_TOP_M].map(|height_m| self.floor_m + height_m);
        [[-x, -y, z[0]], [x, y, z[1]]]
    }

    /// Places with cameras, in the order of their cameras.
    pub fn viewpoints(&self) -> &[SceneViewpoint] {
        &self.rig.viewpoints
    }

    /// All cameras, in the order of the viewpoints.
    pub fn cameras(&self) -> &[CameraModel] {
        &self.rig.cameras
    }

    /// All people, in the order of the file.
    pub fn people(&self) -> &[ScenePerson] {
        &self.people
    }

    /// The mirrors.
    pub fn mirrors(&self) -> &[Mirror] {
        &self.mirrors
    }

    /// The posters.
    pub fn posters(&self) -> &[Poster] {
        &self.posters
    }

    /// The intervals in which people are hidden from viewpoints.
    pub fn lost(&self) -> &[LostInterval] {
        &self.sight.lost
    }

    /// The viewpoints whose cameras show `person` at `time_s`, unless something blocks the view.
    pub fn seen_by(&self, person: usize, time_s: f64) -> ViewpointMask {
        self.sight.seen_by(person, time_s)
    }

    /// Whether the truth contains `person`: not if only one viewpoint sees the person.
    pub fn is_in_truth(&self, person: usize) -> bool {
        self.sight.can_be_found(person)
    }

    /// The faults of maps made without pixels.
    pub fn faults(&self) -> &FaultProfile {
        &self.faults
    }

    /// Whether `person` is in the scene at `time_s`.
    pub fn is_there(&self, person: usize, time_s: f64) -> bool {
        let there = |person: &ScenePerson| {
            let entered = person.enter_s <= 0.0 || time_s >= person.enter_s;
            let left = person.leave_s < self.planned_s && time_s >= person.leave_s;
            entered && !left
        };
        self.people.get(person).is_some_and(there)
    }

    /// The truth of `person` (an index into [`Scene::people`]) at `time_s`. `None` while the person
    /// is absent, or for an unknown index. A pure function.
    pub fn person_at(&self, person: usize, time_s: f64) -> Option<PersonTruth> {
        if !self.is_there(person, time_s) {
            return None;
        }
        let entry = &self.people[person];
        let mut joints_m = self.plan.joints_m(person, time_s);
        for joint_m in &mut joints_m {
            joint_m.z += self.floor_m;
        }
        let length_m = self.faults.definition.map_or(0.0, |fault| fault.offset_m);
        Some(PersonTruth::new(&joints_m, &entry.definition, length_m))
    }

    /// As [`Self::person_at`] at the time of `tick`, without people that are not in the truth
    /// ([`Self::is_in_truth`]).
    pub fn truth_at(&self, person: usize, tick: Tick) -> Option<PersonTruth> {
        let counts = self.is_in_truth(person);
        counts.then(|| self.person_at(person, self.time_s(tick)))?
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

    /// The same scene at another rate; a rate outside 1 to 1000 has no effect.
    #[must_use]
    pub fn with_rate(self, rate_hz: f64) -> Self {
        if (1.0..=1000.0).contains(&rate_hz) {
            Self { rate_hz, ..self }
        } else {
            self
        }
    }

    /// The first `seconds` of the scene, or all of it if it is shorter.
    #[must_use]
    pub fn shortened(self, seconds: f64) -> Self {
        let seconds = seconds.max(0.0).min(self.seconds);
        Self { seconds, ..self }
    }
}

/// The purpose of a draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Purpose {
    /// Lenses of generated cameras.
    Cameras = 1,
    /// The network's own definition of hips and knees.
    Definition = 2,
    /// The receivers of the ball.
    Ball = 3,
    /// Shape and clothes of a person.
    Build = 4,
}

/// The stream of `purpose` for item `index`.
fn draws(seed: u64, purpose: Purpose, index: usize) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(((purpose as u64) << 32) | index as u64);
    rng
}

#[cfg(test)]
mod tests;
