//! Requirements on the project's own scenes: each runs for its full length, with plausible motion.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use rayon::prelude::*;

use super::*;
use crate::scene::KEEP_M;

/// Fastest point, metres per second: a sprinter's swing foot has nearly twice his speed, plus the
/// turn in a corner.
const FASTEST_M_S: f64 = 20.0;
/// Allowed shortfall of the pelvis distance, metres: distances are planned on samples.
const NEAR_TOLERANCE_M: f64 = 0.02;
/// Scenes with intended contact.
const IN_CONTACT: [&str; 4] = ["cross", "hug", "long-hug", "scrum"];
/// Scenes in which people enter or leave.
const COMING_OR_GOING: [&str; 3] = ["enter", "return", "side-by-side"];

/// The joints of all people at every tick of a scene, metres.
struct Run {
    name: &'static str,
    scene: Scene,
    ticks: Vec<Vec<Option<Joints>>>,
}

impl Run {
    fn load(name: &'static str) -> Self {
        let scene = scene(name).unwrap();
        let n = (scene.seconds() * scene.rate_hz()).round() as u32;
        let at = |tick: u32| -> Vec<Option<Joints>> {
            let time_s = f64::from(tick) / scene.rate_hz();
            let joints = |person| Some(scene.person_at(person, time_s)?.joints_m);
            (0..scene.people().len()).map(joints).collect()
        };
        let ticks = (0..n).into_par_iter().map(at).collect();
        Self { name, scene, ticks }
    }

    /// All ticks of one person, in order.
    fn person(&self, person: usize) -> impl Iterator<Item = Option<&Joints>> {
        self.ticks.iter().map(move |tick| tick[person].as_ref())
    }

    fn people(&self) -> std::ops::Range<usize> {
        0..self.scene.people().len()
    }
}

/// All scenes, computed once for all tests.
static RUNS: LazyLock<Vec<Run>> =
    LazyLock::new(|| SCENES.iter().map(|(name, _)| Run::load(name)).collect());

fn pelvis(joints: &Joints) -> nalgebra::Vector2<f64> {
    joints[Joint::Pelvis.index()].xy()
}

#[test]
fn every_scene_starts_with_its_purpose() {
    for (name, text) in SCENES {
        assert!(text.starts_with("# "), "{name}");
    }
}

#[test]
fn an_unknown_scene_is_refused_with_the_embedded_names() {
    let error = scene("cuort").unwrap_err().to_string();
    assert!(
        error.contains("court") && error.contains("cuort"),
        "{error}"
    );
}

#[test]
fn people_move_through_every_scene_without_jumps() {
    for run in RUNS.iter() {
        for person in run.people() {
            let all: Vec<_> = run.person(person).collect();
            assert!(
                all.iter().any(Option::is_some),
                "{}: {person} never comes",
                run.name
            );
            for (tick, pair) in all.windows(2).enumerate() {
                let [Some(before), Some(after)] = *pair else {
                    continue;
                };
                for joint in Joint::ALL {
                    let way_m = after[joint.index()] - before[joint.index()];
                    let speed = way_m.norm() * run.scene.rate_hz();
                    assert!(
                        speed < FASTEST_M_S,
                        "{}, person {person}, tick {tick}: {joint:?} at {speed:.1} m/s",
                        run.name
                    );
                }
            }
        }
    }
}

#[test]
fn people_keep_their_distance_unless_contact_is_intended() {
    for run in RUNS.iter().filter(|run| !IN_CONTACT.contains(&run.name)) {
        for (tick, people) in run.ticks.iter().enumerate() {
            let pelvises: Vec<_> = people.iter().flatten().map(pelvis).collect();
            for (i, a) in pelvises.iter().enumerate() {
                for b in &pelvises[..i] {
                    let apart_m = (a - b).norm();
                    let near = apart_m < KEEP_M - NEAR_TOLERANCE_M;
                    assert!(!near, "{}, tick {tick}: {apart_m} m", run.name);
                }
            }
        }
    }
}

#[test]
fn people_are_in_the_field_unless_they_enter_or_leave() {
    let stay = |run: &&Run| !COMING_OR_GOING.contains(&run.name);
    for run in RUNS.iter().filter(stay) {
        let [width_m, depth_m] = run.scene.size_m();
        for (tick, people) in run.ticks.iter().enumerate() {
            for at in people.iter().flatten().map(pelvis) {
                let inside = at.x.abs() < width_m / 2.0 && at.y.abs() < depth_m / 2.0;
                assert!(inside, "{}, tick {tick}: {at:?}", run.name);
            }
        }
    }
}

#[test]
fn people_stand_on_a_stage_and_its_field_is_above_it() {
    let stage = RUNS.iter().find(|run| run.name == "stage").unwrap();
    let floor_m = stage.scene.floor_m();
    let lowest_m = |joints: &Joints| joints.iter().map(|joint| joint.z).fold(f64::MAX, f64::min);
    for joints in stage.ticks.iter().flatten().flatten() {
        assert!(lowest_m(joints) > floor_m - 0.1, "{}", lowest_m(joints));
    }
    let first: Vec<f64> = stage.ticks[0].iter().flatten().map(lowest_m).collect();
    assert!(
        first.iter().all(|low_m| *low_m < floor_m + 0.2),
        "{first:?}"
    );
    let [min_m, max_m] = stage.scene.field_bounds_m();
    assert!(min_m[2] < floor_m && floor_m + 2.0 < max_m[2]);
}

#[test]
fn cartwheels_turn_people_upside_down() {
    for run in RUNS.iter().filter(|run| run.name.ends_with("inverted")) {
        let inverted =
            |joints: &&Joints| joints[Joint::Pelvis.index()].z > joints[Joint::Head.index()].z;
        let most = run
            .people()
            .map(|person| run.person(person).flatten().filter(inverted).count())
            .max();
        let share = most.unwrap() as f64 / run.ticks.len() as f64;
        assert!(share > 0.04, "{}: {share} of the time", run.name);
    }
}

#[test]
fn a_scene_written_to_a_folder_equals_the_embedded_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = write_scene("court", folder.path()).unwrap();
    let (written, carried) = (Scene::load(&path).unwrap(), scene("court").unwrap());
    for person in 0..carried.people().len() {
        let at = |scene: &Scene| scene.person_at(person, 7.3).unwrap().joints_m;
        assert_eq!(at(&written), at(&carried));
    }
    let clips = fs::read_dir(folder.path().join("clips")).unwrap();
    let clips: BTreeSet<_> = clips.map(|e| e.unwrap().file_name()).collect();
    let has = |name: &str| clips.contains(std::ffi::OsStr::new(name));
    assert!(has("kick.bvh") && !has("punch.bvh"));
}
