//! The core's thread: it steps the core tick by tick, and passes the results to the exporter.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use farfield_fusion::align::TickGroup;
use farfield_fusion::camera_agreement::{AgreementReport, AgreementSamples};
use farfield_fusion::identity::known::KnownPeople;
use farfield_fusion::live::Micros;
use farfield_fusion::pipeline::Pipeline;
use farfield_node::clock;
use farfield_node::histogram::Histogram;
use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::message::naming::Naming;
use farfield_proto::message::{BoxSet, PatchSet, PoseSet, StageTime};
use farfield_proto::tick::Tick;
use tokio::sync::mpsc;
use tracing::debug_span;

use super::output::export_thread::ExportThread;
use super::output::exporter::Exported;
use super::session::messages::RunMode;

/// Interval of judging the agreement of the cameras in a live run.
const AGREEMENT_EVERY: Duration = Duration::from_secs(10);

/// A tick for the core.
#[derive(Debug, Default)]
pub(super) struct Job {
    pub(super) group: TickGroup,
    /// Sets of earlier ticks that arrived since the last step.
    pub(super) late: Vec<PatchSet>,
    /// Ticks ahead of which the boxes are made, by viewpoint; empty: unchanged.
    pub(super) horizons: Vec<f64>,
}

/// The results of a tick.
#[derive(Debug)]
pub(super) struct Stepped {
    /// The causal poses of the tick.
    pub(super) poses: PoseSet,
    /// Ticks that the fixed-lag smoother has finished.
    pub(super) smoothed: Vec<PoseSet>,
    /// Identity events.
    pub(super) events: Vec<IdentityEvent>,
    pub(super) namings: Vec<Naming>,
    /// The boxes of the next tick, one set per viewpoint.
    pub(super) boxes: Vec<BoxSet>,
    /// Readable patches with invalid contents.
    pub(super) unusable: u32,
    /// Durations of the core's stages so far, once a second.
    pub(super) stages: Option<Vec<StageTime>>,
    /// The known people, once a second in a live run.
    pub(super) people: Option<KnownPeople>,
    /// Samples of the cameras' agreement, every ten seconds in a live run.
    pub(super) agreement: Option<AgreementSamples>,
    /// The number of patches and the duration of the step, microseconds; `None` for a tick with a detection pass.
    pub(super) cost: Option<(usize, Micros)>,
}

/// The results of the thread.
#[derive(Debug)]
pub(super) struct Finished {
    /// The people of the run, and ticks that the files lack.
    pub(super) exported: Exported,
    /// The last tick that was stepped.
    pub(super) last: Option<Tick>,
    /// Durations of the stages.
    pub(super) stages: Vec<StageTime>,
    /// The agreement of the cameras.
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
    /// Starts the thread. If the files cannot be written, the thread ends; in a live run it continues tracking.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub(super) fn spawn(
        pipeline: Pipeline,
        exporter: ExportThread,
        mode: RunMode,
    ) -> std::io::Result<Self> {
        // One tick is in progress; the second place ensures that the loop never waits.
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
                agreement_reported: None,
            }
            .run(&to_do, &done_tx)
        })?;
        Ok(Self { jobs, done, thread })
    }

    /// Sends a complete tick to the thread.
    ///
    /// # Errors
    /// The thread has ended, or two ticks are queued.
    pub(super) fn step(&self, job: Job) -> anyhow::Result<()> {
        self.jobs
            .try_send(job)
            .map_err(|error| anyhow!("the core cannot accept a tick: {error}"))
    }

    /// Waits until the thread has finished its files, and returns its results.
    pub(super) async fn finish(self) -> anyhow::Result<Finished> {
        drop((self.jobs, self.done));
        let joined = tokio::task::spawn_blocking(move || self.thread.join())
            .await
            .context("waiting for the core")?;
        joined.map_err(|_| anyhow!("the core has panicked"))?
    }
}

/// Final poses.
struct ToWrite {
    poses: Vec<PoseSet>,
    smoothed: Vec<PoseSet>,
}

struct FusionWork {
    pipeline: Pipeline,
    exporter: ExportThread,
    mode: RunMode,
    last: Option<Tick>,
    laps: Laps,
    agreement_reported: Option<Instant>,
}

impl FusionWork {
    fn run(
        mut self,
        to_do: &Receiver<Job>,
        done: &mpsc::Sender<Stepped>,
    ) -> anyhow::Result<Finished> {
        while let Ok(job) = to_do.recv() {
            let (stepped, finished) = self.step(&job);
            // The receiver is gone if the run was stopped; the files are still finished.
            let has_receiver = done.blocking_send(stepped).is_ok();
            let start = clock::now();
            self.exporter.write(finished.poses, finished.smoothed);
            self.laps.lap("write", start);
            if !has_receiver || self.mode == RunMode::LockStep && self.exporter.has_failed() {
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
        // The files are complete before the agreement is judged.
        let exported = exported?;
        Ok(Finished {
            exported,
            last,
            stages: laps.times(),
            agreement: pipeline.agreement().report(),
        })
    }

    fn step(&mut self, job: &Job) -> (Stepped, ToWrite) {
        let _span = debug_span!("tick", tick = job.group.tick.0).entered();
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
        let stages = self.laps.once_a_second(start);
        let is_due = stages.is_some() && self.mode == RunMode::Live;
        let stepped = Stepped {
            unusable: output.unusable_patches + output.unusable_sightings,
            people: is_due.then(|| self.pipeline.known_people(job.group.tick)),
            agreement: (is_due && self.is_agreement_due(start)).then(|| self.pipeline.agreement()),
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
    fn is_agreement_due(&mut self, now: Instant) -> bool {
        let is_due = |last: Instant| now.duration_since(last) >= AGREEMENT_EVERY;
        let is_due = self.agreement_reported.is_none_or(is_due);
        if is_due {
            self.agreement_reported = Some(now);
        }
        is_due
    }
}

/// Durations of the stages.
#[derive(Debug, Default)]
struct Laps {
    of_stage: BTreeMap<&'static str, Histogram>,
    reported: Option<Instant>,
}

impl Laps {
    /// Records that `stage` lasted from `start` until now; returns now.
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

    fn once_a_second(&mut self, now: Instant) -> Option<Vec<StageTime>> {
        let is_due = |last: Instant| now.duration_since(last) >= Duration::from_secs(1);
        if !self.reported.is_none_or(is_due) {
            return None;
        }
        self.reported = Some(now);
        Some(self.times())
    }
}
