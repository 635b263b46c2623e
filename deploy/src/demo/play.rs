//! The scene of a demo, and its venue folder for the nodes.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow, ensure};
use farfield_edge::network::{BackendChoice, InferenceBackend};
use farfield_fusion::body::skeleton::Joints;
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::Tick;
use farfield_proto::venue::SimulatedContent;
use farfield_sim::embedded;
use farfield_sim::scene::Scene;
use farfield_sim::scene::file::{MAX_PERSON_SECONDS, MAX_TICKS};
use farfield_sim::simulated::{VenueText, quoted, without_map_faults};
use toml::{Table, Value};

use super::{DemoArgs, NAME};
use crate::venue_folder::{self, CALIBRATION};

/// The embedded scene of the demo.
const SCENE: &str = "court";

/// Length of one round of many, seconds: every process takes some time to plan it.
const ROUND_S: f64 = 300.0;

/// Origin of the scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SceneOrigin {
    /// The program; its clips are written next to it.
    Embedded,
    /// A file, with paths of its clips.
    File,
}

/// A checked scene, not yet written to disk.
#[derive(Clone)]
pub(super) struct DemoScript {
    /// The scene file, with the length of the demo.
    table: Table,
    origin: SceneOrigin,
    content: SimulatedContent,
    /// Whether the people are given by hand instead of detected in images.
    is_given: bool,
    ticks: u32,
    /// Whether no round follows.
    is_last: bool,
}

impl DemoScript {
    /// The scene that the arguments request.
    ///
    /// # Errors
    /// Names the scene file and the error in it.
    pub(super) fn choose(args: &DemoArgs) -> anyhow::Result<Self> {
        let (mut table, origin) = match &args.scene {
            Some(path) => (scene_of_file(path)?, SceneOrigin::File),
            None => (embedded_scene()?, SceneOrigin::Embedded),
        };
        let rate_hz = table.get("rate_hz").and_then(as_number);
        let rate_hz = rate_hz.context("the scene has no rate")?;
        let most = most_ticks(&table, rate_hz);
        let ticks = if args.is_endless() {
            most.min((ROUND_S * rate_hz).round() as u32)
        } else {
            args.ticks.unwrap_or_else(|| usual_ticks(args))
        };
        ensure!(
            ticks <= most,
            "`--ticks`: found {ticks}, expected at most {most}: a scene is planned in advance"
        );
        table.insert(
            "seconds".to_owned(),
            Value::from(f64::from(ticks) / rate_hz),
        );
        Ok(Self {
            table,
            origin,
            content: if args.uses_maps() {
                SimulatedContent::Maps
            } else {
                SimulatedContent::Pixels
            },
            is_given: args.given,
            ticks,
            is_last: !args.is_endless(),
        })
    }

    /// The same with another seed for every round.
    pub(super) fn for_round(&self, round: u32) -> Self {
        let mut script = self.clone();
        if let Some(Value::Integer(seed)) = script.table.get_mut("seed") {
            *seed = seed.saturating_add(i64::from(round) - 1);
        }
        script
    }
}

/// Number of ticks without `--ticks`: about a minute on two cores.
fn usual_ticks(args: &DemoArgs) -> u32 {
    let is_slow =
        || InferenceBackend::start(BackendChoice::Best).is_ok_and(InferenceBackend::is_tract);
    if !args.uses_maps() && is_slow() {
        150
    } else {
        300
    }
}

/// Longest scene with these people.
fn most_ticks(scene: &Table, rate_hz: f64) -> u32 {
    let people = scene.get("person").and_then(Value::as_array);
    let people = people.map_or(1, Vec::len).max(1) as f64;
    (MAX_PERSON_SECONDS / people * rate_hz)
        .min(MAX_TICKS)
        .floor() as u32
}

fn embedded_scene() -> anyhow::Result<Table> {
    let text = embedded::SCENES.iter().find(|(name, _)| *name == SCENE);
    let (_, text) = text.context("the program has no embedded demo scene")?;
    text.parse().context("reading the demo scene")
}

