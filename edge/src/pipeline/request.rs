//! What the pipeline is asked to do at a tick.

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::BoxSet;
use farfield_proto::message::live::PatchTiming;
use farfield_proto::tick::Tick;

use crate::inference::CameraDetections;

/// What the pipeline is asked to do at a tick: in lock-step all that fusion asks for, live what time and link allow.
#[derive(Debug, Clone, Copy)]
pub struct StepRequest<'a> {
    /// The tick of the frames.
    pub tick: Tick,
    /// Where people are expected; may be made for another tick, and is then moved on.
    pub boxes: &'a BoxSet,
    /// The cameras of this tick's detection pass; empty for none.
    pub detection_cameras: &'a [CameraIndex],
    /// Detections of an earlier tick; with them the detector does not run now.
    pub detections: Option<&'a [CameraDetections]>,
    /// The persons with boxes that are processed, ascending; `None`: all.
    pub persons: Option<&'a [PersonId]>,
    /// Placeholder for the timing that is filled in when a message is sent; it counts towards the message's size.
    pub timing: Option<PatchTiming>,
}

impl<'a> StepRequest<'a> {
    /// All that fusion asks for in `boxes`, at their tick.
    pub fn of(boxes: &'a BoxSet) -> Self {
        Self {
            tick: boxes.tick,
            boxes,
            detection_cameras: &boxes.detection_cameras,
            detections: None,
            persons: None,
            timing: None,
        }
    }

    pub(super) fn includes(&self, person: PersonId) -> bool {
        self.persons
            .is_none_or(|persons| persons.binary_search(&person).is_ok())
    }
}
