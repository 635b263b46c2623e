//! A fusion node from its arguments to its exit code.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_node::clock;
use farfield_node::log::start_log_with;
use farfield_node::process::{Ending, Managed, NodeError, exit_code, stop_when_told};
use farfield_node::runtime;
use farfield_proto::id::SessionId;
use farfield_proto::message::Status;
use farfield_proto::wire;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::warn;

use super::config::{Config, FusionArgs};
use super::doorman;
use super::handout;
use super::link::{Ear, Ends, Heard, Link, Mode, NODE, Presence, Said};
use super::live::{Surroundings, live};
use super::lockstep::{LockStep, Outside};
use super::output::Claim;
use super::progress::Reporter;
use super::recorder::Recorder;
use super::recording::{Place, RecordingThread, head};
use super::start::{Start, failed_status, roll_call};
use super::summary::{self, Facts, Lost, summarize};
use super::tap::TapHandle;
use super::worker::Worker;
use crate::pipeline::Pipeline;

/// How long the edges may take to say their last word when a run is over.
const FAREWELL: Duration = Duration::from_secs(3);
/// How long a refusal stands on the wire before the session closes.
const REFUSAL: Duration = Duration::from_millis(500);
/// How long the tasks may take to end.
const DRAIN: Duration = Duration::from_secs(5);

/// Runs a fusion node to its end and says on standard error what went wrong.
pub fn main(args: FusionArgs) -> ExitCode {
    start_log_with(doorman::layer());
    exit_code(load_and_run(args))
}

fn load_and_run(args: FusionArgs) -> Result<Ending, NodeError> {
    let config = Config::load(args)?;
    let session = new_session();
    let pipeline = Pipeline::new(&config.venue, config.card.as_ref(), session);
    let ending = runtime::block_on(2, run(&config, session, pipeline));
    doorman::sum_up();
    ending
}

/// A number that no earlier life of fusion had. Its top bit is set, so that it takes the same bytes
/// on the wire in every run: equal runs send equal numbers of bytes.
fn new_session() -> SessionId {
    SessionId(clock::unix_time().as_nanos() as u64 | 1 << 63)
}

async fn run(config: &Config, session: SessionId, pipeline: Pipeline) -> Result<Ending, NodeError> {
    // `stop` asks the run to end; `leave` ends the tasks that carry messages, once all is said.
    let (tasks, stop, leave) = (
        TaskTracker::new(),
        CancellationToken::new(),
        CancellationToken::new(),
    );
    stop_when_told(&tasks, &stop, config.managed)
        .context("listening for signals")
        .map_err(NodeError::Failed)?;
    let claim = match (&config.out, config.managed) {
        (Some(out), Managed::Yes) => Claim::of_parent(out.clone()),
        (out, _) => Claim::take(out.as_deref(), &config.venue.name).map_err(NodeError::Refused)?,
    };
    let mut reporter = Reporter::new(config.managed, config.detail);
    let link = Link::open(&config.venue, &config.door(), config.mode)
        .await
        .map_err(NodeError::Failed)?;
    let venue = config.venue.name.clone();
    let handout = Arc::clone(&config.handout);
    tasks.spawn(handout::serve(
        link.session(),
        venue,
        handout,
        leave.clone(),
    ));
    reporter.listening(link.locators().await);
    let recording = record(config, session, &pipeline).map_err(NodeError::Failed)?;
    let tap = TapHandle::new(recording.as_ref().map(RecordingThread::tap));
    let ear = Ear::new(&config.venue, clock::VenueClock::start(), tap);
    let mut ends = link.spawn(&tasks, &leave, &ear);
    let outcome = match config.mode {
        Mode::LockStep => {
            let mut outside = Outside {
                ends: &mut ends,
                reporter: &mut reporter,
                stop: &stop,
            };
            let run = Begin {
                config,
                session,
                out: claim.folder(),
                tap: &ear.tap,
                recording: recording.as_ref(),
            };
            Box::pin(run.lock_step(pipeline, &mut outside)).await
        }
        Mode::Live => {
            if let Some(recording) = &recording {
                let fillers = recording.fillers(&ear.clock);
                fillers.spawn(&ends.session(), &config.venue, &tasks, &leave);
            }
            let surroundings = Surroundings {
                config,
                session,
                out: claim.folder(),
                recording: recording.as_ref(),
                ear: &ear,
                ends: &mut ends,
                reporter: &mut reporter,
                stop: &stop,
            };
            Box::pin(live(surroundings, pipeline)).await
        }
    };
    stop.cancel();
    if timeout(DRAIN, ends.close(&tasks, &leave)).await.is_err() {
        warn!("tasks still running, leaving anyway");
    }
    if let Some(recording) = recording {
        let recorded = recording.finish().await.map_err(NodeError::Failed)?;
        summary::complete(claim.folder(), &recorded).map_err(NodeError::Failed)?;
    }
    outcome
}

