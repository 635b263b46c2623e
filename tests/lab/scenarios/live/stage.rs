//! A small live venue with two people who walk without end, its nodes, and an observer.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, MutexGuard};
use std::time::Duration;

use farfield_lab::live_venue::{LiveVenue, NodeProcess, SeenVenue, VenueWatch, Vitals};
use farfield_proto::camera::CameraModel;
use farfield_proto::message::live::EdgeLink;
use farfield_proto::tick::Tick;
use farfield_sim::embedded::CLIPS;
use farfield_sim::faults::SceneCrowd;
use farfield_sim::maps_file::{CameraFailure, Course, write_maps};
use farfield_sim::motion::Clip;
use farfield_sim::scene::Scene;
use farfield_sim::scene::write::calibration_text;
use farfield_sim::simulated::VenueText;
use tempfile::TempDir;

/// Number of people.
pub(super) const PEOPLE: usize = 2;
/// Ticks per second.
pub(super) const RATE_HZ: f64 = 30.0;
/// Far above what a loaded machine takes for anything that a test waits for.
const PATIENCE: Duration = Duration::from_secs(90);
/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(20);

const SCENE: &str = r#"
rate_hz = 30.0
seconds = 8.0
seed = 5
size_m = [8.0, 6.0]
[cameras]
viewpoints = 4
per_viewpoint = 2
height_m = 3.0
setback_m = 1.5
size_px = [960, 600]
[faults]
profile = "standard"
[[person]]
name = "1"
clips = ["walk.bvh"]
at_m = [-2.0, -1.5]
heading_rad = 0.0
height_m = 1.72
path = { points_m = [[-2.0, -1.5], [2.0, -1.5], [2.0, -1.0], [-2.0, -1.0]], speed_m_s = 1.2 }
[[person]]
name = "2"
clips = ["walk.bvh"]
at_m = [2.0, 1.5]
heading_rad = 3.14
height_m = 1.84
path = { points_m = [[2.0, 1.5], [-2.0, 1.5], [-2.0, 1.0], [2.0, 1.0]], speed_m_s = 1.2 }
"#;

/// A venue, its nodes and their observer.
pub(super) struct LiveStage {
    pub(super) live: LiveVenue,
    /// `None` until fusion has started.
    watch: Option<VenueWatch>,
    pub(super) folder: TempDir,
}

/// Memory, threads and handles of every node.
pub(super) struct Resources(Vec<(String, Vitals)>);

impl LiveStage {
    /// The venue without nodes; `failures` by index of the camera in the scene.
    pub(super) fn prepare(failures: &[(usize, CameraFailure)], parameters: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let venue = write_venue(folder.path(), failures, parameters);
        let program = Path::new(env!("CARGO_BIN_EXE_lab"));
        let live = LiveVenue::prepare(program, &venue, None).unwrap();
        Self {
            live,
            watch: None,
            folder,
        }
    }

    /// The venue with all nodes running and all people tracked.
    pub(super) fn open() -> Self {
        let mut stage = Self::prepare(&[], "");
        stage.start();
        stage
    }

    /// Starts every node, and waits until all people are tracked.
    pub(super) fn start(&mut self) {
        let out = self.out("first");
        self.start_with(&out, &[]);
    }

    /// [`Self::start`] with more arguments for fusion and its results in `out`.
    pub(super) fn start_with(&mut self, out: &Path, more: &[&str]) {
        self.live.start_fusion(out, more).unwrap();
        self.watch = Some(self.live.watch().unwrap());
        self.live.start_edges().unwrap();
        self.wait("all people are tracked", |seen| seen.tracked() == PEOPLE);
    }

