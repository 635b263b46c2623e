//! A fusion node from its arguments to its exit code.

use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context as _;
use farfield_proto::id::SessionId;
use farfield_proto::message::Status;
use farfield_proto::wire;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::warn;

use super::clock;
use super::config::{Config, FusionArgs};
use super::link::{Ear, Ends, Heard, Link, Mode, Presence, Said};
use super::lockstep::{LockStep, Outside};
use super::output::Claim;
use super::process::{Ending, Managed, NodeError, exit_code, start_log, stop_when_told};
use super::progress::Reporter;
use super::recorder::Recorder;
use super::start::{Start, failed_status, roll_call};
use super::summary::{self, Facts, summarize};
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
    start_log();
    exit_code(load_and_run(args))
}

fn load_and_run(args: FusionArgs) -> Result<Ending, NodeError> {
    let config = Config::load(args)?;
    let session = new_session();
    let pipeline = Pipeline::new(&config.venue, config.card.as_ref(), session);
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build();
    let runtime = runtime
        .context("starting the runtime")
        .map_err(NodeError::Failed)?;
    let ending = runtime.block_on(run(&config, session, pipeline));
    // A publisher that a congested network holds must not hold up the end.
    runtime.shutdown_timeout(Duration::from_millis(200));
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
    let link = Link::open(&config.venue, &config.listen, Mode::LockStep)
        .await
        .map_err(NodeError::Failed)?;
    reporter.listening(link.locators().await);
    let ear = Ear {
        clock: clock::VenueClock::start(),
        tap: TapHandle::new(None),
    };
    let mut ends = link.spawn(&tasks, &leave, &ear);
    let mut outside = Outside {
        ends: &mut ends,
        reporter: &mut reporter,
        stop: &stop,
    };
    let outcome = match roll_call(config, &mut outside).await {
        Ok(Some(start)) => {
            let run = Run {
                config,
                session,
                out: claim.folder(),
                start: &start,
                tap: &ear.tap,
            };
            run.lock_step(pipeline, &mut outside).await
        }
        Ok(None) => Ok(Ending::Interrupted),
        Err(error) => {
            say_failure(config, &ends, &error);
            tokio::time::sleep(REFUSAL).await;
            Err(error)
        }
    };
    stop.cancel();
    if timeout(DRAIN, ends.close(&tasks, &leave)).await.is_err() {
        warn!("tasks still running, leaving anyway");
    }
    outcome
}

/// A run that all edges are ready for.
struct Run<'a> {
    config: &'a Config,
    session: SessionId,
    /// Where the results go.
    out: &'a Path,
    start: &'a Start,
    tap: &'a TapHandle,
}

impl Run<'_> {
    async fn lock_step(
        &self,
        mut pipeline: Pipeline,
        outside: &mut Outside<'_>,
    ) -> Result<Ending, NodeError> {
        let venue = &self.config.venue;
        let ticks = &self.start.ticks;
        outside.reporter.started(ticks.start, ticks.end);
        let began = clock::now();
        let first = pipeline.first_boxes(ticks.start);
        let keypoints = pipeline.keypoints().clone();
        let recorder = Recorder::create(self.out, venue, &keypoints).map_err(NodeError::Failed)?;
        let mut worker = Worker::spawn(pipeline, recorder)
            .context("starting the core's thread")
            .map_err(NodeError::Failed)?;
        let mut run = LockStep::new(venue, self.session, self.start, self.tap.clone());
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
            start: self.start,
            run: &run,
            ending: outcome.as_ref().ok().copied(),
            people,
            last: finished.last,
            stages: finished.stages,
            last_words: &last_words,
            elapsed: clock::now().duration_since(began),
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
