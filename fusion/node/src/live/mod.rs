//! Live runs: no node waits without a bound. Edges may join and leave, messages may be lost and clocks may be off; each tick
//! still has poses and boxes.

mod agreement;
mod conditions;
mod delays;
mod handover;
mod missed_target;
mod overload;
mod receiving;
mod run;
mod start;
mod ticks;
mod viewpoints;
mod watches;

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_fusion::identity::known::KnownPeople;
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::channels;
use farfield_fusion::recording::expected::ExpectedPeople;
use farfield_node::clock;
use farfield_node::process::{Ending, Managed, NodeError};
use farfield_proto::id::SessionId;
use farfield_proto::tick::Tick;
use tokio_util::sync::CancellationToken;

use self::agreement::AgreementJudge;
use self::handover::Handover;
pub(super) use self::handover::names_place;

use self::run::LiveFusion;
use self::start::clock_start;
use self::watches::Watches;
use super::config::FusionConfig;
use super::output::disk_watch::DiskWatch;
use super::output::export_thread::{ExportThread, missing};
use super::output::progress::Reporter;
use super::output::summary::{RunFacts, summarize};
use super::output::summary_file::SummaryFile;
use super::recording::{RecordingThread, RecordingsOnDemand};
use super::session::interceptor::Interceptor;
use super::session::link::FusionEnds;
use super::session::messages::RunMode;
use super::session::other_fusion::OtherFusionWatch;
use super::worker::FusionWorker;

/// Time for the edges to deliver what the recording lacks, at the end of the run.
const FILL_TIMEOUT: Duration = Duration::from_secs(30);
/// The same if the run is stopped.
const FILL_TIMEOUT_IF_STOPPED: Duration = Duration::from_secs(2);

/// The surroundings of a live run.
pub(crate) struct LiveContext<'a> {
    pub(crate) config: &'a FusionConfig,
    pub(crate) session: SessionId,
    /// The folder of the results.
    pub(crate) out: &'a Path,
    pub(crate) summary: &'a mut SummaryFile,
    /// The recorder, if the run is recorded.
    pub(crate) recording: Option<&'a RecordingThread>,
    /// Recordings on demand, if they are possible.
    pub(crate) on_demand: Option<&'a RecordingsOnDemand>,
    pub(crate) interceptor: &'a Interceptor,
    pub(crate) ends: &'a mut FusionEnds,
    pub(crate) reporter: &'a mut Reporter,
    pub(crate) stop: &'a CancellationToken,
    /// The watch for another fusion of the venue.
    pub(crate) others: OtherFusionWatch,
}