    /// The messages observed so far.
    pub(super) fn seen(&self) -> MutexGuard<'_, SeenVenue> {
        self.watch().seen()
    }

    pub(super) fn watch(&self) -> &VenueWatch {
        self.watch.as_ref().unwrap()
    }

    /// Folder of the results of a run.
    pub(super) fn out(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Waits until a condition holds.
    pub(super) fn wait(&self, what: &str, condition: impl Fn(&SeenVenue) -> bool) {
        for _ in 0..PATIENCE.as_millis() / PAUSE.as_millis() {
            if condition(&self.seen()) {
                return;
            }
            std::thread::sleep(PAUSE);
        }
        let seen = self.seen().clone();
        panic!(
            "{what}: not within {PATIENCE:?}\nfusion: {:?}\nnewest poses: {:?}\n{}",
            seen.statuses.get("fusion"),
            seen.newest.map(|set| (set.tick, set.persons.len())),
            self.live.output()
        );
    }

    /// Waits for the poses of so many seconds, until all people are in the last.
    pub(super) fn run_for(&self, seconds: f64) {
        let from = self.seen().poses;
        let more = (seconds * RATE_HZ) as u64;
        self.wait("poses go on", |seen| {
            seen.poses >= from + more && seen.tracked() == PEOPLE
        });
    }

    /// The ids in the newest poses.
    pub(super) fn ids(&self) -> BTreeSet<u32> {
        let seen = self.seen();
        let persons = seen.newest.iter().flat_map(|set| &set.persons);
        persons.map(|person| person.person.0).collect()
    }

    pub(super) fn resources(&self) -> Resources {
        let vitals = |node: &NodeProcess| Some((node.name().to_owned(), node.vitals()?));
        Resources(self.live.nodes().filter_map(vitals).collect())
    }

    /// Ends fusion and returns its folder of results.
    pub(super) fn finish(&mut self, name: &str) -> PathBuf {
        let fusion = self.live.fusion.as_mut().unwrap();
        fusion.close();
        let status = fusion.wait(PATIENCE).unwrap();
        assert!(
            status.is_some(),
            "fusion did not end\n{}",
            self.live.output()
        );
        self.out(name)
    }
}

impl Resources {
    /// Checks that nothing has grown: threads and handles up to short-lived ones, and memory up to the allocations of the
    /// first seconds.
    pub(super) fn assert_flat(&self, later: &Self) {
        for (name, now) in &later.0 {
            let Some((_, before)) = self.0.iter().find(|(known, _)| known == name) else {
                continue;
            };
            let what = format!("{name}: {before:?}, then {now:?}");
            assert!(now.threads <= before.threads + 2, "{what}");
            assert!(now.handles <= before.handles + 4, "{what}");
            let most = before.memory_bytes + before.memory_bytes / 4 + (16 << 20);
            assert!(now.memory_bytes <= most, "{what}");
        }
    }
}

/// Fusion's status of an edge.
pub(super) fn edge_link<'a>(seen: &'a SeenVenue, viewpoint: &str) -> Option<&'a EdgeLink> {
    let edges = &seen.live("fusion")?.edges;
    edges.iter().find(|edge| edge.viewpoint == viewpoint)
}

fn scene() -> Scene {
    let clip = |path: &Path| {
        let (name, text) = CLIPS[0];
        assert_eq!(path.file_stem().unwrap(), name);
        Ok(Arc::new(Clip::parse(text, path)?))
    };
    Scene::parse(SCENE, Path::new("scene.toml"), &mut { clip }).unwrap()
}

/// Writes a venue whose recordings repeat without end; returns its file.
pub(super) fn write_venue(
    folder: &Path,
    failures: &[(usize, CameraFailure)],
    parameters: &str,
) -> PathBuf {
    let scene = Arc::new(scene());
    let course = Course::new(&scene, &scene.ticks(), true);
    let crowd = Arc::new(SceneCrowd::new(Arc::clone(&scene)));
    let path = |camera: &CameraModel| format!("{}.maps", camera.name());
    for (i, camera) in scene.cameras().iter().enumerate() {
        let file = File::create(folder.join(path(camera))).unwrap();
        let mut file = BufWriter::new(file);
        let failure = failures.iter().find(|(of, _)| *of == i);
        let failure = failure.map(|(_, failure)| *failure);
        write_maps(&crowd, i, course, failure, &mut file, &|| true).unwrap();
        file.flush().unwrap();
    }
    let calibration = calibration_text(scene.cameras());
    fs::write(folder.join("calibration.toml"), calibration).unwrap();
    let source =
        |camera: &CameraModel| format!("{{ kind = \"maps\", path = \"{}\" }}", path(camera));
    let text = VenueText {
        scene: &scene,
        name: "stage",
        head: "",
        calibration: "calibration.toml",
        network: None,
        detector: None,
        source: &source,
        first_tick: Tick(0),
        given: None,
    };
    let venue = folder.join("venue.toml");
    fs::write(&venue, text.to_toml() + "\n" + parameters).unwrap();
    venue
}
