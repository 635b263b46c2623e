//! Live: nobody waits for anybody. Edges come and go, messages get lost, clocks are off, and at every tick
//! there are poses and boxes.

mod agreement;
mod context;
mod delays;
mod flood;
mod handover;
mod health;
mod missed_target;
mod plan;
mod receiving;
mod run;
mod sending;
mod shed;
mod start;
mod status;

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use farfield_node::clock;
use farfield_node::process::{Ending, Managed, NodeError};
use farfield_proto::tick::Tick;

use self::agreement::AgreementJudge;
pub(super) use self::context::LiveContext;
use self::handover::Handover;
pub(super) use self::handover::names_place;

use self::run::LiveFusion;
use self::start::clock_start;
use super::output::disk_watch::DiskWatch;
use super::output::export_thread::{ExportThread, missing};
use super::output::summary::{RunFacts, summarize};
use super::recording::RecordingThread;
use super::session::mode::RunMode;
use super::worker::FusionWorker;
use crate::identity::known::KnownPeople;
use crate::pipeline::Pipeline;
use crate::recording::channels;
use crate::recording::expected::ExpectedPeople;

/// How long the edges may take to deliver what the recording lacks, when the run is over.
const FILL_PATIENCE: Duration = Duration::from_secs(30);
/// The same when somebody stops it.
const HURRY: Duration = Duration::from_secs(2);

/// Runs until someone asks it to stop, or the ticks are over that were asked for or recorded.
///
/// # Errors
/// When a thread or file cannot be made, or the poses could not be written; never for what an edge does.
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
    let epoch_us = start.time.epoch_us();
    let mut run = LiveFusion::new(&context, start);
    run.disks = disks;
    run.handover = people_path
        .map(|path| Handover::start(path, venue, epoch_us))
        .transpose()
        .context("starting the thread that keeps who is here")
        .map_err(NodeError::Failed)?;
    run.agreement = Some(judge()?);
    let outcome = run.run(boxes, &mut worker, &mut context).await;
    // Fusion that is stopped, or fails, may start again, and finds its edges at work. Under a parent all end.
    let is_over = matches!(outcome, Ok(Ending::Done)) || config.managed == Managed::Yes;
    if is_over && outcome.is_ok() {
        run.tell_end(context.ends);
    }
    fill_recording(&mut run, &outcome, &mut context).await;
    let last_words = if is_over {
        run.end_edges(context.ends).await
    } else {
        run.last_words()
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
        edges: &run.first_words(),
        tally: &run.tally,
        lost: run.lost(),
        ending: outcome.as_ref().ok().copied(),
        exported: &finished.exported,
        agreement: &finished.agreement,
        last: finished.last,
        stages: finished.stages,
        paths: run.paths(),
        cameras: run.camera_summaries(),
        target_latency: run.target.summary(run.names()),
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

/// Waits until the edges have delivered what the recording lacks, if there is one, as long as that may take.
async fn fill_recording(
    run: &mut LiveFusion<'_>,
    outcome: &anyhow::Result<Ending>,
    context: &mut LiveContext<'_>,
) {
    if let Some(recording) = context.recording {
        let patience = match outcome {
            Ok(Ending::Done) => FILL_PATIENCE,
            _ => HURRY,
        };
        let fillers = recording.fillers(&context.interceptor.clock);
        run.receive_until(context.ends, fillers.finish(patience))
            .await;
    }
}

/// Those that the run writes to.
fn disks(exporter: &ExportThread, recording: Option<&RecordingThread>) -> Vec<Arc<DiskWatch>> {
    let recording = recording.map(RecordingThread::disk_watch);
    std::iter::once(exporter.disk_watch())
        .chain(recording)
        .collect()
}

/// Who judges whether the cameras agree.
fn judge() -> Result<AgreementJudge, NodeError> {
    let judge = AgreementJudge::start().context("starting the thread that judges cameras");
    judge.map_err(NodeError::Failed)
}

/// Lets `pipeline` expect who was here before, and a recording know it; if anybody was.
fn expect(
    known: Option<KnownPeople>,
    pipeline: &mut Pipeline,
    context: &LiveContext<'_>,
    first: Tick,
) -> anyhow::Result<()> {
    let Some(known) = known else {
        // Ids begin anew: what was kept by those of before means other people.
        context.interceptor.wiretap.expected(&[]);
        return Ok(());
    };
    let expected = ExpectedPeople {
        session: context.session,
        known,
    };
    // A replay reads it from this text, and shall have the same bits.
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
        on_demand.knows(&expected.known);
    }
    pipeline.expect(&expected.known, first);
    Ok(())
}

#[cfg(test)]
pub(super) mod tests;
