//! Which viewpoints send messages: a person is not absent for ticks of which no viewpoint that has it in sight sent any.

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::align::TickGroup;
use crate::identity::phase::Showable;
use crate::sightings::contradiction::in_sight;

/// For how long nothing comes from a viewpoint that is still heard, seconds: over a thin link not every tick has a message. Where
/// edges share fewer than four ticks a second, the ticks between count as silence.
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

    /// What `tick` could show of the body of `keypoints_m` (world, metres). Viewpoints leave ticks out or lose their messages:
    /// what such a one would have shown is not known. One that is silent for longer is not waited for, and where all that have
    /// the body in sight are silent, it is not absent. Who is in sight of none has left.
    pub(super) fn showable(&self, keypoints_m: &[Vector3<f64>], tick: Tick) -> Showable {
        let has_reported = |viewpoint: usize| self.heard.get(viewpoint) == Some(&Some(tick));
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
        for (viewpoint, heard) in self.heard.iter().enumerate() {
            if sees(viewpoint) {
                match heard {
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

    /// What tick 100 could show of somebody whom all viewpoints have in sight, by when each was heard last.
    fn showable(heard: [Option<i64>; 3]) -> [bool; 2] {
        let cameras = hall().cameras.into_iter().take(heard.len()).collect();
        let mut listening = Listening::new(cameras, 60.0);
        listening.heard = heard.iter().map(|tick| tick.map(Tick)).collect();
        let body_m = [Vector3::new(0.0, 0.0, 1.0)];
        let Showable { by_two, by_any } = listening.showable(&body_m, Tick(100));
        [by_two, by_any]
    }

    #[test]
    fn a_tick_that_viewpoints_leave_out_could_show_nobody() {
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
