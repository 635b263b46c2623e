//! The thread that computes: one tick after the other through the core, and the results to who writes them.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use farfield_node::clock;
use farfield_node::histogram::Histogram;
use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::message::naming::Naming;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet, StageTime};
use farfield_proto::tick::Tick;
use tokio::sync::mpsc;

use super::output::export_thread::ExportThread;
use super::output::exporter::Exported;
use super::session::mode::RunMode;
use crate::align::TickGroup;
use crate::camera_agreement::{AgreementReport, AgreementSamples};
use crate::identity::known::KnownPeople;
use crate::live::Micros;
use crate::pipeline::Pipeline;

/// How often it is judged live whether the cameras agree.
const AGREEMENT_EVERY: Duration = Duration::from_secs(10);

/// A tick to work on.
#[derive(Debug, Default)]
pub(super) struct Job {
    pub(super) group: TickGroup,
    /// Sets of earlier ticks that have come since.
    pub(super) late: Vec<PatchSet>,
    /// How many ticks ahead the boxes are made, by viewpoint; empty: as before.
    pub(super) horizons: Vec<f64>,
}

impl From<TickGroup> for Job {
    fn from(group: TickGroup) -> Self {
        Self {
            group,
            ..Self::default()
        }
    }
}

/// What a tick came to.
#[derive(Debug)]
pub(super) struct Stepped {
    /// The poses of the tick, as they look now.
    pub(super) poses: PoseSet,
    /// Ticks that the fixed-lag smoother is done with, as it sees them.
    pub(super) smoothed: Vec<PoseSet>,
    /// What changed who is who.
    pub(super) events: Vec<IdentityEvent>,
    pub(super) namings: Vec<Naming>,
    /// The boxes of the next tick, one set per viewpoint.
    pub(super) boxes: Vec<BoxSet>,
    /// Patches that were readable, but made no sense.
    pub(super) unusable: u32,
    /// How long the core's stages have taken so far, told once a second.
    pub(super) stages: Option<Vec<StageTime>>,
    /// Who is known, live, told once a second.
    pub(super) people: Option<KnownPeople>,
    /// What tells whether the cameras agree, live, told every ten seconds.
    pub(super) agreement: Option<AgreementSamples>,
    /// How many patches there were, and how long the step took, microseconds; `None` of a tick with a detection pass.
    pub(super) cost: Option<(usize, Micros)>,
}

/// What the thread leaves behind.
#[derive(Debug)]
pub(super) struct Finished {
    /// Who was there, and what the files lack.
    pub(super) exported: Exported,
    /// The last tick that went through the core.
    pub(super) last: Option<Tick>,
    /// How long it took.
    pub(super) stages: Vec<StageTime>,
    /// Whether the cameras agreed.
    pub(super) agreement: AgreementReport,
}

/// The loop's handle on the thread.
pub(super) struct FusionWorker {
    jobs: SyncSender<Job>,
    /// Results, in the order of the jobs; closed when the thread has ended.
    pub(super) done: mpsc::Receiver<Stepped>,
    thread: JoinHandle<anyhow::Result<Finished>>,
}

impl FusionWorker {
    /// Starts the thread. Where the files cannot be written it ends, unless the run is live: then the people are
    /// followed on.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn spawn(
        pipeline: Pipeline,
        exporter: ExportThread,
        mode: RunMode,
    ) -> std::io::Result<Self> {
        // There is one tick under way; the second place lets the loop never wait.
        let (jobs, to_do) = sync_channel(2);
        let (done_tx, done) = mpsc::channel(2);
        let thread = std::thread::Builder::new().name("core".to_owned());
        let thread = thread.spawn(move || {
            FusionWork {
                pipeline,
                exporter,
                mode,
                last: None,
                laps: Laps::default(),
                agreement_told: None,
            }
            .run(&to_do, &done_tx)
        })?;
        Ok(Self { jobs, done, thread })
    }

    /// Hands a complete tick over.
    ///
    /// # Errors
    /// When the thread has ended, or still has two ticks to do.
    pub(super) fn step(&self, job: impl Into<Job>) -> anyhow::Result<()> {
        self.jobs
            .try_send(job.into())
            .map_err(|error| anyhow!("the core does not take a tick: {error}"))
    }

    /// Lets the thread finish its files, and returns what it leaves behind.
    pub(super) async fn finish(self) -> anyhow::Result<Finished> {
        drop((self.jobs, self.done));
        let joined = tokio::task::spawn_blocking(move || self.thread.join())
            .await
            .context("waiting for the core")?;
        joined.map_err(|_| anyhow!("the core has panicked"))?
    }
}

