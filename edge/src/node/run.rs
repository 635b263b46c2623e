//! The run of an edge node, from its arguments to its exit code.

use std::convert::Infallible;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_node::log::start_log_with;
use farfield_node::process::{
    Ending, Managed, NodeError, exit_code, say, stop_on_signal, write_lines_for_parent,
};
use farfield_node::runtime;
use farfield_proto::message::Status;
use tokio::task::JoinHandle;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{Instrument as _, error_span, warn};

use super::attempts::{self, remind};
use super::build::{Built, build};
use super::config::{EdgeArgs, EdgeConfig};
use super::handout;
use super::link::{EdgeEnds, EdgeIncoming, EdgeSession};
use super::live::{EdgePublishers, LiveEdge};
use super::lockstep::{LockStepEdge, LockStepEnding};
use super::ring::{RingThread, answer_questions};
use super::worker::EdgeWorker;
use crate::source::Sources;

/// Longest time for the tasks to end.
const DRAIN: Duration = Duration::from_secs(5);
/// Longest time for a network to load after the edge must end; with `ort-tract` it takes some
/// seconds.
const BUILD_DRAIN: Duration = Duration::from_secs(15);
/// Time between a refusal and the end of the session.
const REFUSAL: Duration = Duration::from_millis(300);

/// Runs an edge node with the given sources and prints errors to standard error.
pub fn main(args: EdgeArgs, sources: Arc<dyn Sources>) -> ExitCode {
    start_log_with(attempts::layer());
    if args.lines_for_parent {
        write_lines_for_parent();
    }
    exit_code(load_and_run(args, sources))
}

fn load_and_run(args: EdgeArgs, sources: Arc<dyn Sources>) -> Result<Ending, NodeError> {
    if args.from_fusion && !handout::fetch(&args)? {
        return Ok(Ending::Interrupted);
    }
    let config = Arc::new(EdgeConfig::load(args, sources)?);
    let span = error_span!("edge", viewpoint = config.name);
    runtime::block_on(2, run(&config).instrument(span))
}

pub(super) async fn run(config: &Arc<EdgeConfig>) -> Result<Ending, NodeError> {
    // `stop` ends the node; `leave` ends the message tasks after the last message.
    let (tasks, stop, leave) = (
        TaskTracker::new(),
        CancellationToken::new(),
        CancellationToken::new(),
    );
    stop_on_signal(&tasks, &stop, config.managed)
        .context("listening for signals")
        .map_err(NodeError::Failed)?;
    let to_build = Arc::clone(config);
    let mut building = tokio::task::spawn_blocking(move || build(&to_build));
    let opened = stop.run_until_cancelled(Box::pin(open(config, &mut building)));
    let Some((built, link)) = opened.await.transpose()? else {
        // A library that is still initialising crashes if the process ends.
        if !building.is_finished() && timeout(BUILD_DRAIN, building).await.is_err() {
            warn!("the network is still loading, leaving anyway");
        }
        return Ok(Ending::Interrupted);
    };
    let mut ends = link.spawn(&tasks, &leave);
    let worker = EdgeWorker::spawn(built.work, ends.outgoing.clone(), Arc::clone(&ends.spoken))
        .context("starting the pipeline's thread");
    let worker = worker.map_err(NodeError::Failed)?;
    let run = LockStepEdge::new(built.status);
    let outcome = Box::pin(work(config, run, worker, &mut ends, &stop)).await;
    stop.cancel();
    if timeout(DRAIN, ends.close(&tasks, &leave)).await.is_err() {
        warn!("tasks still running, leaving anyway");
    }
    outcome
}

/// Waits for `building` and connects to fusion. Can be cancelled at any time.
async fn open(
    config: &EdgeConfig,
    building: &mut JoinHandle<Result<Built, NodeError>>,
) -> Result<(Built, EdgeSession), NodeError> {
    let built = building
        .await
        .context("opening the sources")
        .map_err(NodeError::Failed)??;
    if config.managed == Managed::No && !built.status.backend.is_empty() {
        say(format_args!("{}: {}", config.name, built.status.backend));
    }
    let transport = config.transport();
    let link = EdgeSession::open(&transport, &config.name);
    let waiting = || {
        let endpoints = config.reach.endpoints.join(", ");
        let why = attempts::last_failure().map_or(String::new(), |why| format!(" ({why})"));
        let line = format!("{}: waiting for fusion at {endpoints}{why}", config.name);
        (config.managed == Managed::No).then_some(line)
    };
    let link = tokio::select! {
        link = link => link,
        never = remind(waiting) => match never {},
    };
    Ok((built, link.map_err(NodeError::Failed)?))
}

