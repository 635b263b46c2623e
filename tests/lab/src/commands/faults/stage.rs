//! A live venue for one fault, with its observer.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::MutexGuard;
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, bail};
use farfield_node::clock;
use farfield_proto::message::live::EdgeLink;
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use farfield_sim::embedded;

use super::table::Measure;
use crate::commands::scenes::{MadeMaps, make_maps};
use crate::live_venue::{LiveVenue, PoseLog, RepeatingTruth, SeenVenue, VenueWatch};
use crate::namespaces::Namespaces;

/// Largest mean error of poses, millimetres.
pub(super) const MAX_MEAN_MM: f64 = 25.0;
/// Far above what a loaded machine takes for anything that a fault waits for.
const PATIENCE: Duration = Duration::from_mins(1);
/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(10);
/// Time before a fault, seconds, for measurements of links and bodies.
const SETTLE_S: f64 = 2.0;

/// The venue of a fault.
pub(super) struct Stage<'a> {
    pub(super) field: &'a Field,
    pub(super) live: LiveVenue,
    folder: PathBuf,
    observer: Option<(VenueWatch, PoseLog)>,
}

impl<'a> Stage<'a> {
    /// The venue without nodes.
    pub(super) fn prepare(field: &'a Field, name: &str) -> anyhow::Result<Self> {
        let n = farfield_node::files::load_venue(&field.maps.venue)?
            .viewpoints
            .len();
        let namespaces = Namespaces::make(n).ok();
        Ok(Self {
            live: LiveVenue::prepare(&field.maps.program, &field.maps.venue, namespaces)?,
            field,
            folder: field.folder(name)?,
            observer: None,
        })
    }

    /// The venue with all nodes running; `more` arguments for fusion.
    pub(super) fn open(field: &'a Field, name: &str, more: &[&str]) -> anyhow::Result<Self> {
        let mut stage = Self::prepare(field, name)?;
        let out = stage.out("first");
        stage.begin(&out, more)?;
        Ok(stage)
    }

    /// Starts every node that does not run, and waits until all people are tracked and measured.
    pub(super) fn begin(&mut self, out: &Path, more: &[&str]) -> anyhow::Result<()> {
        self.live.start_fusion(out, more)?;
        let watch = self.live.watch()?;
        let log = PoseLog::subscribe(&watch)?;
        self.observer = Some((watch, log));
        self.live.start_edges()?;
        self.wait_for_people()?;
        self.run_for(SETTLE_S);
        Ok(())
    }

    /// Folder of results of one process of fusion.
    pub(super) fn out(&self, life: &str) -> PathBuf {
        self.folder.join(life)
    }

    pub(super) fn watch(&self) -> anyhow::Result<&VenueWatch> {
        let (watch, _) = self.observer.as_ref().context("fusion was not started")?;
        Ok(watch)
    }

    pub(super) fn seen(&self) -> anyhow::Result<MutexGuard<'_, SeenVenue>> {
        Ok(self.watch()?.seen())
    }

    /// The tick of the newest poses.
    pub(super) fn tick(&self) -> anyhow::Result<Tick> {
        let seen = self.seen()?;
        Ok(seen.newest.as_ref().context("no pose has come")?.tick)
    }

    /// Waits until a condition holds; returns the duration.
    pub(super) fn wait(
        &self,
        what: &str,
        condition: impl Fn(&SeenVenue) -> bool,
    ) -> anyhow::Result<Duration> {
        let from = clock::now();
        loop {
            let took = clock::now().duration_since(from);
            if condition(&*self.seen()?) {
                return Ok(took);
            }
            if took > PATIENCE {
                bail!("{what}: not within {PATIENCE:?}\n{}", self.live.output());
            }
            thread::sleep(PAUSE);
        }
    }

    /// Waits until all people are tracked; returns the duration.
    pub(super) fn wait_for_people(&self) -> anyhow::Result<Duration> {
        let people = self.field.truth.people();
        self.wait("all people are tracked", |seen| seen.tracked() == people)
    }

    /// Waits for `seconds`.
    #[expect(clippy::unused_self, reason = "it is this venue that goes on")]
    pub(super) fn run_for(&self, seconds: f64) {
        thread::sleep(Duration::from_secs_f64(seconds));
    }

    /// Mean error of the poses of a tick, millimetres; `None` if a person has none.
    pub(super) fn mean_mm_at(&self, tick: Tick) -> Option<f64> {
        let (_, log) = self.observer.as_ref()?;
        let rate_hz = self.live.venue().rate_hz;
        let scores = log.score(&self.field.truth, &(tick..tick + 1), rate_hz);
        let is_whole = scores.actors.values().all(|actor| actor.gaps == 0);
        scores.mean.mpjpe_mm.filter(|_| is_whole)
    }

    /// Ids by person of the truth at the newest tick.
    pub(super) fn ids_by_person(&self) -> anyhow::Result<BTreeMap<u32, u32>> {
        let (_, log) = self.observer.as_ref().context("fusion was not started")?;
        Ok(log.ids_by_person(&self.field.truth, self.tick()?))
    }

    /// Scores of the poses since tick `from`.
    pub(super) fn people_since(&self, from: Tick) -> anyhow::Result<Vec<Measure>> {
        self.people_within(from, MAX_MEAN_MM)
    }

    /// [`Self::people_since`] with another limit of the mean error, millimetres.
    pub(super) fn people_within(&self, from: Tick, most_mm: f64) -> anyhow::Result<Vec<Measure>> {
        let (_, log) = self.observer.as_ref().context("fusion was not started")?;
        let rate_hz = self.live.venue().rate_hz;
        let scores = log.score(&self.field.truth, &(from..self.tick()?), rate_hz);
        let (mut gaps, mut frames) = (0, 0);
        for actor in scores.actors.values() {
            gaps += actor.gaps;
            frames += actor.frames;
        }
        Ok(vec![
            Measure::limited(
                "mean distance, mm",
                scores.mean.mpjpe_mm.unwrap_or(f64::NAN),
                most_mm,
            ),
            Measure::limited("id switches", scores.identity.switches as f64, 0.0),
            Measure::reported(
                "people and ticks without a pose, %",
                100.0 * gaps as f64 / frames.max(1) as f64,
            ),
        ])
    }

    /// Ends fusion, and waits for it.
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        let fusion = self
            .live
            .fusion
            .as_mut()
            .context("fusion was not started")?;
        fusion.close();
        let ended = fusion.wait(PATIENCE)?;
        ended.with_context(|| format!("fusion does not end\n{}", self.live.output()))?;
        Ok(())
    }
}

