//! Which viewpoints are heard: who is not seen while those are silent that could see it, is not absent for that.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::align::TickGroup;
use crate::sightings::contradiction::in_sight;

/// For how long nothing comes from a viewpoint that is still heard, seconds: over a thin link not every tick has a message.
const SILENT_S: f64 = 0.25;

/// When each viewpoint was heard last.
#[derive(Debug, Clone)]
pub(super) struct Listening {
    cameras: Vec<(ViewpointIndex, CameraModel)>,
    /// By viewpoint.
    heard: Vec<Option<Tick>>,
    silent_ticks: i64,
}

impl Listening {
    pub(super) fn new(cameras: Vec<(ViewpointIndex, CameraModel)>, rate_hz: f64) -> Self {
        let viewpoints = cameras.iter().map(|(of, _)| usize::from(of.0) + 1).max();
        Self {
            cameras,
            heard: vec![None; viewpoints.unwrap_or(0)],
            silent_ticks: (SILENT_S * rate_hz).ceil() as i64,
        }
    }

    /// Notes whose messages a tick has.
    pub(super) fn hear(&mut self, group: &TickGroup) {
        let patches = group.patch_sets.iter().map(|set| set.viewpoint);
        let sightings = group.sighting_sets.iter().map(|set| set.viewpoint);
        for viewpoint in patches.chain(sightings) {
            if let Some(heard) = self.heard.get_mut(usize::from(viewpoint.0)) {
                *heard = Some(group.tick);
            }
        }
    }

    /// Whether silence explains that none shows the body of `keypoints_m` (world, metres) at `tick`: those that have it in
    /// sight are silent, all of them. Who is in sight of none has left.
    pub(super) fn explains(&self, keypoints_m: &[Vector3<f64>], tick: Tick) -> bool {
        let is_silent = |viewpoint: ViewpointIndex| {
            let last = self.heard.get(usize::from(viewpoint.0)).copied().flatten();
            last.is_none_or(|last| tick - last > self.silent_ticks)
        };
        if !self.cameras.iter().any(|(of, _)| is_silent(*of)) {
            return false;
        }
        let in_sight =
            |(_, model): &&(ViewpointIndex, CameraModel)| !in_sight(model, keypoints_m).is_empty();
        let mut watching = self.cameras.iter().filter(in_sight).peekable();
        watching.peek().is_some() && watching.all(|(of, _)| is_silent(*of))
    }
}