/// Begins the recording, if one is wanted.
fn record(
    config: &Config,
    session: SessionId,
    pipeline: &Pipeline,
) -> anyhow::Result<Option<RecordingThread>> {
    let Some(asked) = &config.record else {
        return Ok(None);
    };
    let venue = &config.venue;
    let head = head(venue, &config.venue_path, pipeline.keypoints(), NODE)?;
    let place = Place::make(asked, &venue.name)?;
    RecordingThread::start(place, head, session, &venue.parameters.recording).map(Some)
}

/// A run in lock-step.
struct Begin<'a> {
    config: &'a Config,
    session: SessionId,
    /// Where the results go.
    out: &'a Path,
    tap: &'a TapHandle,
    recording: Option<&'a RecordingThread>,
}

impl Begin<'_> {
    /// Waits for all edges, and runs.
    async fn lock_step(
        &self,
        pipeline: Pipeline,
        outside: &mut Outside<'_>,
    ) -> Result<Ending, NodeError> {
        match roll_call(self.config, outside).await {
            Ok(Some(start)) => Box::pin(self.run(&start, pipeline, outside)).await,
            Ok(None) => Ok(Ending::Interrupted),
            Err(error) => {
                say_failure(self.config, outside.ends, &error);
                tokio::time::sleep(REFUSAL).await;
                Err(error)
            }
        }
    }

    /// Runs; all edges are ready.
    async fn run(
        &self,
        start: &Start,
        mut pipeline: Pipeline,
        outside: &mut Outside<'_>,
    ) -> Result<Ending, NodeError> {
        let venue = &self.config.venue;
        let ticks = &start.ticks;
        outside.reporter.started(ticks.start, Some(ticks.end));
        let began = clock::now();
        let first = pipeline.first_boxes(ticks.start);
        let keypoints = pipeline.keypoints().clone();
        let recorder = Recorder::create(self.out, venue, &keypoints).map_err(NodeError::Failed)?;
        let mut worker = Worker::spawn(pipeline, recorder, Mode::LockStep)
            .context("starting the core's thread")
            .map_err(NodeError::Failed)?;
        let mut run = LockStep::new(venue, self.session, start, self.tap.clone());
        let outcome = run
            .run(&first, &mut worker, outside)
            .await
            .map_err(NodeError::Failed);
        if let Err(error) = &outcome {
            say_failure(self.config, outside.ends, error);
        }
        run.send_end(outside.ends);
        let last_words = farewell(&mut run, outside.ends, venue.viewpoints.len()).await;
        let finished = worker.finish().await.map_err(NodeError::Failed)?;
        let people = finished.people.map_err(NodeError::Failed)?;
        if finished.last.is_none() {
            // There is nothing to sum up.
            return outcome;
        }
        let facts = Facts {
            ticks: start.ticks.clone(),
            edges: &start.edges,
            tally: &run.tally,
            lost: Lost {
                late: run.tally.refused,
                ..Lost::default()
            },
            ending: outcome.as_ref().ok().copied(),
            people,
            last: finished.last,
            stages: finished.stages,
            ways: Vec::new(),
            last_words: &last_words,
            elapsed: clock::now().duration_since(began),
            recording: self.recording.map(RecordingThread::so_far),
        };
        summary::write(self.out, &summarize(self.config, &facts)).map_err(NodeError::Failed)?;
        outcome
    }
}

/// Hears the edges out: each says once more how it is, with its times, before it leaves.
async fn farewell(run: &mut LockStep<'_>, ends: &mut Ends, n_viewpoints: usize) -> Vec<Status> {
    let mut last_words = Vec::new();
    let hear_out = async {
        while run.gone.len() < n_viewpoints {
            match ends.heard.recv().await {
                Some(Heard::Status(status))
                    if status.viewpoint.is_some() && !status.stages.is_empty() =>
                {
                    last_words.push(*status);
                }
                Some(Heard::Alive(node, Presence::Gone)) => drop(run.gone.insert(node)),
                Some(_) => {}
                None => break,
            }
        }
    };
    if timeout(FAREWELL, hear_out).await.is_err() {
        warn!(
            left = run.gone.len(),
            of = n_viewpoints,
            "not every edge has left"
        );
    }
    last_words.sort_by_key(|status| status.viewpoint);
    last_words
}

fn say_failure(config: &Config, ends: &Ends, error: &NodeError) {
    let status = failed_status(&config.venue.hashes, error);
    if ends
        .say
        .try_send(Said::Status(wire::encode(&status)))
        .is_err()
    {
        warn!("the edges were not told: the queue is full");
    }
}
