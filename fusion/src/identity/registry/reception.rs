//! Which viewpoints send messages. A person is not absent at ticks for which no viewpoint that has
//! it in sight sent any.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::align::TickGroup;
use crate::identity::phase::Showable;
use crate::sightings::contradiction::in_sight;

/// Time without messages after which a viewpoint is silent, seconds: over a slow link not every
/// tick has a message. If edges share fewer than four ticks a second, the ticks between count as
/// silence.
const SILENT_S: f64 = 0.25;

/// When each viewpoint last sent a message.
#[derive(Debug, Clone)]
pub(super) struct Reception {
    cameras: Vec<(ViewpointIndex, CameraModel)>,
    /// By viewpoint.
    last_sent: Vec<Option<Tick>>,
    silent_ticks: i64,
}

impl Reception {
    pub(super) fn new(cameras: Vec<(ViewpointIndex, CameraModel)>, rate_hz: f64) -> Self {
        let viewpoints = cameras.iter().map(|(of, _)| usize::from(of.0) + 1).max();
        Self {
            cameras,
            last_sent: vec![None; viewpoints.unwrap_or(0)],
            silent_ticks: (SILENT_S * rate_hz).ceil() as i64,
        }
    }

    /// Records which viewpoints sent messages for a tick.
    pub(super) fn record(&mut self, group: &TickGroup) {
        let patches = group.patch_sets.iter().map(|set| set.viewpoint);
        let sightings = group.sighting_sets.iter().map(|set| set.viewpoint);
        for viewpoint in patches.chain(sightings) {
            if let Some(last_sent) = self.last_sent.get_mut(usize::from(viewpoint.0)) {
                *last_sent = Some(group.tick);
            }
        }
    }

    /// Which evidence `tick` could give about the body of `keypoints_m` (world, metres). A
    /// viewpoint may skip a tick or lose its messages: then its evidence is unknown. A viewpoint
    /// that is silent for longer is not waited for. If all that have the body in sight are silent,
    /// the body is not absent. A body in sight of none has left.
    pub(super) fn showable(&self, keypoints_m: &[Vector3<f64>], tick: Tick) -> Showable {
        let has_reported = |viewpoint: usize| self.last_sent.get(viewpoint) == Some(&Some(tick));
        let mut viewpoints = self.cameras.iter().map(|(of, _)| usize::from(of.0));
        if viewpoints.all(has_reported) {
            return Showable::BY_ALL;
        }
        let sees = |viewpoint: usize| {
            let mut own = self.cameras.iter();
            own.any(|(of, model)| {
                usize::from(of.0) == viewpoint && !in_sight(model, keypoints_m).is_empty()
            })
        };
        let (mut reported, mut between, mut silent) = (0, 0, 0);
        for (viewpoint, last_sent) in self.last_sent.iter().enumerate() {
            if sees(viewpoint) {
                match last_sent {
                    Some(last) if *last == tick => reported += 1,
                    Some(last) if tick - *last <= self.silent_ticks => between += 1,
                    _ => silent += 1,
                }
            }
        }
        Showable {
            by_two: reported >= 2 || between == 0,
            by_any: reported > 0 || between + silent == 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sightings::fixture::hall;

    /// The evidence of tick 100 about a person in sight of all viewpoints, by when each last sent.
    fn showable(last_sent: [Option<i64>; 3]) -> [bool; 2] {
        let cameras = hall().cameras.into_iter().take(last_sent.len()).collect();
        let mut reception = Reception::new(cameras, 60.0);
        reception.last_sent = last_sent.iter().map(|tick| tick.map(Tick)).collect();
        let body_m = [Vector3::new(0.0, 0.0, 1.0)];
        let Showable { by_two, by_any } = reception.showable(&body_m, Tick(100));
        [by_two, by_any]
    }

    #[test]
    fn a_skipped_tick_is_no_evidence_of_absence() {
        let (now, left_out, silent) = (Some(100), Some(98), Some(20));
        assert_eq!(showable([now, now, now]), [true, true]);
        assert_eq!(showable([now, now, left_out]), [true, true]);
        assert_eq!(showable([now, left_out, left_out]), [false, true]);
        assert_eq!(showable([left_out; 3]), [false, false]);
        assert_eq!(
            showable([now, silent, None]),
            [true, true],
            "not waited for"
        );
        assert_eq!(showable([silent, silent, None]), [true, false]);
    }
}