/// Fusion's status of an edge.
pub(super) fn edge_link<'s>(seen: &'s SeenVenue, viewpoint: &str) -> Option<&'s EdgeLink> {
    let edges = &seen.live(FUSION)?.edges;
    edges.iter().find(|edge| edge.viewpoint == viewpoint)
}

/// Four people, each in a corner of their own.
const SCENE: &str = include_str!("walkers.toml");
/// Eight people who run across each other's paths at 1.2 to 3.6 m/s, one of them at 8.3 m/s.
const RUNNERS: &str = "futsal";
/// The person in that scene who is faster than 4 m/s.
pub(super) const SPRINTER: u32 = 8;
/// One camera per viewpoint is enough, and one machine plays all of them.
const ONE_CAMERA: [&str; 2] = ["per_viewpoint = 3", "per_viewpoint = 1"];

/// Maps and truth of a scene.
pub(super) struct Field {
    pub(super) maps: MadeMaps,
    pub(super) truth: RepeatingTruth,
    pub(super) is_quick: bool,
    folder: PathBuf,
    /// The runners, made on first use.
    runners: OnceCell<Box<Self>>,
}

impl Field {
    /// Makes the maps in `folder`.
    pub(super) fn make(folder: &Path, is_quick: bool) -> anyhow::Result<Self> {
        Self::of_scene(SCENE, "walkers", folder, is_quick)
    }

    /// The scene of eight people who run.
    pub(super) fn runners(&self) -> anyhow::Result<&Self> {
        if let Some(field) = self.runners.get() {
            return Ok(field);
        }
        let mut scenes = embedded::SCENES.iter();
        let scene = scenes.find(|(name, _)| *name == RUNNERS);
        let (_, text) = scene.context("the scene of the runners is embedded")?;
        let text = text.replace(ONE_CAMERA[0], ONE_CAMERA[1]);
        let folder = self.folder("runners")?;
        let field = Self::of_scene(&text, "runners", &folder, self.is_quick)?;
        Ok(self.runners.get_or_init(|| Box::new(field)))
    }

    fn of_scene(text: &str, name: &str, folder: &Path, is_quick: bool) -> anyhow::Result<Self> {
        let scene = embedded::write_scene_with_clips(text, name, folder)?;
        let maps = make_maps(Some(&scene), folder, &["--there-and-back"], "")?;
        Ok(Self {
            truth: RepeatingTruth::read(&maps.truth)?,
            maps,
            is_quick,
            folder: folder.to_owned(),
            runners: OnceCell::new(),
        })
    }

    /// Duration of an observation, seconds: `whole`, or `quick` with `--quick`.
    pub(super) fn whole_or_quick(&self, whole: f64, quick: f64) -> f64 {
        if self.is_quick { quick } else { whole }
    }

    /// A new folder of that name.
    pub(super) fn folder(&self, name: &str) -> std::io::Result<PathBuf> {
        let folder = self.folder.join("drives").join(name);
        std::fs::create_dir_all(&folder)?;
        Ok(folder)
    }
}
