//! The computing thread: it reads the frames of a tick, runs the pipeline, and encodes the
//! messages.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;

use anyhow::{Context as _, anyhow};
use farfield_node::clock;
use farfield_node::process::{LineKind, say_as};
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::message::{BoxSet, DETECTION_STAGE, StageTime};
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};
use farfield_proto::wire::{self, SpokenVersion};
use tokio::sync::mpsc;
use tracing::debug_span;

use super::acceleration::Workers;
use super::link::EdgeOutgoing;
use crate::pipeline::{EdgeOutput, EdgePipeline, EdgeStage, StepRequest};
use crate::source::{Frame, FrameSource, SourceError, Sources};

/// The thread's result for each tick.
pub(super) type Done = anyhow::Result<Tick>;

/// The data of the thread.
pub(super) struct EdgeWork {
    parts: Parts,
    /// Sources opened in advance at this tick, if the first tick is known before the start.
    opened: Option<(Tick, Vec<FramesAt>)>,
    samples_us: BTreeMap<&'static str, Vec<u32>>,
}

impl EdgeWork {
    /// The cameras are opened when the first tick is known.
    pub(super) fn new(parts: Parts) -> Self {
        Self {
            parts,
            opened: None,
            samples_us: BTreeMap::new(),
        }
    }

    /// The parts for a live edge. Open cameras are closed.
    pub(super) fn into_parts(self) -> Parts {
        self.parts
    }

    /// Opens the cameras at tick `from`.
    ///
    /// # Errors
    /// If a source cannot be opened.
    pub(super) fn open(&mut self, from: Tick) -> anyhow::Result<&mut Vec<FramesAt>> {
        let Parts {
            venue,
            cameras,
            sources,
            ..
        } = &self.parts;
        let cameras = cameras.iter().filter_map(|&index| venue.camera(index));
        let open = |camera: &VenueCamera| {
            let source = sources.open(camera, venue, from)?;
            Ok(FramesAt::new(source))
        };
        let frames = cameras.map(open).collect::<Result<_, SourceError>>()?;
        Ok(&mut self.opened.insert((from, frames)).1)
    }

    /// Processes one tick and returns the messages of `version` in sending order.
    fn step(&mut self, boxes: &BoxSet, version: u8) -> anyhow::Result<Vec<EdgeOutgoing>> {
        let start = clock::now();
        let frames = self.read(boxes.tick)?;
        self.count("read", start);
        let mut lap = clock::now();
        let mut laps = Vec::with_capacity(4);
        let pipeline = &mut self.parts.pipeline;
        // Sequential work gives the same bits on every machine.
        if let Some(batch) = pipeline.batch() {
            batch.work_alone()?;
        }
        pipeline.set_message_version(version);
        let output = pipeline
            .step(&frames, &StepRequest::of(boxes), &mut |stage| {
                laps.push((stage, clock::micros_since(lap)));
                lap = clock::now();
            })
            .with_context(|| format!("tick {}", boxes.tick))?;
        let detects = !boxes.detection_cameras.is_empty();
        for (stage, us) in split_detection(&laps, self.parts.pipeline.detection_share()) {
            if stage != DETECTION_STAGE || detects {
                self.samples_us.entry(stage).or_default().push(us);
            }
        }
        let start = clock::now();
        let messages = encode(&output, version);
        self.count("messages", start);
        Ok(messages)
    }

    fn read(&mut self, tick: Tick) -> anyhow::Result<Vec<Option<Frame>>> {
        let frames = match &mut self.opened {
            Some((from, frames)) if *from <= tick => frames,
            _ => self.open(tick)?,
        };
        frames
            .iter_mut()
            .map(|camera| camera.at(tick).with_context(|| format!("tick {tick}")))
            .collect()
    }

    fn count(&mut self, stage: &'static str, start: std::time::Instant) {
        self.samples_us
            .entry(stage)
            .or_default()
            .push(clock::micros_since(start));
    }

