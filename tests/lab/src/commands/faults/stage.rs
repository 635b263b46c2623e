//! A live venue for one drive, and what is heard of it.

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

use super::field::Field;
use super::table::Measure;
use crate::live_venue::{LiveVenue, PoseLog, SeenVenue, VenueWatch};
use crate::namespaces::Namespaces;

/// How far poses may be from the truth on average, millimetres.
pub(super) const MOST_MM: f64 = 25.0;
/// Far above what a loaded machine takes for anything that is waited for.
const PATIENCE: Duration = Duration::from_mins(1);
/// Between two looks.
const PAUSE: Duration = Duration::from_millis(10);
/// What a venue gets before anything happens to it, seconds: links are measured, bodies begin to be.
const SETTLE_S: f64 = 2.0;

/// The venue of a drive.
pub(super) struct Stage<'a> {
    pub(super) field: &'a Field,
    pub(super) live: LiveVenue,
    folder: PathBuf,
    heard: Option<(VenueWatch, PoseLog)>,
}

impl<'a> Stage<'a> {
    /// The venue without any node.
    pub(super) fn prepare(field: &'a Field, name: &str) -> anyhow::Result<Self> {
        let n = farfield_node::files::load_venue(&field.maps.venue)?
            .viewpoints
            .len();
        let namespaces = Namespaces::make(n).ok();
        Ok(Self {
            live: LiveVenue::prepare(&field.maps.program, &field.maps.venue, namespaces)?,
            field,
            folder: field.folder(name)?,
            heard: None,
        })
    }

    /// The venue at work, with more arguments of fusion.
    pub(super) fn open(field: &'a Field, name: &str, more: &[&str]) -> anyhow::Result<Self> {
        let mut stage = Self::prepare(field, name)?;
        let out = stage.out("first");
        stage.begin(&out, more)?;
        Ok(stage)
    }

    /// Starts every node that does not run, waits until everybody is tracked, and lets them settle.
    pub(super) fn begin(&mut self, out: &Path, more: &[&str]) -> anyhow::Result<()> {
        self.live.start_fusion(out, more)?;
        let watch = self.live.watch()?;
        let log = PoseLog::listen(&watch)?;
        self.heard = Some((watch, log));
        self.live.start_edges()?;
        self.wait_for_everybody()?;
        self.go_on(SETTLE_S);
        Ok(())
    }

    /// Where a life of fusion leaves its results.
    pub(super) fn out(&self, life: &str) -> PathBuf {
        self.folder.join(life)
    }

    pub(super) fn watch(&self) -> anyhow::Result<&VenueWatch> {
        let (watch, _) = self.heard.as_ref().context("fusion was not started")?;
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

    /// Waits until something is so; how long that took.
    pub(super) fn wait(
        &self,
        what: &str,
        is_so: impl Fn(&SeenVenue) -> bool,
    ) -> anyhow::Result<Duration> {
        let from = clock::now();
        loop {
            let took = clock::now().duration_since(from);
            if is_so(&*self.seen()?) {
                return Ok(took);
            }
            if took > PATIENCE {
                bail!("{what}: not within {PATIENCE:?}\n{}", self.live.output());
            }
            thread::sleep(PAUSE);
        }
    }

    /// Waits until everybody is tracked; how long that took.
    pub(super) fn wait_for_everybody(&self) -> anyhow::Result<Duration> {
        let people = self.field.truth.people();
        self.wait("everybody is tracked", |seen| seen.tracked() == people)
    }

    /// Lets `seconds` pass.
    #[expect(clippy::unused_self, reason = "it is this venue that goes on")]
    pub(super) fn go_on(&self, seconds: f64) {
        thread::sleep(Duration::from_secs_f64(seconds));
    }

    /// How far the poses of a tick are from the truth on average, millimetres; `None` while a person has none.
    pub(super) fn mean_mm_at(&self, tick: Tick) -> Option<f64> {
        let (_, log) = self.heard.as_ref()?;
        let rate_hz = self.live.venue().rate_hz;
        let scores = log.score(&self.field.truth, &(tick..tick + 1), rate_hz);
        let is_whole = scores.actors.values().all(|actor| actor.gaps == 0);
        scores.mean.mpjpe_mm.filter(|_| is_whole)
    }

    /// Which person of the truth has which id at the newest tick.
    pub(super) fn who_is_who(&self) -> anyhow::Result<BTreeMap<u32, u32>> {
        let (_, log) = self.heard.as_ref().context("fusion was not started")?;
        Ok(log.who_is_who(&self.field.truth, self.tick()?))
    }

    /// What was heard of people since tick `from`.
    pub(super) fn people_since(&self, from: Tick) -> anyhow::Result<Vec<Measure>> {
        self.people_within(from, MOST_MM)
    }

    /// The same, with another bar for how far poses may be from the truth on average, millimetres.
    pub(super) fn people_within(&self, from: Tick, most_mm: f64) -> anyhow::Result<Vec<Measure>> {
        let (_, log) = self.heard.as_ref().context("fusion was not started")?;
        let rate_hz = self.live.venue().rate_hz;
        let scores = log.score(&self.field.truth, &(from..self.tick()?), rate_hz);
        let (mut gaps, mut frames) = (0, 0);
        for actor in scores.actors.values() {
            gaps += actor.gaps;
            frames += actor.frames;
        }
        Ok(vec![
            Measure::barred(
                "mean distance, mm",
                scores.mean.mpjpe_mm.unwrap_or(f64::NAN),
                most_mm,
            ),
            Measure::barred("id switches", scores.identity.switches as f64, 0.0),
            Measure::told(
                "people and ticks without a pose, %",
                100.0 * gaps as f64 / frames.max(1) as f64,
            ),
        ])
    }

    /// Asks fusion to end, and waits for it.
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

/// How fusion says that it hears an edge.
pub(super) fn heard<'s>(seen: &'s SeenVenue, viewpoint: &str) -> Option<&'s EdgeLink> {
    let edges = &seen.live(FUSION)?.edges;
    edges.iter().find(|edge| edge.viewpoint == viewpoint)
}
