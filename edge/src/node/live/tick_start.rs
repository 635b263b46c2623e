use std::sync::Arc;

use farfield_proto::id::CameraIndex;
use farfield_proto::message::BoxSet;
use farfield_proto::tick::Tick;

use crate::live::rate::SendPlan;

/// State at the start of a tick.
pub(super) struct TickStart {
    pub(super) tick: Tick,
    pub(super) boxes: Arc<BoxSet>,
    pub(super) detection_cameras: Vec<CameraIndex>,
    /// Whether fusion is silent, so that this edge must follow people itself.
    pub(super) is_watched: bool,
    pub(super) plan: SendPlan,
    pub(super) may_send: bool,
    /// Whether there is time for the second crops of tilted people.
    pub(super) has_time_for_second_crops: bool,
}