    fn stages(mut self) -> Vec<StageTime> {
        self.samples_us
            .iter_mut()
            .filter_map(|(stage, samples)| StageTime::from_samples(stage, samples))
            .collect()
    }
}

/// Sightings first: the patches state how many sightings fusion must wait for.
fn encode(output: &EdgeOutput, version: u8) -> Vec<EdgeOutgoing> {
    let sightings = output
        .sighting_sets
        .iter()
        .map(|set| EdgeOutgoing::Sightings(wire::encode_as(set, version)));
    let patches = output
        .patch_sets
        .iter()
        .map(|set| EdgeOutgoing::Patches(wire::encode_as(set, version)));
    sightings.chain(patches).collect()
}

/// The loop's handle of the thread.
pub(super) struct EdgeWorker {
    jobs: SyncSender<BoxSet>,
    /// One result per tick, in order; closed when the thread has ended.
    pub(super) done: mpsc::Receiver<Done>,
    thread: JoinHandle<EdgeWork>,
}

impl EdgeWorker {
    /// Starts the thread, which sends its messages directly to the publisher.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub(super) fn spawn(
        work: EdgeWork,
        outgoing: mpsc::Sender<EdgeOutgoing>,
        spoken: Arc<SpokenVersion>,
    ) -> std::io::Result<Self> {
        // Lock-step has one tick in progress; with the second place the loop never waits.
        let (jobs, to_do) = sync_channel(2);
        let (done_tx, done) = mpsc::channel(2);
        let thread = std::thread::Builder::new().name("pipeline".to_owned());
        let thread = thread.spawn(move || run(work, &to_do, &outgoing, &spoken, &done_tx))?;
        Ok(Self { jobs, done, thread })
    }

    /// Passes the boxes of a tick to the thread.
    ///
    /// # Errors
    /// If the thread has ended, or has two unfinished ticks.
    pub(super) fn step(&self, boxes: BoxSet) -> anyhow::Result<()> {
        self.jobs
            .try_send(boxes)
            .map_err(|error| anyhow!("the pipeline does not take a tick: {error}"))
    }

    /// Ends the thread and returns its stage times.
    pub(super) async fn finish(self) -> anyhow::Result<Vec<StageTime>> {
        self.recall().await.map(EdgeWork::stages)
    }

    /// Ends the thread and returns its data.
    pub(super) async fn recall(self) -> anyhow::Result<EdgeWork> {
        drop((self.jobs, self.done));
        let joined = tokio::task::spawn_blocking(move || self.thread.join())
            .await
            .context("waiting for the pipeline")?;
        joined.map_err(|_| anyhow!("the pipeline has panicked"))
    }
}

fn run(
    mut work: EdgeWork,
    to_do: &Receiver<BoxSet>,
    outgoing: &mpsc::Sender<EdgeOutgoing>,
    spoken: &SpokenVersion,
    done: &mpsc::Sender<Done>,
) -> EdgeWork {
    while let Ok(boxes) = to_do.recv() {
        let tick = boxes.tick;
        let _span = debug_span!("tick", tick = tick.0).entered();
        let result = work.step(&boxes, spoken.get()).and_then(|messages| {
            // If the queue is full, this thread waits for the network; the loop never waits.
            let sent = messages
                .into_iter()
                .try_for_each(|message| outgoing.blocking_send(message));
            sent.map_err(|_| anyhow!("the publisher has ended"))
        });
        let failed = result.is_err();
        if done.blocking_send(result.map(|()| tick)).is_err() || failed {
            break;
        }
    }
    report_beyond_view(&work.parts.pipeline);
    work
}

/// The cameras of a viewpoint, their sources, and the pipeline.
pub(super) struct Parts {
    pub(super) venue: Arc<Venue>,
    pub(super) viewpoint: ViewpointIndex,
    /// The cameras of the viewpoint, in file order.
    pub(super) cameras: Vec<CameraIndex>,
    pub(super) sources: Arc<dyn Sources>,
    pub(super) pipeline: EdgePipeline,
    /// Measured speed of the network, if the edge may run live.
    pub(super) workers: Option<Workers>,
}

