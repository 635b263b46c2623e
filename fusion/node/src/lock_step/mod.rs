//! Lock-step: fusion waits for every edge at every tick.

mod readiness;
mod run;
mod start;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::pipeline::Pipeline;
use farfield_node::clock;
use farfield_node::process::{Ending, NodeError};
use farfield_proto::id::SessionId;
use farfield_proto::message::Status;
use tokio::time::timeout;
use tracing::warn;

use self::readiness::Start;
use self::run::LockStepFusion;
use self::start::wait_until_ready;
use super::config::FusionConfig;
use super::output::export_thread::{ExportThread, missing};
use super::output::summary::{Lost, RunFacts, summarize};
use super::output::summary_file::SummaryFile;
use super::recording::RecordingThread;
use super::session::interceptor::Interceptor;
use super::session::link::FusionEnds;
use super::session::messages::{FusionIncoming, FusionOutgoing, Liveliness, RunMode};
use super::status::failed_status;
use super::worker::FusionWorker;

pub(super) use self::run::Outside;

/// Time for the edges to send their last status at the end of a run.
const FAREWELL: Duration = Duration::from_secs(3);
/// Time between sending a refusal and closing the session.
const REFUSAL: Duration = Duration::from_millis(500);

/// A run in lock-step.
pub(super) struct Begin<'a> {
    pub(super) config: &'a FusionConfig,
    pub(super) session: SessionId,
    /// The folder of the results.
    pub(super) out: &'a Path,
    pub(super) summary: &'a mut SummaryFile,
    pub(super) interceptor: &'a Interceptor,
    pub(super) recording: Option<&'a RecordingThread>,
}

impl Begin<'_> {
    /// Waits for all edges, then runs.
    pub(super) async fn lock_step(
        &mut self,
        pipeline: Pipeline,
        outside: &mut Outside<'_>,
    ) -> Result<Ending, NodeError> {
        match wait_until_ready(self.config, self.session, outside).await {
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
        &mut self,
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
        let exporter = ExportThread::start(self.out, venue, &keypoints, RunMode::LockStep)
            .map_err(NodeError::Failed)?;
        self.summary.reserve().map_err(NodeError::Failed)?;
        let mut worker = FusionWorker::spawn(pipeline, exporter, RunMode::LockStep)
            .context("starting the core's thread")
            .map_err(NodeError::Failed)?;
        let mut run = LockStepFusion::new(
            venue,
            self.session,
            start,
            self.interceptor,
            outside.ends.outgoing.clone(),
        );
        let outcome = run
            .run(&first, &mut worker, outside)
            .await
            .map_err(NodeError::Failed);
        if let Err(error) = &outcome {
            say_failure(self.config, outside.ends, error);
        }
        run.send_end();
        let last_words = farewell(&mut run, outside.ends, venue.viewpoints.len()).await;
        let finished = worker.finish().await.map_err(NodeError::Failed)?;
        if finished.last.is_none() {
            // There is nothing to summarise.
            return outcome;
        }
        let facts = RunFacts {
            ticks: start.ticks.clone(),
            edges: &start.edges,
            tally: &run.outbox.tally,
            lost: Lost {
                late: run.outbox.tally.refused,
                ..Lost::default()
            },
            ending: outcome.as_ref().ok().copied(),
            exported: &finished.exported,
            agreement: &finished.agreement,
            last: finished.last,
            stages: finished.stages,
            paths: Vec::new(),
            cameras: BTreeMap::new(),
            target_latency: None,
            last_words: &last_words,
            elapsed: clock::now().duration_since(began),
            recording: self.recording.map(RecordingThread::so_far),
        };
        let summary = summarize(venue, &facts);
        self.summary.put(summary).map_err(NodeError::Failed)?;
        match finished.exported.missing() {
            Some(poses) => Err(NodeError::Failed(missing(poses))),
            None => outcome,
        }
    }
}

/// Waits for the last status of each edge, with its times.
async fn farewell(
    run: &mut LockStepFusion<'_>,
    ends: &mut FusionEnds,
    n_viewpoints: usize,
) -> Vec<Status> {
    let mut last_words = Vec::new();
    let last_statuses = async {
        while run.gone.len() < n_viewpoints {
            match ends.incoming.recv().await {
                Some(FusionIncoming::Status(status))
                    if status.viewpoint.is_some() && !status.stages.is_empty() =>
                {
                    last_words.push(*status);
                }
                Some(FusionIncoming::Alive(node, Liveliness::Gone)) => drop(run.gone.insert(node)),
                Some(_) => {}
                None => break,
            }
        }
    };
    if timeout(FAREWELL, last_statuses).await.is_err() {
        warn!(
            left = run.gone.len(),
            of = n_viewpoints,
            "not every edge has left"
        );
    }
    last_words.sort_by_key(|status| status.viewpoint);
    last_words
}

fn say_failure(config: &FusionConfig, ends: &FusionEnds, error: &NodeError) {
    let status = failed_status(&config.venue.hashes, error);
    if ends
        .outgoing
        .try_send(FusionOutgoing::Status(Box::new(status)))
        .is_err()
    {
        warn!("the failure was not sent to the edges: the queue is full");
    }
}
