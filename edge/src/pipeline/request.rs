use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::BoxSet;
use farfield_proto::message::live::PatchTiming;
use farfield_proto::tick::Tick;

use crate::inference::CameraDetections;

/// The pipeline's task at a tick: in lock-step all that fusion requests, in live mode what time and
/// link allow.
#[derive(Debug, Clone, Copy)]
pub struct StepRequest<'a> {
    /// The tick of the frames.
    pub tick: Tick,
    /// Expected positions of people, moved to the frames' tick if they are for another one.
    pub boxes: &'a BoxSet,
    /// The cameras of this tick's detection pass; empty without a pass.
    pub detection_cameras: &'a [CameraIndex],
    /// Detections of an earlier tick; if present, the detector does not run now.
    pub detections: Option<&'a [CameraDetections]>,
    /// The persons with boxes to process, ascending; `None` for all.
    pub persons: Option<&'a [PersonId]>,
    /// Placeholder for the timing that is set on sending; it counts towards the message's size.
    pub timing: Option<PatchTiming>,
}

impl<'a> StepRequest<'a> {
    /// All that fusion requests in `boxes`, at their tick.
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
