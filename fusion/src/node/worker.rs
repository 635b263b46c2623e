//! The thread that computes: one tick after the other through the core, and the results to disk.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Instant;

use anyhow::{Context as _, anyhow};
use farfield_proto::message::{BoxSet, PoseSet, StageTime};
use farfield_proto::tick::Tick;
use tokio::sync::mpsc;

use super::clock;
use super::recorder::Recorder;
use crate::align::TickGroup;
use crate::export::pose_files::Presence;
use crate::pipeline::{Pipeline, Stage};

/// What a tick came to.
#[derive(Debug)]
pub(super) struct Stepped {
    /// The poses of the tick, as they look now.
    pub(super) poses: PoseSet,
    /// Where to look at the next tick, one set per viewpoint.
    pub(super) boxes: Vec<BoxSet>,
    /// Patches that were readable, but made no sense.
    pub(super) unusable: u32,
}

/// What the thread leaves behind.
#[derive(Debug)]
pub(super) struct Finished {
    /// Who was there, or why the files could not be written.
    pub(super) people: anyhow::Result<Vec<Presence>>,
    /// The last tick that went through the core.
    pub(super) last: Option<Tick>,
    /// How long it took.
    pub(super) stages: Vec<StageTime>,
}

/// The loop's handle on the thread.
pub(super) struct Worker {
    jobs: SyncSender<TickGroup>,
    /// Results, in the order of the jobs; closed when the thread has ended.
    pub(super) done: mpsc::Receiver<Stepped>,
    thread: JoinHandle<Finished>,
}

impl Worker {
    /// Starts the thread.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn spawn(pipeline: Pipeline, recorder: Recorder) -> std::io::Result<Self> {
        // Lock-step has one tick under way; the second place lets the loop never wait.
        let (jobs, to_do) = sync_channel(2);
        let (done_tx, done) = mpsc::channel(2);
        let thread = std::thread::Builder::new().name("core".to_owned());
        let thread = thread.spawn(move || work(pipeline, recorder, &to_do, &done_tx))?;
        Ok(Self { jobs, done, thread })
    }

    /// Hands a complete tick over.
    ///
    /// # Errors
    /// When the thread has ended, or still has two ticks to do.
    pub(super) fn step(&self, group: TickGroup) -> anyhow::Result<()> {
        self.jobs
            .try_send(group)
            .map_err(|error| anyhow!("the core does not take a tick: {error}"))
    }

    /// Lets the thread finish its files, and returns what it leaves behind.
    pub(super) async fn finish(self) -> anyhow::Result<Finished> {
        drop((self.jobs, self.done));
        let joined = tokio::task::spawn_blocking(move || self.thread.join())
            .await
            .context("waiting for the core")?;
        joined.map_err(|_| anyhow!("the core has panicked"))
    }
}

fn work(
    mut pipeline: Pipeline,
    mut recorder: Recorder,
    to_do: &Receiver<TickGroup>,
    done: &mpsc::Sender<Stepped>,
) -> Finished {
    let mut laps = Laps::default();
    let mut written = Ok(());
    let mut last = None;
    while let (Ok(group), Ok(())) = (to_do.recv(), &written) {
        let start = clock::now();
        let mut lap_start = start;
        let output = pipeline.step(&group, &mut |stage| {
            lap_start = laps.lap(name(stage), lap_start);
        });
        laps.lap("step", start);
        last = Some(group.tick);
        // Who listens has left when the run was stopped; the files are finished all the same.
        let stepped = Stepped {
            poses: output.poses,
            boxes: output.boxes,
            unusable: output.unusable_patches + output.unusable_sightings,
        };
        let listening = done.blocking_send(stepped).is_ok();
        let start = clock::now();
        written = recorder.write(&output.finished);
        laps.lap("write", start);
        if !listening {
            break;
        }
    }
    let people = if last.is_none() {
        // Files without a tick would only be in the way: dropped, they go.
        written.map(|()| Vec::new())
    } else {
        written
            .and_then(|()| recorder.write(&pipeline.finish()))
            .and_then(|()| recorder.finish())
    };
    Finished {
        people,
        last,
        stages: laps.times(),
    }
}

fn name(stage: Stage) -> &'static str {
    match stage {
        Stage::Decode => "decode",
        Stage::Occlusion => "occlusion",
        Stage::Contests => "contests",
        Stage::Lattice => "lattice",
        Stage::Ik1 => "ik1",
        Stage::Filter => "filter",
        Stage::Ik2 => "ik2",
        Stage::Persons => "persons",
        Stage::Boxes => "boxes",
    }
}

/// Times of the stages, four bytes per stage and tick.
#[derive(Debug, Default)]
struct Laps {
    samples_us: BTreeMap<&'static str, Vec<u32>>,
}

impl Laps {
    /// Notes that `stage` has lasted since `start`; returns now.
    fn lap(&mut self, stage: &'static str, start: Instant) -> Instant {
        let samples = self.samples_us.entry(stage).or_default();
        samples.push(clock::micros_since(start));
        clock::now()
    }

    fn times(mut self) -> Vec<StageTime> {
        let samples = self.samples_us.iter_mut();
        samples
            .filter_map(|(stage, samples)| StageTime::from_samples(stage, samples))
            .collect()
    }
}
