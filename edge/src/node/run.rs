//! An edge node from its arguments to its exit code.

use std::convert::Infallible;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use tokio::time::{MissedTickBehavior, interval, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::warn;

use super::build::{Built, build};
use super::config::{Config, EdgeArgs};
use super::link::{Ends, Link};
use super::lockstep::LockStep;
use super::process::{Ending, Managed, NodeError, exit_code, say, start_log, stop_when_told};
use super::worker::Worker;
use crate::source::Sources;

/// How long the tasks may take to end.
const DRAIN: Duration = Duration::from_secs(5);
/// How long a refusal stands on the wire before the session closes.
const REFUSAL: Duration = Duration::from_millis(300);
/// How long fusion may take to answer before a person is told that the edge waits for it.
const SILENCE: Duration = Duration::from_millis(500);
/// How often a person is told so again.
const REMIND_EVERY: Duration = Duration::from_secs(10);

/// Runs an edge node, whose cameras `sources` opens, to its end and says on standard error what went
/// wrong.
pub fn main(args: EdgeArgs, sources: Arc<dyn Sources>) -> ExitCode {
    start_log();
    exit_code(load_and_run(args, sources))
}

fn load_and_run(args: EdgeArgs, sources: Arc<dyn Sources>) -> Result<Ending, NodeError> {
    let config = Arc::new(Config::load(args, sources)?);
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build();
    let runtime = runtime
        .context("starting the runtime")
        .map_err(NodeError::Failed)?;
    let ending = runtime.block_on(run(&config));
    // Neither a camera that gives no frame nor a fusion that is not there must hold up the end.
    runtime.shutdown_timeout(Duration::from_millis(200));
    ending
}

async fn run(config: &Arc<Config>) -> Result<Ending, NodeError> {
    // `stop` asks the node to end; `leave` ends the tasks that carry messages, once all is said.
    let (tasks, stop, leave) = (
        TaskTracker::new(),
        CancellationToken::new(),
        CancellationToken::new(),
    );
    stop_when_told(&tasks, &stop, config.managed)
        .context("listening for signals")
        .map_err(NodeError::Failed)?;
    let Some((built, link)) = stop.run_until_cancelled(open(config)).await.transpose()? else {
        return Ok(Ending::Interrupted);
    };
    let mut ends = link.spawn(&tasks, &leave);
    let worker =
        Worker::spawn(built.work, ends.say.clone()).context("starting the pipeline's thread");
    let worker = worker.map_err(NodeError::Failed)?;
    let outcome = work(LockStep::new(built.status), worker, &mut ends, &stop).await;
    stop.cancel();
    if timeout(DRAIN, ends.close(&tasks, &leave)).await.is_err() {
        warn!("tasks still running, leaving anyway");
    }
    outcome
}

/// Opens everything that can fail, fusion last. Can be called off at any time: what blocks, blocks a
/// thread of its own.
async fn open(config: &Arc<Config>) -> Result<(Built, Link), NodeError> {
    let to_build = Arc::clone(config);
    let built = tokio::task::spawn_blocking(move || build(&to_build)).await;
    let built = built
        .context("opening the sources")
        .map_err(NodeError::Failed)??;
    if config.managed == Managed::No && !built.status.backend.is_empty() {
        say(format_args!("{}: {}", config.name, built.status.backend));
    }
    let transport = config.transport();
    let link = Link::open(&transport, &config.name);
    let link = tokio::select! {
        link = link => link,
        never = remind(config) => match never {},
    };
    Ok((built, link.map_err(NodeError::Failed)?))
}

/// Tells a person now and then what the edge waits for.
async fn remind(config: &Config) -> Infallible {
    tokio::time::sleep(SILENCE).await;
    let mut reminders = interval(REMIND_EVERY);
    reminders.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        reminders.tick().await;
        if config.managed == Managed::No {
            let endpoints = config.connect.join(", ");
            say(format_args!(
                "{}: waiting for fusion at {endpoints}",
                config.name
            ));
        }
    }
}

/// Runs the loop, and says at its end how it went.
async fn work(
    mut run: LockStep,
    mut worker: Worker,
    ends: &mut Ends,
    stop: &CancellationToken,
) -> Result<Ending, NodeError> {
    let outcome = run.run(ends, &mut worker, stop).await;
    run.leaves(outcome.as_ref().err());
    if let Ok(stages) = timeout(DRAIN, worker.finish()).await {
        run.status.stages = stages.map_err(NodeError::Failed)?;
    } else {
        warn!("the pipeline is still waiting for a frame, leaving anyway");
    }
    run.say(ends);
    if outcome.is_err() {
        // Fusion reads it before the session goes.
        tokio::time::sleep(REFUSAL).await;
    }
    outcome
}
