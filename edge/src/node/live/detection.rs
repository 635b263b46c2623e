//! The threads that detect people without boxes, so that detection delays no tick. One runs the
//! detector before each detection pass, the other makes the sightings of the pass with its own
//! network.
//!
//! The patches of a tick with a pass are sent together with its sightings, after the patches of
//! later ticks. Only one pass runs at a time. A pass that fusion requests meanwhile, or before the
//! first detections, is skipped.

use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use farfield_node::clock;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::{DETECTION_STAGE, SIGHTING_STAGE};
use farfield_proto::tick::Tick;
use tracing::debug_span;

use super::shared::{Shared, TickStart, send_output};
use super::work_watch::Caller;
use crate::inference::CameraDetections;
use crate::live::Micros;
use crate::live::detection_schedule::DetectionSchedule;
use crate::node::worker::report_beyond_view;
use crate::pipeline::{EdgeOutput, EdgePipeline, StepRequest, ViewpointDetector};
use crate::source::Frame;

/// Most people of one picture: bounds the time of the detector.
const MAX_SIGHTED: usize = 32;

/// Pictures for the detector.
pub(super) struct Pictures {
    pub(super) tick: Tick,
    pub(super) frames: Vec<Option<Frame>>,
    /// The tick of the pass that needs them.
    pub(super) pass: Tick,
    pub(super) cameras: Vec<CameraIndex>,
}

/// A tick with finished patches and unfinished sightings.
pub(super) struct Pass {
    pub(super) start: TickStart,
    pub(super) frames: Vec<Option<Frame>>,
    pub(super) detections: Vec<CameraDetections>,
    /// The patches, which wait for the sightings.
    pub(super) output: EdgeOutput,
}

/// A handle of the threads.
pub(super) struct DetectionThreads {
    pictures: SyncSender<Pictures>,
    passes: SyncSender<Pass>,
    schedule: Arc<Mutex<DetectionSchedule>>,
}

impl DetectionThreads {
    /// Starts the threads: `detector` runs the detector, `sighter` makes sightings. They end when
    /// the handle is dropped.
    ///
    /// # Errors
    /// If the system cannot start a thread.
    pub(super) fn spawn(
        shared: &Arc<Shared>,
        (detector, sighter): (ViewpointDetector, EdgePipeline),
        period_us: Micros,
    ) -> std::io::Result<Self> {
        // No queue: a request during a run or a pass is refused.
        let (pictures, to_detect_in) = sync_channel(0);
        let (passes, to_sight) = sync_channel(0);
        let schedule = Arc::new(Mutex::new(DetectionSchedule::new(period_us)));
        let (of_detector, of_sighter) = (Arc::clone(shared), Arc::clone(shared));
        let outcome = Arc::clone(&schedule);
        let thread = |name: &str| std::thread::Builder::new().name(name.to_owned());
        thread("detector")
            .spawn(move || detect(&of_detector, detector, &to_detect_in, &outcome))?;
        thread("sightings").spawn(move || sight(&of_sighter, sighter, &to_sight))?;
        Ok(Self {
            pictures,
            passes,
            schedule,
        })
    }

    /// Whether the detector must run on the pictures of `tick`, see [`DetectionSchedule::is_due`].
    pub(super) fn is_detection_due(&self, tick: Tick, pass: Tick, nth: i64) -> bool {
        lock(&self.schedule).is_due(tick, pass, nth)
    }

    /// Runs the detector on pictures, unless it is running.
    pub(super) fn detect(&self, pictures: Pictures) {
        // The next tick tries again.
        drop(self.pictures.try_send(pictures));
    }

    /// The detections of `cameras` for the pass at `tick`; `None` if some are missing or too old.
    pub(super) fn detections(
        &self,
        tick: Tick,
        cameras: &[CameraIndex],
    ) -> Option<Vec<CameraDetections>> {
        lock(&self.schedule).for_pass(tick, cameras)
    }

    /// Starts a pass; returns it if another one is running.
    pub(super) fn begin(&self, pass: Pass) -> Option<Pass> {
        self.passes.try_send(pass).err().map(|error| match error {
            TrySendError::Full(pass) | TrySendError::Disconnected(pass) => pass,
        })
    }
}

fn lock(schedule: &Mutex<DetectionSchedule>) -> MutexGuard<'_, DetectionSchedule> {
    schedule.lock().unwrap_or_else(PoisonError::into_inner)
}

fn detect(
    shared: &Shared,
    mut detector: ViewpointDetector,
    to_detect_in: &Receiver<Pictures>,
    schedule: &Mutex<DetectionSchedule>,
) {
    while let Ok(pictures) = to_detect_in.recv() {
        let _span = debug_span!("detection", tick = pictures.tick.0).entered();
        let begun = clock::now();
        shared.begin_work(Caller::Detector, MAX_SIGHTED);
        let Pictures {
            tick,
            pass,
            frames,
            cameras,
        } = &pictures;
        let detections = detector.detect(frames, cameras, *tick, *pass);
        shared.works.end(Caller::Detector);
        let took_us = clock::micros_since(begun);
        shared.count(DETECTION_STAGE, took_us);
        match detections {
            Ok(detections) => {
                shared.ledger().failures.worked();
                lock(schedule).add(*pass, detections, took_us.into());
            }
            Err(error) => shared.note_failure(&error.into()),
        }
    }
}

fn sight(shared: &Shared, mut pipeline: EdgePipeline, to_sight: &Receiver<Pass>) {
    while let Ok(Pass {
        start,
        frames,
        detections,
        mut output,
    }) = to_sight.recv()
    {
        let begun = clock::now();
        let found = detections.iter().map(|it| it.people.len()).sum();
        shared.begin_work(Caller::Sightings, found);
        let request = StepRequest {
            tick: start.tick,
            boxes: &start.boxes,
            detection_cameras: &start.detection_cameras,
            detections: Some(&detections),
            // No patches: the boxes only give the motion of people since their detection.
            persons: Some(&[]),
            timing: None,
        };
        pipeline.set_message_version(shared.message_version());
        let sighted = pipeline.step(&frames, &request, &mut |_| {});
        shared.works.end(Caller::Sightings);
        shared.count(SIGHTING_STAGE, clock::micros_since(begun));
        match sighted {
            Ok(sighted) => {
                shared.ledger().failures.worked();
                output.add_sightings(sighted.sighting_sets);
            }
            Err(error) => shared.note_failure(&error.into()),
        }
        send_output(shared, &start, output);
    }
    report_beyond_view(&pipeline);
}