/// The scene of a file, with absolute paths.
fn scene_of_file(path: &Path) -> anyhow::Result<Table> {
    // Reports errors with line and field.
    Scene::load(path)?;
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    let mut table: Table = text.parse().with_context(|| path.display().to_string())?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let full = |name: &str| -> anyhow::Result<String> {
        let named = folder.join(name);
        let full = std::fs::canonicalize(&named).with_context(|| named.display().to_string())?;
        let full = full.into_os_string().into_string();
        full.map_err(|name| anyhow!("{}: found a name that is not UTF-8", name.display()))
    };
    each_clip(&mut table, full)?;
    if let Some(Value::String(calibration)) = table.get_mut("calibration") {
        *calibration = full(calibration)?;
    }
    Ok(table)
}

/// Renames every clip of the scene.
fn each_clip(
    scene: &mut Table,
    mut rename: impl FnMut(&str) -> anyhow::Result<String>,
) -> anyhow::Result<()> {
    let people = scene.get_mut("person").and_then(Value::as_array_mut);
    for person in people.into_iter().flatten() {
        let clips = person.get_mut("clips").and_then(Value::as_array_mut);
        for clip in clips.into_iter().flatten() {
            if let Value::String(name) = clip {
                *name = rename(name)?;
            }
        }
    }
    Ok(())
}

fn as_number(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|number| number as f64))
}

/// A demo whose venue is on disk.
pub(super) struct Play {
    pub(super) scene: Arc<Scene>,
    pub(super) ticks: u32,
    /// Whether no round follows.
    pub(super) is_last: bool,
    /// The venue file.
    pub(super) venue: PathBuf,
}

/// Removes a folder again unless it is kept.
#[must_use]
pub(super) struct Undo(Option<PathBuf>);

impl Undo {
    pub(super) fn keep(mut self) {
        self.0 = None;
    }
}

impl Drop for Undo {
    fn drop(&mut self) {
        if let Some(folder) = &self.0 {
            // If that fails, it stays in the results folder.
            drop(std::fs::remove_dir_all(folder));
        }
    }
}

impl Play {
    /// Writes the venue into `folder`, which must not exist.
    ///
    /// # Errors
    /// When a file cannot be written, or the written scene cannot be read.
    pub(super) fn stage(script: &DemoScript, folder: &Path) -> anyhow::Result<(Self, Undo)> {
        let undo = Undo(Some(folder.to_owned()));
        let scene_path = match script.origin {
            SceneOrigin::Embedded => embedded::write_scene(SCENE, folder)?,
            SceneOrigin::File => folder.join("scene.toml"),
        };
        let text = toml::to_string(&script.table).context("writing the scene")?;
        venue_folder::write(&scene_path, text.as_bytes())?;
        let scene = Scene::load(&scene_path)?;
        let is_pixels = script.content == SimulatedContent::Pixels;
        let scene = Arc::new(if is_pixels {
            without_map_faults(scene)
        } else {
            scene
        });
        venue_folder::write_calibration(&scene, folder)?;
        let network = is_pixels
            .then(|| venue_folder::write_network(folder))
            .transpose()?;
        // Maps contain sightings.
        let detector = (is_pixels && !script.is_given)
            .then(|| venue_folder::write_detector(folder))
            .transpose()?;
        let content = script.content.name();
        let path = scene_path.strip_prefix(folder).unwrap_or(&scene_path);
        let path = quoted(&path.display().to_string());
        let source = |_: &CameraModel| {
            format!("{{ kind = \"simulated\", path = {path}, content = \"{content}\" }}")
        };
        let text = VenueText {
            scene: &scene,
            name: NAME,
            head: "Written by `farfield demo`; also runs with `farfield run`.",
            calibration: CALIBRATION,
            network: network.as_deref(),
            detector: detector.as_deref(),
            source: &source,
            first_tick: Tick(0),
            given: script.is_given.then(|| scene.ticks()),
        };
        let venue = folder.join("venue.toml");
        venue_folder::write(&venue, text.to_toml().as_bytes())?;
        let play = Self {
            scene,
            ticks: script.ticks,
            is_last: script.is_last,
            venue,
        };
        Ok((play, undo))
    }

    /// The true joints of all people at `tick`, world, metres.
    pub(super) fn joints_at(&self, tick: Tick) -> Vec<Joints> {
        let people = 0..self.scene.people().len();
        let truth = people.filter_map(|person| self.scene.truth_at(person, tick));
        truth.map(|person| person.joints_m).collect()
    }
}
