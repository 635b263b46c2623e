//! The thread that looks for people without boxes, with networks of its own: a pass takes as long as several ticks, and none of
//! them is lost to it.
//!
//! The patches of a tick with a pass go out with its sightings, after those of later ticks. One pass goes on at a time; one that
//! is asked for meanwhile is left out.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use farfield_node::clock;
use farfield_proto::message::{BoxSet, DETECTION_STAGE};

use super::outbox;
use super::shared::Shared;
use super::tick_start::TickStart;
use super::work_watch::Caller;
use crate::node::beyond_view::say_beyond_view;
use crate::pipeline::{EdgeOutput, EdgePipeline, StepRequest};
use crate::source::Frame;

/// As many people as a pass may find, for how long it should take at most.
const MOST_SIGHTED: usize = 32;

/// A tick of which the patches are made, and whose pictures are still to be looked at.
pub(super) struct Pass {
    pub(super) start: TickStart,
    pub(super) frames: Vec<Option<Frame>>,
    /// What waits for the sightings.
    pub(super) output: EdgeOutput,
}

/// The way to the thread.
pub(super) struct DetectionThread {
    passes: SyncSender<Pass>,
}

impl DetectionThread {
    /// Starts the thread, which ends when this is dropped; it works with `pipeline`.
    ///
    /// # Errors
    /// When the system has no thread left.
    pub(super) fn spawn(shared: Arc<Shared>, pipeline: EdgePipeline) -> std::io::Result<Self> {
        // Nothing waits: who asks while a pass goes on finds nobody who takes it.
        let (passes, to_do) = sync_channel(0);
        std::thread::Builder::new()
            .name("detection".to_owned())
            .spawn(move || work(&shared, pipeline, &to_do))?;
        Ok(Self { passes })
    }

    /// Hands over a pass; gives it back where one goes on.
    pub(super) fn begin(&self, pass: Pass) -> Option<Pass> {
        self.passes.try_send(pass).err().map(|error| match error {
            TrySendError::Full(pass) | TrySendError::Disconnected(pass) => pass,
        })
    }
}

fn work(shared: &Shared, mut pipeline: EdgePipeline, to_do: &Receiver<Pass>) {
    while let Ok(Pass {
        start,
        frames,
        mut output,
    }) = to_do.recv()
    {
        let begun = clock::now();
        shared.begin_work(Caller::Detection, MOST_SIGHTED);
        let boxes = BoxSet {
            persons: Vec::new(),
            ..(*start.boxes).clone()
        };
        let request = StepRequest {
            tick: start.tick,
            boxes: &boxes,
            detection_cameras: &start.detection_cameras,
            persons: None,
            timing: None,
        };
        pipeline.set_message_version(shared.message_version());
        let found = pipeline.step(&frames, &request, &mut |_| {});
        shared.works.end(Caller::Detection);
        shared.count(DETECTION_STAGE, clock::micros_since(begun));
        match found {
            Ok(found) => {
                shared.ledger().failures.worked();
                output.add_sightings(found.sighting_sets);
            }
            Err(error) => shared.note_failure(&error.into()),
        }
        outbox::send(shared, &start, output);
    }
    say_beyond_view(&pipeline);
}
