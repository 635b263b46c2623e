//! What an edge shall do at a tick.

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::live::PatchTiming;
use farfield_proto::message::BoxSet;
use farfield_proto::tick::Tick;

/// What an edge shall do at a tick: in lock-step what fusion says, live what there is time and room for.
#[derive(Debug, Clone, Copy)]
pub struct StepRequest<'a> {
    /// The tick of the frames.
    pub tick: Tick,
    /// Where people are; made for any tick.
    pub boxes: &'a BoxSet,
    /// The cameras that look for people without boxes.
    pub detection_cameras: &'a [CameraIndex],
    /// Who is worked on of those who have boxes, ascending; `None`: all.
    pub persons: Option<&'a [PersonId]>,
    /// What stands in the messages until they are sent; it takes part in their size.
    pub timing: Option<PatchTiming>,
}

impl<'a> StepRequest<'a> {
    /// All that fusion asks for in `boxes`, at their tick.
    pub fn of(boxes: &'a BoxSet) -> Self {
        Self {
            tick: boxes.tick,
            boxes,
            detection_cameras: &boxes.detection_cameras,
            persons: None,
            timing: None,
        }
    }

    pub(super) fn includes(&self, person: PersonId) -> bool {
        self.persons
            .is_none_or(|persons| persons.binary_search(&person).is_ok())
    }
}