/// Poses that do not change any more.
struct ToWrite {
    poses: Vec<PoseSet>,
    smoothed: Vec<PoseSet>,
}

/// What the thread owns.
struct FusionWork {
    pipeline: Pipeline,
    exporter: ExportThread,
    mode: RunMode,
    last: Option<Tick>,
    laps: Laps,
    agreement_told: Option<Instant>,
}

impl FusionWork {
    fn run(
        mut self,
        to_do: &Receiver<Job>,
        done: &mpsc::Sender<Stepped>,
    ) -> anyhow::Result<Finished> {
        while let Ok(job) = to_do.recv() {
            let (stepped, finished) = self.step(&job);
            // Who listens has left when the run was stopped; the files are finished all the same.
            let listening = done.blocking_send(stepped).is_ok();
            let start = clock::now();
            self.exporter.write(finished.poses, finished.smoothed);
            self.laps.lap("write", start);
            if !listening || self.mode == RunMode::LockStep && self.exporter.has_failed() {
                break;
            }
        }
        let Self {
            mut pipeline,
            exporter,
            last,
            laps,
            ..
        } = self;
        let exported = if last.is_none() {
            exporter.discard().map(|()| Exported::default())
        } else {
            exporter.finish(pipeline.finish(), pipeline.finish_smoothed())
        };
        // The files are whole before anything is judged.
        let exported = exported?;
        Ok(Finished {
            exported,
            last,
            stages: laps.times(),
            agreement: pipeline.agreement().report(),
        })
    }

    fn step(&mut self, job: &Job) -> (Stepped, ToWrite) {
        let start = clock::now();
        let mut lap_start = start;
        if !job.horizons.is_empty() {
            self.pipeline.set_horizons(&job.horizons);
        }
        for set in &job.late {
            self.pipeline.add_late(set);
        }
        let laps = &mut self.laps;
        let output = self.pipeline.step(&job.group, &mut |stage| {
            lap_start = laps.lap(stage.name(), lap_start);
        });
        laps.lap("step", start);
        let patches = job.group.patch_sets.iter().map(|set| set.persons.len());
        let has_pass = !job.group.sighting_sets.is_empty();
        let took_us = Micros::from(clock::micros_since(start));
        let cost = (!has_pass).then_some((patches.sum(), took_us));
        self.last = Some(job.group.tick);
        let stages = self.laps.told_once_a_second(start);
        let is_told = stages.is_some() && self.mode == RunMode::Live;
        let stepped = Stepped {
            unusable: output.unusable_patches + output.unusable_sightings,
            people: is_told.then(|| self.pipeline.known_people(job.group.tick)),
            agreement: (is_told && self.is_agreement_due(start)).then(|| self.pipeline.agreement()),
            stages,
            smoothed: output.smoothed.clone(),
            poses: output.poses,
            events: output.events,
            namings: output.namings,
            boxes: output.boxes,
            cost,
        };
        let to_write = ToWrite {
            poses: output.finished,
            smoothed: output.smoothed,
        };
        (stepped, to_write)
    }
}

impl FusionWork {
    /// Whether the agreement of the cameras is to be judged again.
    fn is_agreement_due(&mut self, now: Instant) -> bool {
        let is_due = |told: Instant| now.duration_since(told) >= AGREEMENT_EVERY;
        let is_due = self.agreement_told.is_none_or(is_due);
        if is_due {
            self.agreement_told = Some(now);
        }
        is_due
    }
}

/// Times of the stages.
#[derive(Debug, Default)]
struct Laps {
    of_stage: BTreeMap<&'static str, Histogram>,
    told: Option<Instant>,
}

impl Laps {
    /// Notes that `stage` has lasted since `start`; returns now.
    fn lap(&mut self, stage: &'static str, start: Instant) -> Instant {
        let histogram = self.of_stage.entry(stage).or_default();
        histogram.record(clock::micros_since(start));
        clock::now()
    }

    fn times(&self) -> Vec<StageTime> {
        let stages = self.of_stage.iter();
        stages
            .filter_map(|(stage, histogram)| histogram.stage_time(stage))
            .collect()
    }

    fn told_once_a_second(&mut self, now: Instant) -> Option<Vec<StageTime>> {
        let is_due = |told: Instant| now.duration_since(told) >= Duration::from_secs(1);
        if !self.told.is_none_or(is_due) {
            return None;
        }
        self.told = Some(now);
        Some(self.times())
    }
}