/// Prints a line per camera of `pipeline` for which content was left out.
pub(super) fn report_beyond_view(pipeline: &EdgePipeline) {
    for (camera, left_out) in pipeline.beyond_view() {
        say_as(
            LineKind::UnusedPictures,
            format_args!("camera `{camera}`: {left_out}"),
        );
    }
}

/// The durations by name. The `share` of the inference for sightings counts as detection, which
/// separates the cost of detection from that of tracking.
pub(super) fn split_detection(laps: &[(EdgeStage, u32)], share: f64) -> [(&'static str, u32); 4] {
    let of = |wanted: EdgeStage| {
        let laps = laps.iter().filter(|(stage, _)| *stage == wanted);
        laps.map(|(_, us)| us).sum::<u32>()
    };
    let keypoints_us = (f64::from(of(EdgeStage::Infer)) * share).round() as u32;
    [
        (name(EdgeStage::Crop), of(EdgeStage::Crop)),
        (DETECTION_STAGE, of(EdgeStage::Detect) + keypoints_us),
        (name(EdgeStage::Infer), of(EdgeStage::Infer) - keypoints_us),
        (name(EdgeStage::Encode), of(EdgeStage::Encode)),
    ]
}

fn name(stage: EdgeStage) -> &'static str {
    match stage {
        EdgeStage::Crop => "crop",
        EdgeStage::Detect => DETECTION_STAGE,
        EdgeStage::Infer => "infer",
        EdgeStage::Encode => "encode",
    }
}

/// Frames of one camera by tick. Requested ticks must not decrease.
pub(super) struct FramesAt {
    source: Box<dyn FrameSource>,
    /// A frame that came before its tick was requested.
    ahead: Option<Frame>,
    ended: bool,
}

impl FramesAt {
    pub(super) fn new(source: Box<dyn FrameSource>) -> Self {
        Self {
            source,
            ahead: None,
            ended: false,
        }
    }

    /// The frame of `tick`; `None` if the camera has none. Earlier frames are dropped.
    ///
    /// # Errors
    /// The error of the source, which is not read again.
    pub(super) fn at(&mut self, tick: Tick) -> Result<Option<Frame>, SourceError> {
        loop {
            match self.ahead.take() {
                Some(frame) if frame.tick == tick => return Ok(Some(frame)),
                Some(frame) if frame.tick > tick => {
                    self.ahead = Some(frame);
                    return Ok(None);
                }
                _ if self.ended => return Ok(None),
                _ => {}
            }
            self.ended = true;
            self.ahead = self.source.next_frame()?;
            self.ended = self.ahead.is_none();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{FrameContent, KeypointFrame};

    struct Recorded(Vec<i64>);

    impl FrameSource for Recorded {
        fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
            if self.0.is_empty() {
                return Ok(None);
            }
            let tick = Tick(self.0.remove(0));
            Ok(Some(Frame {
                tick,
                capture_offset_us: 0,
                content: FrameContent::Keypoints(KeypointFrame::default()),
            }))
        }
    }

    fn ticks_found(recorded: &[i64], asked: &[i64]) -> Vec<Option<i64>> {
        let mut frames = FramesAt::new(Box::new(Recorded(recorded.to_vec())));
        asked
            .iter()
            .map(|&t| frames.at(Tick(t)).unwrap().map(|f| f.tick.0))
            .collect()
    }

    #[test]
    fn a_missing_frame_is_a_gap_and_later_frames_wait() {
        assert_eq!(
            ticks_found(&[1, 2, 5], &[1, 2, 3, 4, 5, 6]),
            [Some(1), Some(2), None, None, Some(5), None]
        );
    }

    #[test]
    fn frames_before_the_tick_are_dropped() {
        assert_eq!(ticks_found(&[1, 2, 3, 4], &[3, 4]), [Some(3), Some(4)]);
    }
}