/// Runs until it is stopped, or the requested or recorded ticks are over.
///
/// # Errors
/// A thread or file cannot be created, or the poses could not be written; never because of an edge.
pub(super) async fn live(
    mut context: LiveContext<'_>,
    mut pipeline: Pipeline,
) -> Result<Ending, NodeError> {
    let Some(start) = clock_start(&mut context).await.map_err(NodeError::Failed)? else {
        return Ok(Ending::Interrupted);
    };
    let config = context.config;
    let venue = &config.venue;
    let (began, first) = (clock::now(), start.first);
    // Under a parent all nodes end together.
    let people_path = (config.managed == Managed::No).then(|| handover::place(venue, context.out));
    let known = (people_path.as_deref()).and_then(|path| handover::read(path, venue, &start));
    expect(known, &mut pipeline, &context, first).map_err(NodeError::Failed)?;
    let boxes = pipeline.first_boxes(first);
    let keypoints = pipeline.keypoints();
    let exporter = ExportThread::start(context.out, venue, keypoints, RunMode::Live)
        .map_err(NodeError::Failed)?;
    context.summary.reserve().map_err(NodeError::Failed)?;
    let disks = disks(&exporter, context.recording);
    let mut worker = FusionWorker::spawn(pipeline, exporter, RunMode::Live)
        .context("starting the core's thread")
        .map_err(NodeError::Failed)?;
    let handover = people_path
        .map(|path| Handover::start(path, venue, start.time.epoch_us()))
        .transpose()
        .context("starting the thread that saves the present people")
        .map_err(NodeError::Failed)?;
    let watches = Watches::new(judge()?, disks, context.others.clone());
    let mut run = LiveFusion::new(&context, start, watches, handover);
    let outcome = run.run(boxes, &mut worker, &mut context).await;
    // A stopped or failed fusion may be restarted while its edges go on. Under a parent all nodes end.
    let is_over = matches!(outcome, Ok(Ending::Done)) || config.managed == Managed::Yes;
    if is_over && outcome.is_ok() {
        run.announce_end();
    }
    fill_recording(&mut run, &outcome, &mut context).await;
    let last_words = if is_over {
        run.end_edges(context.ends).await
    } else {
        run.viewpoints.last_words()
    };
    let finished = worker.finish().await.map_err(NodeError::Failed)?;
    if let Some(handover) = run.handover.take() {
        handover.finish().await;
    }
    let Some(last) = finished.last else {
        return outcome.map_err(NodeError::Failed);
    };
    let facts = RunFacts {
        ticks: first..run.end().unwrap_or(last + 1),
        edges: &run.viewpoints.last_words(),
        tally: &run.outbox.tally,
        lost: run.lost(),
        ending: outcome.as_ref().ok().copied(),
        exported: &finished.exported,
        agreement: &finished.agreement,
        last: finished.last,
        stages: finished.stages,
        paths: run.paths(),
        cameras: run.viewpoints.camera_summaries(),
        target_latency: run.ticks.target.summary(run.viewpoints.names()),
        last_words: &last_words,
        elapsed: clock::now().duration_since(began),
        recording: context.recording.map(RecordingThread::so_far),
    };
    let summary = summarize(venue, &facts);
    context.summary.put(summary).map_err(NodeError::Failed)?;
    match finished.exported.missing() {
        Some(poses) => Err(NodeError::Failed(missing(poses))),
        None => outcome.map_err(NodeError::Failed),
    }
}

/// Waits until the edges have delivered what the recording lacks, up to a timeout.
async fn fill_recording(
    run: &mut LiveFusion<'_>,
    outcome: &anyhow::Result<Ending>,
    context: &mut LiveContext<'_>,
) {
    if let Some(recording) = context.recording {
        let timeout = match outcome {
            Ok(Ending::Done) => FILL_TIMEOUT,
            _ => FILL_TIMEOUT_IF_STOPPED,
        };
        let fillers = recording.fillers(&context.interceptor.clock);
        run.receive_until(context.ends, fillers.finish(timeout))
            .await;
    }
}

/// The disks that the run writes to.
fn disks(exporter: &ExportThread, recording: Option<&RecordingThread>) -> Vec<Arc<DiskWatch>> {
    let recording = recording.map(RecordingThread::disk_watch);
    std::iter::once(exporter.disk_watch())
        .chain(recording)
        .collect()
}

/// Starts the judge of the cameras' agreement.
fn judge() -> Result<AgreementJudge, NodeError> {
    let judge = AgreementJudge::start().context("starting the thread that judges cameras");
    judge.map_err(NodeError::Failed)
}

/// Passes the people of the previous fusion, if there are any, to `pipeline`, the recording and the observers.
fn expect(
    known: Option<KnownPeople>,
    pipeline: &mut Pipeline,
    context: &LiveContext<'_>,
    first: Tick,
) -> anyhow::Result<()> {
    let Some(known) = known else {
        // New ids begin: data stored under the old ids belong to other people.
        context.interceptor.wiretap.expected(&[]);
        return Ok(());
    };
    let expected = ExpectedPeople {
        session: context.session,
        known,
    };
    // A replay reads this text, and must get the same bits.
    let json = serde_json::to_vec(&expected).context("writing people as JSON")?;
    let expected: ExpectedPeople = serde_json::from_slice(&json).context("reading people")?;
    if let Some(recording) = context.recording {
        let topic = channels::expected(&context.config.venue.name);
        let now_us = context.interceptor.clock.now_us();
        recording.queue().note(&topic, &json, now_us);
    }
    let ids: Vec<u32> = expected.known.people.iter().map(|known| known.id).collect();
    context.interceptor.wiretap.expected(&ids);
    if let Some(on_demand) = context.on_demand {
        on_demand.set_people(&expected.known);
    }
    pipeline.expect(&expected.known, first);
    Ok(())
}

#[cfg(test)]
pub(super) mod tests;