/// Runs the loop and reports its result.
async fn work(
    config: &EdgeConfig,
    mut run: LockStepEdge,
    mut worker: EdgeWorker,
    ends: &mut EdgeEnds,
    stop: &CancellationToken,
) -> Result<Ending, NodeError> {
    let outcome = match run.run(ends, &mut worker, stop).await {
        Ok(LockStepEnding::Live(first)) => {
            // Its encoder holds whole rows of maps: too much for a stack.
            return Box::pin(work_live(config, run.status, worker, first, ends, stop)).await;
        }
        Ok(LockStepEnding::End(ending)) => Ok(ending),
        Err(error) => Err(error),
    };
    run.leaves(outcome.as_ref().err());
    if let Ok(stages) = timeout(DRAIN, worker.finish()).await {
        run.status.stages = stages.map_err(NodeError::Failed)?;
    } else {
        warn!("the pipeline is still waiting for a frame, leaving anyway");
    }
    run.send_status(ends);
    if outcome.is_err() {
        // Fusion reads it before the session ends.
        tokio::time::sleep(REFUSAL).await;
    }
    outcome
}

/// The same for a live edge, with fusion's first message.
async fn work_live(
    config: &EdgeConfig,
    status: Status,
    worker: EdgeWorker,
    first: EdgeIncoming,
    ends: &mut EdgeEnds,
    stop: &CancellationToken,
) -> Result<Ending, NodeError> {
    let work = worker.recall().await.map_err(NodeError::Failed)?;
    let ring = open_ring(config);
    let names = [config.venue.name.as_str(), &config.name];
    let publishers = EdgePublishers::declare(&ends.session(), names, config.sends_pictures()).await;
    let publishers = publishers.map(|publishers| (publishers, Arc::clone(&ends.spoken)));
    let live = LiveEdge::spawn(
        work.into_parts(),
        status,
        config.start_clock(),
        publishers.map_err(NodeError::Failed)?,
        ring.as_ref().map(RingThread::handle),
    );
    let mut live = live
        .context("starting the threads")
        .map_err(NodeError::Failed)?;
    let outcome = match live.receive(first) {
        Ok(Some(ending)) => Ok(ending),
        Ok(None) => {
            let answers = answers(config, ends.session(), &live, ring.as_ref(), stop);
            tokio::select! {
                outcome = live.run(ends, stop) => outcome,
                never = answers => match never {},
            }
        }
        Err(error) => Err(error),
    };
    live.leave(outcome.as_ref().err());
    if let Some(ring) = ring {
        // At most a queue of messages is left to write. A disk that hangs is not waited for.
        let finished = tokio::task::spawn_blocking(move || ring.finish());
        drop(timeout(DRAIN, finished).await);
    }
    // Fusion reads it before the session ends.
    tokio::time::sleep(REFUSAL).await;
    outcome
}

/// The ring on disk, if the venue wants one. The edge also works without it.
fn open_ring(config: &EdgeConfig) -> Option<RingThread> {
    let bytes = u64::from(config.venue.parameters.recording.ring_mib) << 20;
    if bytes == 0 {
        return None;
    }
    match RingThread::start(&config.ring, bytes) {
        Ok(ring) => Some(ring),
        Err(error) => {
            say(format_args!(
                "{}: sets are not stored: {error:#}",
                config.name
            ));
            None
        }
    }
}

/// Answers fusion's requests for missed ticks while it is polled.
fn answers(
    config: &EdgeConfig,
    session: zenoh::Session,
    live: &LiveEdge,
    ring: Option<&RingThread>,
    stop: &CancellationToken,
) -> impl Future<Output = Infallible> + use<> {
    let names = [config.venue.name.clone(), config.name.clone()];
    let (ring, admit, stop) = (ring.map(RingThread::handle), live.admission(), stop.clone());
    async move {
        if let Some(ring) = ring
            && let Err(error) = answer_questions(session, names, ring, admit, stop).await
        {
            warn!(%error, "fusion cannot fetch what it has missed");
        }
        std::future::pending().await
    }
}
